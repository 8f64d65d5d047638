"""When a loop counts as stalled, and what the thread that watches it does then. Numbers are of the fault catalogue."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import Future

import pytest

from drivers.errors import DeviceLost, DeviceRefused, DeviceTimeout
from drivers.stop_lane import StopLane
from robot.runtime.stall import Look, StallJudge, StallRules
from robot.runtime.stall_watch import TAKEN_S, StallWatch, stop_all
from robot.safety.timing import CLOSE_DEADLINE_S, LOOP_STALL_S

RULES = StallRules()
SPARE_S = 0.4  # for a busy computer


def looks(judge: StallJudge, beat_s: float, at_s: list[float]) -> list[Look]:
    return [judge.look(now_s, beat_s) for now_s in at_s]


def every(step_s: float, start_s: float, end_s: float) -> list[float]:
    return [start_s + step_s * k for k in range(1, round((end_s - start_s) / step_s) + 1)]


# --- the judgement


def test_a_loop_that_beats_is_alive() -> None:
    judge = StallJudge(RULES, 0.0)
    assert all(judge.look(now_s, now_s - 0.06) is Look.ALIVE for now_s in every(0.05, 0.0, 5.0))


def test_a_stall_is_found_at_its_limit_and_acted_upon_once() -> None:
    judge = StallJudge(RULES, 10.0)
    found = looks(judge, 10.0, every(0.05, 10.0, 11.0))
    assert found[:5] == [Look.ALIVE] * 5  # up to 0.25 s
    assert found[5] is Look.STALLED
    assert set(found[6:]) == {Look.STALLED_STILL}


def test_a_second_stall_is_acted_upon_again() -> None:
    judge = StallJudge(RULES, 0.0)
    assert looks(judge, 0.0, every(0.05, 0.0, 0.5))[-1] is Look.STALLED_STILL
    assert looks(judge, 0.55, every(0.05, 0.5, 0.8)) == [Look.ALIVE] * 6
    assert Look.STALLED in looks(judge, 0.55, every(0.05, 0.8, 1.0))


def test_a_watch_that_was_kept_from_running_itself_gives_the_loop_its_time_anew() -> None:
    judge = StallJudge(RULES, 0.0)
    assert looks(judge, 0.0, [0.05, 0.6, 0.65, 0.7, 0.8]) == [Look.ALIVE] * 5
    assert looks(judge, 0.0, [0.9])[0] is Look.STALLED


def test_a_program_that_was_suspended_for_long_is_stopped_when_it_goes_on() -> None:
    judge = StallJudge(RULES, 0.0)
    assert looks(judge, 0.04, [0.05, 30.0]) == [Look.ALIVE, Look.STALLED]


def test_what_keeps_the_watch_late_again_and_again_does_not_excuse_a_loop_for_more_than_a_second() -> None:
    judge = StallJudge(RULES, 0.0)
    at_s = every(0.2, 0.0, 1.4)
    assert at_s[looks(judge, 0.0, at_s).index(Look.STALLED)] <= RULES.longest_s + 0.21


# --- the thread


class Device:
    """A device whose port's owner takes a stop after ``takes_s`` and ends it after another ``ends_s``."""

    def __init__(self, name: str, takes_s: float = 0.0, ends_s: float = 0.0, beside: bool = True) -> None:
        self.posted_s: list[float] = []
        self.forced_s: list[float] = []
        self.error: Exception | None = None
        self._takes_s, self._ends_s = takes_s, ends_s
        self.lane = StopLane(name, self._post, self._force if beside else None)

    def _post(self) -> Future[None]:
        self.posted_s.append(time.monotonic())
        stop: Future[None] = Future()
        threading.Thread(target=self._own, args=(stop,), daemon=True).start()
        return stop

    def _own(self, stop: Future[None]) -> None:
        time.sleep(self._takes_s)
        stop.set_running_or_notify_cancel()
        time.sleep(self._ends_s)
        if self.error is None:
            stop.set_result(None)
        else:
            stop.set_exception(self.error)

    def _force(self) -> None:
        self.forced_s.append(time.monotonic())


def test_every_device_gets_its_stop_at_once_and_none_is_forced_that_takes_it() -> None:
    devices = [Device("relay", ends_s=0.1), Device("wheels")]
    began_s = time.monotonic()
    assert stop_all([device.lane for device in devices], "of a test") == ()
    assert all(device.posted_s[0] - began_s < 0.1 for device in devices)
    assert all(device.forced_s == [] for device in devices)


def test_beside_an_owner_that_hangs_the_stop_is_written_and_those_that_follow_do_not_wait_for_it() -> None:
    hangs, ends_late, well = Device("relay", takes_s=60.0), Device("wheels", ends_s=60.0), Device("arm")
    began_s = time.monotonic()
    told = stop_all([device.lane for device in (hangs, ends_late, well)], "of a test")
    assert time.monotonic() - began_s < CLOSE_DEADLINE_S + SPARE_S
    assert TAKEN_S <= hangs.forced_s[0] - began_s < TAKEN_S + SPARE_S
    assert len(ends_late.forced_s) == 1
    assert well.forced_s == []
    assert [text.partition(",")[0] for text in told] == [
        "relay: the owner of its port hangs", "wheels: the owner of its port hangs"
    ]


def test_a_device_that_stops_by_itself_is_not_forced_and_a_failed_stop_is_told() -> None:
    arm, relay, wheels = Device("arm", takes_s=60.0, beside=False), Device("relay"), Device("wheels")
    relay.error = DeviceTimeout("relay", "an answer", "silence", "check the cable")
    wheels.error = DeviceLost("wheels", "a port", "none", "plug it in")
    told = stop_all([arm.lane, relay.lane, wheels.lane], "of a test")
    assert any("it stops by itself" in text for text in told)
    assert any("found silence" in text for text in told)
    assert any("plug it in" in text for text in told)


def test_a_device_that_was_stopped_refuses_what_was_decided_before_until_it_is_released() -> None:
    lane = Device("relay").lane
    lane.require_released()
    lane.post("the event loop stalled").result(5.0)
    with pytest.raises(DeviceRefused, match="because the event loop stalled"):
        lane.require_released()
    lane.release()
    lane.require_released()


class Watched:
    """A real loop with its beats, and what its watch did."""

    def __init__(self, *devices: Device) -> None:
        self.devices = devices
        self.told: list[tuple[str, float]] = []

    def run(self, *stalls_s: float, between_s: float = 0.4) -> None:
        async def beats(watch: StallWatch) -> None:
            while True:
                await watch.beat()
                await asyncio.sleep(watch.beat_s)

        async def main() -> None:
            with StallWatch([device.lane for device in self.devices], self._on_stall) as watch:
                beating = asyncio.create_task(beats(watch))
                await asyncio.sleep(0.2)
                for stall_s in stalls_s:
                    asyncio.get_running_loop().call_later(0.0, self.told.append, ("began", time.monotonic()))
                    await asyncio.sleep(0.0)
                    await asyncio.sleep(0.0)
                    asyncio.get_running_loop().call_later(0.01, self.told.append, ("fell due", 0.0))
                    time.sleep(stall_s)  # noqa: ASYNC251 - the fault under test
                    await asyncio.sleep(between_s)
                    if any(what == "stalled" for what, _ in self.told):
                        await watch.release()
                beating.cancel()

        asyncio.run(main())

    def _on_stall(self, for_s: float) -> None:
        self.told.append(("stalled", for_s))


def test_a_blocked_loop_is_stopped_from_the_thread_and_told_before_what_fell_due_meanwhile(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """F30, P21."""
    device = Device("relay")
    watched = Watched(device)
    watched.run(1.5)
    what = [name for name, _ in watched.told]
    assert what == ["began", "stalled", "fell due"]
    began_s = watched.told[0][1]
    assert LOOP_STALL_S - RULES.beat_s - 0.02 <= device.posted_s[0] - began_s < LOOP_STALL_S + SPARE_S
    assert 1.4 < watched.told[1][1] < 1.5 + SPARE_S
    assert len(device.posted_s) == 1
    assert "the event loop stalled for" in caplog.text
    assert "time.sleep(stall_s)" in caplog.text  # where the loop stood
    device.lane.require_released()


def test_each_of_two_stalls_is_told() -> None:
    device = Device("relay")
    watched = Watched(device)
    watched.run(0.6, 0.7)
    assert [name for name, _ in watched.told].count("stalled") == 2
    assert len(device.posted_s) == 2


def test_a_short_delay_is_no_stall() -> None:
    device = Device("relay")
    watched = Watched(device)
    watched.run(0.1)
    assert device.posted_s == []
    assert [name for name, _ in watched.told] == ["began", "fell due"]


def test_the_watch_ends_with_its_block_and_leaves_no_thread() -> None:
    Watched(Device("relay")).run(0.0, between_s=0.0)
    assert "stall watch" not in {thread.name for thread in threading.enumerate()}
