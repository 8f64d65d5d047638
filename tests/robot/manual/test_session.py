"""The life of a session by hand: up, in MANUAL, and let go of however it ends."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Awaitable, Callable

import numpy as np
import pytest

from drivers.errors import DeviceError
from drivers.relay.values import Channel
from drivers.twin.commands import WorldBumper, WorldEstop, WorldTilt
from robot import safety
from robot.actuation import Refused
from robot.errors import UnavailableError, UsageError
from robot.ledger import Outcome
from robot.runtime.manual import Stopped
from robot.runtime.manual.arm import go_home, jog_joint, jog_nozzle
from robot.runtime.manual.base import step
from robot.runtime.manual.liquid import LiquidByHand

from .hand_session import Session, by_hand, until_valve_opens

SOON_S = 0.05


async def nothing(_hands, _twin) -> None:
    await asyncio.sleep(1.0)


async def jog(hands, _twin) -> None:
    await jog_joint(hands, "waist", 0.8, 0.3)


async def drive(hands, _twin) -> None:
    await step(hands, 0.5, 0.1)


async def spray(hands, _twin) -> None:
    await LiquidByHand(hands).dose(12.0)


def is_let_go(session: Session) -> None:
    """Valve shut, outputs off, base at rest, arm held with torque, every millilitre booked."""
    after = session.after
    assert not any(after.coils.values())
    assert after.base_pose == pytest.approx(session.twin.base_pose, abs=0.02)
    assert not session.twin.valve_open
    assert session.twin.physics.servos.torque_on
    assert all(shot.result is not None for shot in session.shots)
    assert sum(shot.result.booked_ml for shot in session.shots) >= after.total_ml - 1e-9


def test_an_operator_is_handed_an_armed_machine_in_manual_and_leaves_it_disarmed(tmp_path):
    seen = []

    async def look(hands, twin):
        seen.append((hands.actuation.state.mode, twin.coils(hands.now_s())[Channel.CONTACTOR]))

    session = by_hand(tmp_path, look)
    assert session.error is None
    assert seen == [(safety.Mode.MANUAL, True)]
    assert session.modes == ["ready", "manual", "ready", "disarmed"]
    is_let_go(session)


def test_an_idle_session_moves_and_sprays_nothing(tmp_path):
    session = by_hand(tmp_path, nothing)
    assert session.asked_after(0.0) == []
    assert session.after.total_ml == 0.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("act", [jog, drive])
def test_a_signal_stops_a_motion_where_it_is_and_ends_clean(act, number, tmp_path):
    async def interrupted(hands, twin):
        asyncio.get_running_loop().call_later(1.5, signal.raise_signal, number)
        await act(hands, twin)

    session = by_hand(tmp_path, interrupted)
    assert isinstance(session.error, Stopped)
    assert str(session.error) == f"stopped by {number.name}"
    assert session.error.exit_code == 0
    assert session.asked_after(session.latched_s() + SOON_S) == []
    turned = abs(session.twin.joints_rad[0])
    assert turned < 0.6
    assert session.twin.base_pose[0] < 0.3
    is_let_go(session)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_mid_shot_shuts_the_valve_and_the_shot_is_booked_shortened(number, tmp_path):
    async def interrupted(hands, twin):
        async def strike() -> None:
            await until_valve_opens(hands, twin)
            await asyncio.sleep(0.2)
            signal.raise_signal(number)

        striking = asyncio.create_task(strike())
        await spray(hands, twin)
        await striking

    session = by_hand(tmp_path, interrupted)
    assert isinstance(session.error, Stopped)
    (shot,) = session.shots
    assert shot.result.outcome is Outcome.SHORTENED
    assert 1.0 < session.after.total_ml < 6.0
    is_let_go(session)


@pytest.mark.parametrize(
    ("act", "fault", "words"),
    [
        (jog, "arm:off@2s", "arm: expected an answer"),
        (drive, "wheels:off@2s", "wheels: expected an answer"),
        (drive, "wheels:stuck@2s", "counters that move"),
        (jog, "inputs:off@2s", "inputs: expected an answer"),
        (drive, "relay:off@2s", "relay: expected an answer"),
        (jog, "arm:stuck@2s", "every joint within"),
        (spray, "inputs:off@2.3s", "inputs"),
        (spray, "valve:off@0s", "flow meter saw"),
        (nothing, "relay:garbage@0.6s", "relay"),
    ],
)
def test_a_device_that_fails_stops_the_machine_and_is_named(act, fault, words, tmp_path):
    session = by_hand(tmp_path, act, fault)
    assert session.error is not None
    assert words in f"{session.error} {' '.join(session.told)}"
    assert session.modes[-1] == "safe_stop"
    assert session.asked_after(session.latched_s() + SOON_S) == []
    after = session.after
    assert sum(shot.result.booked_ml for shot in session.shots) >= after.total_ml - 1e-9
    if not fault.startswith("relay"):
        assert not any(after.coils.values())
    assert abs(session.twin.joints_rad[0]) < 0.7
    assert after.base_pose[0] < 0.4


@pytest.mark.parametrize(
    ("command", "mode", "words"),
    [
        (WorldEstop(True), "estop", "the e-stop was pressed"),
        (WorldBumper(True), "safe_stop", "the bumper was pressed"),
    ],
)
@pytest.mark.parametrize("act", [jog, drive])
def test_the_e_stop_and_the_bumper_end_it_with_their_name(act, command, mode, words, tmp_path):
    async def pressed(hands, twin):
        async def press() -> None:
            await asyncio.sleep(1.0)
            twin.apply(hands.now_s(), command)

        pressing = asyncio.create_task(press())
        await act(hands, twin)
        await pressing

    session = by_hand(tmp_path, pressed)
    assert isinstance(session.error, Stopped)
    assert words in str(session.error)
    assert session.error.exit_code == 1
    assert session.modes[-1] == mode
    assert session.asked_after(session.latched_s() + SOON_S) == []
    is_let_go(session)


def test_the_next_session_acknowledges_what_the_last_one_was_latched_for_and_says_so(tmp_path):
    async def bumped(hands, twin):
        twin.apply(hands.now_s(), WorldBumper(True))
        try:
            await jog(hands, twin)
        finally:
            twin.apply(hands.now_s(), WorldBumper(False))

    assert by_hand(tmp_path, bumped).modes[-1] == "safe_stop"
    session = by_hand(tmp_path, jog)
    assert session.error is None
    assert "this command acknowledges the safe_stop before the restart: the bumper" in " ".join(session.told)
    assert session.modes[-1] == "disarmed"


@pytest.mark.parametrize(
    ("command", "words"),
    [(WorldEstop(True), "the e-stop"), (WorldTilt(0.4, 0.0), "the rover tilts"), (WorldBumper(True), "the bumper")],
)
def test_a_machine_that_is_not_fit_is_not_handed_over(command, words, tmp_path, monkeypatch):
    from robot.runtime.manual import building

    made = building.make_twin

    def spoilt(*arguments):
        twin = made(*arguments)
        twin.apply(0.0, command)
        return twin

    monkeypatch.setattr(building, "make_twin", spoilt)
    session = by_hand(tmp_path, jog)
    assert isinstance(session.error, UnavailableError)
    assert words in str(session.error)
    assert session.asked_after(0.0) == []
    is_let_go(session)


@pytest.mark.parametrize("device", ["relay", "arm", "wheels", "inputs"])
def test_a_device_that_is_missing_is_named_before_anything_moves(device, tmp_path):
    session = by_hand(tmp_path, jog, f"{device}:off")
    assert isinstance(session.error, DeviceError)
    assert f"{device}: expected" in str(session.error)
    assert session.asked_after(0.0) == []


@pytest.mark.parametrize("device", ["camera", "gps", "modem"])
def test_a_device_that_no_hand_needs_may_be_missing(device, tmp_path):
    session = by_hand(tmp_path, jog, f"{device}:off")
    assert session.error is None
    assert session.twin.joints_rad[0] == pytest.approx(0.8, abs=0.02)


Refusing = Callable[..., Awaitable[None]]


@pytest.mark.parametrize(
    ("act", "error", "words"),
    [
        (lambda hands: jog_joint(hands, "elbow", 0.9, 0.3), UsageError, "outside its limits"),
        (lambda hands: jog_joint(hands, "shoulder", 1.0, 0.3), Refused, "would touch itself or the rover"),
        (lambda hands: jog_nozzle(hands, (0.0, 0.0, -0.3), 0.3), Refused, ""),
        (lambda hands: step(hands, 0.6, 0.1), UsageError, "at most 0.5 m"),
    ],
)
def test_what_is_refused_says_why_and_nothing_moves(act: Refusing, error, words, tmp_path):
    async def refused(hands, _twin):
        await act(hands)

    session = by_hand(tmp_path, refused)
    assert isinstance(session.error, error), session.error
    assert words in str(session.error)
    assert session.asked_after(0.0) == []
    is_let_go(session)


def test_home_is_reached_from_afar(tmp_path):
    async def there_and_back(hands, twin):
        for name, by_rad in (("waist", 0.9), ("elbow", -0.9), ("shoulder", 0.5), ("wrist_angle", 0.6)):
            await jog_joint(hands, name, by_rad, 1.0)
        far = np.abs(twin.joints_rad - np.array(hands.settings.stow_rad)).max()
        assert far > 0.8
        await go_home(hands, 1.0)

    session = by_hand(tmp_path, there_and_back)
    assert session.error is None
    assert session.twin.joints_rad == pytest.approx((0.0, -0.8, 1.35, 0.0, 0.7, 0.0), abs=0.02)


def test_the_ledger_remembers_what_the_operator_asked_for(tmp_path):
    session = by_hand(tmp_path, jog)
    assert [event.text for event in session.events if event.kind == "by_hand"] == ["jog waist by 0.8 rad"]
