"""Monitors that cannot fail prove nothing: each of these bugs is put into the real robot and must be found out."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime

import pytest

from drivers.relay.mock import MockRelay
from drivers.relay.values import Channel, PulseReceipt
from drivers.twin import commands as c
from robot import safety
from robot.actuation import Actuation
from robot.actuation.readings import Readings
from robot.cli import run_command
from robot.ledger import Ledger
from robot.soak.life import START_UTC
from tests.properties.system_rig import SystemRig

Story = Callable[[SystemRig], None]
Bug = Callable[[pytest.MonkeyPatch, SystemRig], None]


def told(rig: SystemRig, story: Story) -> set[str]:
    """Which properties are seen broken when the story has been told to its end."""
    assert rig.boot()
    rig.make_ready()
    story(rig)
    rig.close()
    return set(rig.court.violations)


# --- stories in which a sound machine breaks nothing


def a_kill_in_a_shot(rig: SystemRig) -> None:
    rig.begin(rig.hands.spray(rig.order(1, 0.35)))
    rig.wait(0.1)
    assert rig.valve_on
    rig.kill()


def an_estop_pressed_and_left(rig: SystemRig) -> None:
    rig.suffer(c.WorldEstop(True))
    rig.wait(2.0)


def one_target_again_and_again(rig: SystemRig) -> None:
    for _ in range(5):
        rig.do(rig.hands.spray(rig.order(1, 0.6)))
    assert rig.twin.dispensed_ml > 5.0


def somebody_gives_up_in_a_shot(rig: SystemRig) -> None:
    rig.begin(rig.hands.spray(rig.order(1, 1.0)))
    rig.wait(0.2)
    assert rig.valve_on
    rig.cancel_all()
    rig.wait(2.0)


def the_wall_clock_steps_between_shots(rig: SystemRig) -> None:
    for number, step_s in enumerate((0.0, 20.0, -86400.0), 1):
        rig.wall.step(step_s)
        rig.do(rig.hands.spray(rig.order(number, 0.31)))


def two_plain_shots(rig: SystemRig) -> None:
    for target in (1, 2):
        rig.do(rig.hands.spray(rig.order(target, 0.35)))
    assert rig.twin.dispensed_ml > 5.0


def a_drive_between_frame_and_shot(rig: SystemRig) -> None:
    for _ in range(8):
        rig.do(rig.hands.drive(0.2, 0.0))
        rig.wait(0.1)
    rig.do(rig.hands.halt_base())
    rig.wait(1.0)
    assert rig.twin.base_pose[0] > 0.03
    rig.do(rig.hands.spray(rig.order(1, 0.35)))


# --- bugs


def plain_on(patch: pytest.MonkeyPatch, _rig: SystemRig) -> None:
    """The valve is switched on, and the host means to switch it off again."""
    pulse = MockRelay.pulse

    async def on(self: MockRelay, channel: Channel, duration_s: float):
        if channel is not Channel.VALVE:
            return await pulse(self, channel, duration_s)
        sent_s = self._clock()
        await self._bus.exchange(lambda: None, lambda at_s: self._send(c.RelaySwitch(channel, True, at_s)))
        return PulseReceipt(channel, sent_s, self._clock(), duration_s)

    patch.setattr(MockRelay, "pulse", on)


def estop_ignored(patch: pytest.MonkeyPatch, _rig: SystemRig) -> None:
    async def nothing(self: Actuation, cause: str) -> tuple[()]:
        return ()

    patch.setattr(Actuation, "emergency_stop", nothing)


def cap_ignored(patch: pytest.MonkeyPatch, _rig: SystemRig) -> None:
    authorise = safety.authorise_spray

    def generously(*arguments):
        widest = {"max_target_ml": 100.0, "max_minute_ml": 1000.0, "max_task_ml": 500_000.0, "max_shot_ml": 50.0}
        return authorise(
            *(replace(item, **widest) if isinstance(item, safety.Limits) else item for item in arguments)
        )  # fmt: skip

    patch.setattr(safety, "authorise_spray", generously)


def close_not_shielded(patch: pytest.MonkeyPatch, _rig: SystemRig) -> None:
    patch.setattr(asyncio, "shield", asyncio.ensure_future)


def wall_clock_for_a_duration(patch: pytest.MonkeyPatch, rig: SystemRig) -> None:
    """The board's driver stamps its receipts with the time of day, from which the shot's end is reckoned."""
    pulse = MockRelay.pulse

    async def stamped(self: MockRelay, channel: Channel, duration_s: float):
        receipt = await pulse(self, channel, duration_s)
        since: datetime = rig.wall.utc()
        return replace(receipt, sent_s=receipt.sent_s + (since - START_UTC).total_seconds() - rig.now_s)

    patch.setattr(MockRelay, "pulse", stamped)


def outcome_booked_short(patch: pytest.MonkeyPatch, _rig: SystemRig) -> None:
    write = Ledger.write_result
    patch.setattr(
        Ledger, "write_result",
        lambda self, intent_id, result: write(self, intent_id, replace(result, booked_ml=0.5 * result.booked_ml)),
    )  # fmt: skip


def frame_mark_ignored(patch: pytest.MonkeyPatch, _rig: SystemRig) -> None:
    patch.setattr(Readings, "moved_since_frame_m", 0.0)


SEEDED: list[tuple[Bug, Story, str]] = [
    (plain_on, a_kill_in_a_shot, "P2"),
    (estop_ignored, an_estop_pressed_and_left, "P6"),
    (cap_ignored, one_target_again_and_again, "P11"),
    (close_not_shielded, somebody_gives_up_in_a_shot, "P9"),  # the leak watch shuts the valve; nothing was booked
    (wall_clock_for_a_duration, the_wall_clock_steps_between_shots, "P22"),
    (outcome_booked_short, two_plain_shots, "P9"),
    (frame_mark_ignored, a_drive_between_frame_and_shot, "P5"),
]


@pytest.mark.parametrize(("bug", "story", "prop"), SEEDED, ids=[bug.__name__ for bug, _, _ in SEEDED])
def test_a_seeded_bug_is_found_out(tmp_path, monkeypatch, bug: Bug, story: Story, prop: str) -> None:
    rig = SystemRig(tmp_path)
    bug(monkeypatch, rig)
    assert prop in told(rig, story)


@pytest.mark.parametrize("story", [story for _, story, _ in SEEDED], ids=[story.__name__ for _, story, _ in SEEDED])
def test_the_sound_robot_breaks_nothing_in_the_same_story(tmp_path, story: Story) -> None:
    rig = SystemRig(tmp_path)
    assert told(rig, story) == set(), rig.story


def test_a_soak_over_a_robot_that_books_short_fails_and_tells_how_it_came_to_that(monkeypatch, capsys) -> None:
    outcome_booked_short(monkeypatch, None)  # type: ignore[arg-type]
    code = run_command(["soak", "--hours", "0.02", "--seed", "3"])
    page = capsys.readouterr().out
    assert code == 1
    assert "VIOLATED P9" in page
    assert "command relay pulse" in page.split("VIOLATED P9")[1]
