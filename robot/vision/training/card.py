"""The model card: what the networks were trained on, how they do, and what cannot be expected of them."""

from __future__ import annotations

from collections.abc import Mapping

from robot.vision.training.figures import PhotoFigures, SceneFigures
from robot.vision.training.recipe import Recipe

LIMITS = """\
- Rendered scenes have no dust, dew, disease, motion blur or rolling shutter, and the photographs come from few
  greenhouses: the rates are of these images, not of a crop. Watch the report of the first rows in a new crop.
- Made for round tomatoes of 3.5 to 17 cm at 0.22 to 1.3 m. Plum and cherry tomatoes are proposed but measured badly.
- Ripeness is a colour. Under coloured light (sodium lamps, red and blue diodes) it means nothing.
- A picture darker than about five codes on the plants holds too little: the mission calls it too dark to trust.
- In photographs of one eye there is no scale; small fruit in the background are often not labelled, and count against
  the precision when they are found.
"""


def card(
    recipe: Recipe, counts: Mapping[str, int], scenes: SceneFigures, photos: PhotoFigures, digests: Mapping[str, str]
) -> str:
    """The card in Markdown. ``counts`` are images by source."""
    rows = [
        *((f"recognition, {kind}", f"{rate:.3f}") for kind, rate in scenes.recognition.items()),
        ("precision", f"{scenes.precision:.3f}"),
        ("error in space, median / 95 %", f"{scenes.median_mm:.1f} / {scenes.p95_mm:.1f} mm"),
        ("depth bias, median", f"{scenes.depth_bias_mm:+.2f} mm"),
        ("error of the diameter, median", f"{scenes.diameter_percent:.2f} %"),
        ("photographs: recall / precision / F1", f"{photos.recall:.3f} / {photos.precision:.3f} / {photos.f1:.3f}"),
    ]
    lines = [
        "# The networks of the fruit detector", "",
        "Written by `make train`. Three networks: `proposer` (fully convolutional, finds fruit in one picture),",
        "`outline` (traces the outline of a proposed fruit in both views) and `judge` (weighs the evidence). The same",
        "data and seed give the same weights on the same kind of processor.", "",
        "## Data", "",
        *(f"- {name}: {count}" for name, count in counts.items()), "",
        f"Shares of the proposer's examples: rendered scenes {recipe.rendered_share:.0%}, the twin's",
        f"{recipe.twin_share:.0%}, photographs {recipe.photo_share:.0%}; {recipe.proposer_steps} steps. The tracing",
        f"network: {recipe.outline_steps} steps on the rendered scenes and {recipe.twin_traced} of the twin's,",
        f"the verifier on the rendered scenes and the rest of the twin's. Seed {recipe.seed}.", "",
        "## Figures on held-out images", "",
        f"{scenes.fruits} fruit that show at least 60 % in both views, {photos.boxes} boxes of at least 40 px.", "",
        "| quantity | figure |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows), "",
        "`make bench-vision` gives them by hour, light, size, distance and ripeness, beside other methods.", "",
        "## Limits", "", LIMITS,
        "## Digests (SHA-256)", "", *(f"- `{name}` {digest}" for name, digest in digests.items()), "",
    ]  # fmt: skip
    return "\n".join(lines)
