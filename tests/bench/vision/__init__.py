"""How well vision sees: ``python -m tests.bench.vision --out out/bench-vision`` writes one page and one JSON file."""
