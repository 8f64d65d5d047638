"""Noise at a megabyte a second: the receiver in it is still heard, and nothing grows."""

from __future__ import annotations

import pytest

from tests.bench.bench_gps import FLOOD_BYTES_S, FLOOD_S, flooded


@pytest.mark.long
def test_a_receiver_is_heard_in_a_flood_of_noise_at_bounded_cost() -> None:
    """F62. The bound is loose for the sake of busy machines; the bench gives the figure."""
    cost = flooded(FLOOD_BYTES_S)
    assert cost.heard_bytes > 0.3 * FLOOD_BYTES_S * FLOOD_S
    assert cost.fixes > 0.5 * 10.0 * FLOOD_S
    assert cost.share < 0.3
    assert cost.grown_bytes < 8_000_000
