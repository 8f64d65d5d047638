"""A device that is not there keeps the robot from coming up."""

import pytest

from robot.errors import UnavailableError
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import spray_row


@pytest.mark.parametrize("device", ["relay", "arm", "wheels", "inputs", "camera", "gps", "modem"])
def test_a_device_that_is_not_there_is_named_and_nothing_moves(device, tmp_path):
    with pytest.raises(UnavailableError, match=f"{device}: expected an answer to the first request, found silence"):
        spray_row(tmp_path, faults=(f"{device}:off@0s",), **SHORT)
