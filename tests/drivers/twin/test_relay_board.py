"""The board's own timers."""

from __future__ import annotations

import math

from drivers.relay.values import Channel
from drivers.twin.commands import RelayAllOff, RelayPulse, RelaySwitch
from drivers.twin.relay_board import Board, CoilChange


def board() -> Board:
    return Board([Channel.VALVE, Channel.PUMP, Channel.LAMP])


def run(device: Board, until_s: float) -> list[CoilChange]:
    changes = []
    while device.next_s <= until_s:
        changes += device.step(device.next_s)
    return changes


def test_every_contact_is_open_at_power_on() -> None:
    device = board()
    assert not any(device.contacts.values())
    assert math.isinf(device.next_s)


def test_a_pulse_closes_on_arrival_and_opens_after_its_time() -> None:
    device = board()
    device.submit(1.0, RelayPulse(Channel.VALVE, 0.5, 1.0))
    assert run(device, 10.0) == [CoilChange(1.0, Channel.VALVE, True), CoilChange(1.5, Channel.VALVE, False)]


def test_a_pulse_that_arrives_as_the_timer_ends_goes_on_without_a_gap() -> None:
    device = board()
    device.submit(1.0, RelayPulse(Channel.PUMP, 0.5, 1.0))
    device.submit(1.5, RelayPulse(Channel.PUMP, 0.5, 1.5))
    assert run(device, 10.0) == [CoilChange(1.0, Channel.PUMP, True), CoilChange(2.0, Channel.PUMP, False)]


def test_frames_are_never_obeyed_in_another_order_than_sent() -> None:
    device = board()
    device.submit(1.3, RelayPulse(Channel.VALVE, 5.0, 1.3))
    device.submit(1.0, RelaySwitch(Channel.VALVE, False, 1.0))
    run(device, 2.0)
    assert not device.contacts[Channel.VALVE]


def test_switching_on_ends_a_running_timer() -> None:
    device = board()
    device.submit(0.0, RelayPulse(Channel.LAMP, 0.5, 0.0))
    device.submit(0.1, RelaySwitch(Channel.LAMP, True, 0.1))
    run(device, 10.0)
    assert device.contacts[Channel.LAMP]


def test_all_off_ends_every_timer() -> None:
    device = board()
    device.submit(0.0, RelayPulse(Channel.VALVE, 5.0, 0.0))
    device.submit(0.0, RelayPulse(Channel.PUMP, 5.0, 0.0))
    device.submit(0.1, RelayAllOff(0.1))
    run(device, 0.1)
    assert not any(device.contacts.values())
    assert math.isinf(device.next_s)


def test_a_timer_runs_out_behind_a_welded_contact() -> None:
    device = board()
    device.submit(0.0, RelayPulse(Channel.VALVE, 1.0, 0.0))
    run(device, 0.5)
    device.frozen = True
    run(device, 2.0)
    assert device.contacts[Channel.VALVE]
    device.frozen = False
    device.step(2.0)
    assert not device.contacts[Channel.VALVE]
