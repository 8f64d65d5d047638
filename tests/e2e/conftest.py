"""End-to-end runs look with the paper's method: fast, and the same whatever the trained detector has learnt."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

EYES = {
    "SPRAYER_VISION__DETECTOR": "paper",
    "SPRAYER_TARGETS__MIN_CONFIDENCE": "0.3",  # its confidence is a score of its own
    "SPRAYER_TARGETS__SURE_CONFIDENCE": "0.3",
}


@pytest.fixture(scope="module", autouse=True)
def eyes() -> Iterator[None]:
    """For this process and for those that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in EYES.items():
            patch.setenv(name, value)
        patch.setenv("COLUMNS", "120")
        yield
