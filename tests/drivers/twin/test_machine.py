"""The whole machine: power, spray, time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.relay.values import Channel
from drivers.twin import Twin
from drivers.twin import commands as c
from drivers.twin.truth import TruthList
from tests.drivers.twin import rig

WITH_CONTACTOR = frozenset({Channel.VALVE, Channel.PUMP, Channel.CONTACTOR})


def pulse(twin: Twin, at_s: float, channel: Channel, duration_s: float) -> None:
    twin.apply(at_s, c.RelayPulse(channel, duration_s, at_s))


def pressed(twin: Twin) -> None:
    """The pump runs until 25 s; at 5 s the pressure stands."""
    pulse(twin, 0.0, Channel.PUMP, 25.0)
    twin.advance(5.0)


def test_an_aimed_shot_lands_on_its_fruit() -> None:
    angles, fruit = rig.aimed()
    twin = rig.twin(stow_rad=angles)
    pressed(twin)
    pulse(twin, 5.0, Channel.VALVE, 0.5)
    twin.advance(8.0)
    assert twin.dispensed_ml == pytest.approx(6.2, rel=0.05)
    assert twin.fruit_ml[fruit] > 0.4 * twin.dispensed_ml


def test_every_millilitre_lands_somewhere() -> None:
    angles, _ = rig.aimed()
    twin = rig.twin(stow_rad=angles, drawn=True)
    pressed(twin)
    twin.apply(5.0, c.ArmGoal(rig.POINTING_RAD))
    pulse(twin, 5.2, Channel.VALVE, 1.0)
    twin.advance(8.0)
    total = twin.physics.deposits.total
    landed_ml = sum(total.fruit_ml.values()) + total.leaf_ml + total.stem_ml + total.soil_ml + total.air_ml
    assert landed_ml == pytest.approx(twin.dispensed_ml, abs=1e-9)
    assert twin.physics.tank_ml == pytest.approx(twin.nominal.tank_fill_ml - twin.dispensed_ml, abs=1e-9)


def test_the_estop_shuts_the_valve_and_stops_pump_and_base() -> None:
    twin = rig.twin()
    pressed(twin)
    pulse(twin, 5.0, Channel.VALVE, 10.0)
    twin.apply(5.5, c.WheelsDrive(0.3, 0.0))
    twin.apply(5.9, c.WorldEstop(True))
    twin.advance(6.0)
    shut_ml, pressure_bar = twin.dispensed_ml, twin.physics.hydraulics.pressure_bar(6.0)
    assert not twin.valve_open
    twin.advance(7.0)
    pose = twin.base_pose
    twin.apply(7.0, c.WheelsDrive(0.3, 0.0))
    twin.advance(9.0)
    assert twin.base_pose == pose
    assert twin.dispensed_ml == shut_ml
    assert twin.physics.hydraulics.pressure_bar(9.0) < pressure_bar


def test_releasing_the_estop_lets_a_pulse_that_still_runs_flow_again() -> None:
    """Why a reset must never be trusted to be harmless: the coil is still on."""
    twin = rig.twin()
    pressed(twin)
    pulse(twin, 5.0, Channel.VALVE, 10.0)
    twin.apply(6.0, c.WorldEstop(True))
    twin.apply(7.0, c.WorldEstop(False))
    twin.advance(7.5)
    assert twin.valve_open


def test_without_the_contactor_there_is_no_power() -> None:
    twin = rig.twin(channels=WITH_CONTACTOR)
    pressed(twin)
    pulse(twin, 5.0, Channel.VALVE, 1.0)
    twin.apply(5.0, c.WheelsDrive(0.3, 0.0))
    twin.advance(8.0)
    assert twin.dispensed_ml == 0.0
    assert twin.base_pose == (0.0, 0.0, 0.0)


def test_the_contactor_gives_power() -> None:
    twin = rig.twin(channels=WITH_CONTACTOR)
    twin.apply(0.0, c.RelaySwitch(Channel.CONTACTOR, True, 0.0))
    pressed(twin)
    pulse(twin, 5.0, Channel.VALVE, 1.0)
    twin.advance(8.0)
    assert twin.dispensed_ml > 10.0


def test_a_leak_drips_to_the_soil() -> None:
    twin = rig.twin("valve:wrong@1s")
    pressed(twin)
    twin.advance(10.0)
    assert not twin.valve_open
    assert twin.physics.deposits.leaked_ml > 0.5
    assert twin.fruit_ml == {}


def test_the_nozzle_moves_with_the_base() -> None:
    twin = rig.twin()
    before = twin.nozzle_pose
    twin.apply(1.0, c.WorldPush(0.3, 0.0, 0.0))
    assert twin.nozzle_pose[:3, 3] - before[:3, 3] == pytest.approx([0.3, 0.0, 0.0])
    assert np.array_equal(twin.nozzle_pose[:3, :3], before[:3, :3])


def test_the_same_seed_lives_the_same_life() -> None:
    lives = []
    for seed in (5, 5, 6):
        sink = TruthList()
        twin = rig.twin(seed=seed, truth=sink, drawn=True)
        pressed(twin)
        pulse(twin, 5.0, Channel.VALVE, 1.0)
        twin.apply(6.0, c.WheelsDrive(0.2, 0.0))
        twin.advance(9.0)
        lives.append([line for line in sink.lines if line["kind"] == "event"])
    assert lives[0] == lives[1] != lives[2]


def test_a_command_is_logged_before_what_it_does() -> None:
    sink = TruthList()
    twin = rig.twin(truth=sink)
    pulse(twin, 1.0, Channel.VALVE, 0.3)
    assert sink.lines[-1]["kind"] == "command"
    twin.advance(2.0)
    whats = [line.get("what", line["kind"]) for line in sink.lines]
    assert whats.index("command") < whats.index("coil_on") < whats.index("valve_opened") < whats.index("delivered")


COMMANDS: list[Callable[[float], c.Command]] = [
    lambda t: c.RelayPulse(Channel.PUMP, 3.0, t + 0.009),
    lambda t: c.RelayPulse(Channel.VALVE, 0.4, t + 0.009),
    lambda t: c.RelaySwitch(Channel.VALVE, False, t + 0.009),
    lambda t: c.RelayAllOff(t + 0.009),
    lambda t: c.ArmGoal(rig.POINTING_RAD),
    lambda t: c.ArmGoal(rig.STOW_RAD),
    lambda t: c.ArmHold(),
    lambda t: c.ArmTorque(False),
    lambda t: c.ArmTorque(True),
    lambda t: c.WheelsDrive(0.3, 0.1),
    lambda t: c.WheelsStop(),
    lambda t: c.WorldEstop(True),
    lambda t: c.WorldEstop(False),
    lambda t: c.WorldPush(0.01, 0.0, 0.01),
]
FAULTS = ("relay:stuck@2s+1s", "wheels:stuck@3s+0.7s", "arm:stuck@1s+0.333s", "valve:slow@4s+2s")


@given(
    doings=st.lists(st.tuples(st.floats(0.0, 8.0), st.sampled_from(range(len(COMMANDS)))), max_size=15),
    looks=st.lists(st.floats(0.0, 12.0), max_size=15),
)
@settings(max_examples=15, deadline=None)
def test_the_truth_depends_on_what_is_done_and_not_on_who_looks_when(
    doings: list[tuple[float, int]], looks: list[float]
) -> None:
    def live(with_looks: bool) -> tuple[list[dict[str, Any]], list[float]]:
        sink = TruthList()
        twin = rig.twin(*FAULTS, truth=sink, drawn=True)
        todo = [(t, 0, k) for t, k in doings] + [(t, 1, 0) for t in looks if with_looks]
        for t, look, k in sorted(todo):
            if look:
                twin.odometry(t)
                twin.inputs(t)
                twin.arm_state(t)
            else:
                twin.apply(t, COMMANDS[k](t))
        twin.advance(15.0)
        events = [line for line in sink.lines if line["kind"] == "event"]
        return events, [*twin.base_pose, *twin.joints_rad.tolist(), twin.dispensed_ml]

    assert live(with_looks=True) == live(with_looks=False)
