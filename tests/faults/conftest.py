"""The undisturbed mission, whose times are the moments for the faults."""

import pytest

from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import Run, spray_row


@pytest.fixture(scope="package")
def undisturbed(tmp_path_factory) -> Run:
    return spray_row(tmp_path_factory.mktemp("undisturbed"), **SHORT)
