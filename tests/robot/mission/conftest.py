"""One short mission that nobody disturbs: the times of its states are the moments for whoever disturbs another."""

import pytest

from .rover import Run, spray_row

SHORT = {"stops_m": (0.25, 0.65), "length_m": 0.9, "twin": {"fruits_per_plant": 2.5}}


@pytest.fixture(scope="package")
def undisturbed(tmp_path_factory) -> Run:
    return spray_row(tmp_path_factory.mktemp("undisturbed"), **SHORT)
