"""The figures of an answer."""

from __future__ import annotations

from drivers.modem.at_channel import garbled


def figures_of(told: str, count: int) -> list[int]:
    """The first ``count`` figures, separated by commas. ``DeviceFault`` when there are fewer, or other things."""
    words = told.split(",")[:count]
    try:
        figures = [int(word.strip(' "')) for word in words]
    except ValueError:
        figures = []
    if len(figures) < count:
        raise garbled(f"{count} figures", told.encode("latin-1", "replace"))
    return figures
