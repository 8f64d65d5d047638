"""rustypot, another Dynamixel client, drives the emulated servos."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.drivers.arm.served import served

pytestmark = pytest.mark.peer

rustypot = pytest.importorskip("rustypot", reason="rustypot is not installed: pip install rustypot")

IDS = [1, 2, 3, 4, 5, 6, 7, 8]
BAUD = 1_000_000


@pytest.fixture
def client() -> Iterator[Any]:
    """A client of servos that another process emulates: 1 Mbaud, torque off, extended position mode."""
    with served(BAUD, "cold") as path:
        yield rustypot.Xl330PyController(path, BAUD, 0.5)


def test_it_pings_them(client: Any) -> None:
    assert all(client.ping(servo_id) for servo_id in IDS)
    assert not client.ping(9)


def test_it_reads_all_positions_at_once(client: Any) -> None:
    positions = client.sync_read_present_position(IDS)
    assert len(positions) == len(IDS)
    # rustypot's zero is half a turn below the middle that the arm's joints have as zero
    assert positions[0] == pytest.approx(0.0, abs=0.01) or positions[0] == pytest.approx(math.pi, abs=0.01)
    assert (positions[1] + positions[2]) % math.tau == pytest.approx(0.0, abs=0.01)  # a shadow is mirrored


def test_fast_sync_read_agrees_with_sync_read(client: Any) -> None:
    slow = client.sync_read_raw_present_position(IDS)
    client.set_fast_sync_read(True)
    fast = client.sync_read_raw_present_position(IDS)
    assert all(abs(a - b) <= 4 for a, b in zip(slow, fast, strict=True))  # the encoders' noise


def test_it_writes_goals_of_all_at_once_and_reads_them_back(client: Any) -> None:
    goals = [2048 + 10 * servo_id for servo_id in IDS]
    client.sync_write_raw_goal_position(IDS, goals)
    assert client.sync_read_raw_goal_position(IDS) == goals


def test_a_goal_whose_bytes_hold_a_header_is_written_and_read_back(client: Any) -> None:
    client.write_raw_goal_position(1, -131_073)
    assert one(client.read_raw_goal_position(1)) == -131_073
    client.sync_write_raw_goal_position([1, 2], [-131_073, 5])
    client.set_fast_sync_read(True)
    assert client.sync_read_raw_goal_position([1, 2]) == [-131_073, 5]
    assert bytes(client.read_raw_data(1, 116, 4)) == bytes.fromhex("fffffdff")


def test_with_torque_a_goal_moves_the_joint(client: Any) -> None:
    before = one(client.read_raw_present_position(1))
    client.write_raw_goal_position(1, before)
    client.write_raw_torque_enable(1, True)
    client.write_raw_goal_position(1, before + 200)
    end_s = time.monotonic() + 20.0
    while abs(one(client.read_raw_present_position(1)) - before - 200) > 4:
        assert time.monotonic() < end_s, "the joint does not come to its goal"


def one(value: Any) -> Any:
    """Some versions give a list of one."""
    return value[0] if isinstance(value, list) else value
