import asyncio
import contextlib
from itertools import pairwise

import pytest

from drivers.errors import DeviceLost
from robot.clock import run_virtual
from robot.supervision import Health, Supervisor


def _run(step, seconds: float, silence_s: float = 1.0):
    """Supervise one task for some virtual seconds; gives (health, faults)."""

    async def main():
        faults: list[tuple[str, str]] = []
        stop = asyncio.Event()

        async def until_stop() -> None:
            await asyncio.sleep(seconds)
            stop.set()
            raise _Enough

        supervisor: list[Supervisor] = []
        health = []
        try:
            async with asyncio.TaskGroup() as group:
                supervisor.append(Supervisor(group, lambda name, text: faults.append((name, text))))
                supervisor[0].poll("sensors", "test", step, 0.1, silence_s)
                supervisor[0].watch()
                await asyncio.sleep(seconds)
                health.extend(supervisor[0].health)
                group.create_task(until_stop())
        except* _Enough:
            pass
        return health[0], faults

    return run_virtual(main())


class _Enough(Exception):
    pass


def test_a_task_that_keeps_its_rate_is_ready_and_reports_no_fault():
    async def step() -> None:
        await asyncio.sleep(0.01)

    health, faults = _run(step, 5.0)
    assert health.state is Health.READY
    assert faults == []


def test_a_task_that_loses_its_device_degrades_is_retried_and_recovers():
    calls = 0

    async def step() -> None:
        nonlocal calls
        calls += 1
        if 3 < calls < 6:
            raise DeviceLost("relay", "an answer", "silence", "plug it in")

    health, faults = _run(step, 5.0)
    assert health.state is Health.READY
    assert [name for name, _ in faults] == ["sensors"]
    assert "plug it in" in faults[0][1]


def test_retries_back_off():
    times: list[float] = []

    async def step() -> None:
        times.append(asyncio.get_running_loop().time())
        raise DeviceLost("relay", "an answer", "silence", "plug it in")

    _run(step, 30.0)
    gaps = [b - a for a, b in pairwise(times)]
    assert gaps[:4] == pytest.approx([0.2, 0.4, 0.8, 1.6])
    assert max(gaps) == pytest.approx(5.0)


def test_a_task_that_falls_silent_is_a_fault():
    async def step() -> None:
        await asyncio.sleep(100.0)

    health, faults = _run(step, 5.0)
    assert health.state is Health.DEGRADED
    assert faults[0][0] == "sensors"
    assert "silent for" in faults[0][1]


def test_a_task_that_dies_is_a_fault_and_takes_the_group_with_it():
    async def step() -> None:
        raise ZeroDivisionError("defect")

    with pytest.raises(ExceptionGroup) as caught:
        _run(step, 5.0)
    assert caught.group_contains(ZeroDivisionError)


# --- the tree, and the verdict for a watchdog


async def _watched(steps, judge) -> None:
    """``judge(supervisor)`` while tasks poll those steps ten times a second; names from the steps."""

    async def judging(supervisor: Supervisor) -> None:
        await judge(supervisor)
        raise _Enough

    with contextlib.suppress(ExceptionGroup):
        async with asyncio.TaskGroup() as group:
            supervisor = Supervisor(group, lambda name, text: None)
            for step in steps:
                supervisor.poll(step.__name__, "test", step, 0.1, 1.0)
            supervisor.watch()
            group.create_task(judging(supervisor))


def judged(judge, *steps):
    """What ``judge`` gave; raises what it raised."""
    found: list[object] = []

    async def noting(supervisor: Supervisor) -> None:
        found.append(await judge(supervisor))

    run_virtual(_watched(steps, noting))
    assert found
    return found[0]


async def sensors() -> None:
    await asyncio.sleep(0.01)


async def relay() -> None:
    raise DeviceLost("relay", "an answer", "silence", "plug it in")


async def stuck() -> None:
    await asyncio.sleep(1000.0)


def test_the_tree_tells_owner_expected_and_measured_rate():
    async def judge(supervisor: Supervisor):
        await asyncio.sleep(10.0)
        return supervisor.health[0]

    health = judged(judge, sensors)
    assert (health.name, health.owner, health.state) == ("sensors", "test", Health.READY)
    assert health.expected_hz == pytest.approx(10.0)
    assert health.measured_hz == pytest.approx(1.0 / 0.11, rel=0.01)
    assert (health.errors, health.last_error) == (0, "")
    assert health.beats == pytest.approx(10.0 / 0.11, abs=2)


def test_the_last_error_stays_told_with_its_time_when_the_task_is_well_again():
    calls = 0

    async def relay() -> None:
        nonlocal calls
        calls += 1
        if calls == 5:
            raise DeviceLost("relay", "an answer", "silence", "plug it in")

    async def judge(supervisor: Supervisor):
        await asyncio.sleep(10.0)
        return supervisor.health[0]

    health = judged(judge, relay)
    assert health.state is Health.READY
    assert "plug it in" in health.last_error
    assert health.error_s == pytest.approx(0.4, abs=0.02)
    assert health.since_s == pytest.approx(health.error_s + 0.2, abs=0.02)
    assert health.errors == 1


def test_a_device_that_is_gone_is_no_reason_to_start_the_process_anew():
    async def judge(supervisor: Supervisor) -> str:
        await asyncio.sleep(60.0)
        assert [task.state for task in supervisor.health] == [Health.READY, Health.DEGRADED]
        return supervisor.healthy()

    assert judged(judge, sensors, relay) == ""


def test_a_task_that_hangs_is_a_reason_and_is_named_with_its_owner():
    async def judge(supervisor: Supervisor) -> tuple[str, str]:
        await asyncio.sleep(0.9)
        before = supervisor.healthy()
        await asyncio.sleep(5.0)
        return before, supervisor.healthy()

    assert judged(judge, sensors, stuck) == ("", "stuck (test): no sign of life for 5.9 s")


def test_a_kept_task_is_ready_while_it_waits_and_stopped_when_it_is_over():
    async def judge(supervisor: Supervisor):
        enough = asyncio.Event()

        async def listen() -> None:
            await enough.wait()

        task = supervisor.keep("listener", "test", listen)
        await asyncio.sleep(100.0)
        states = [supervisor.health[0].state]
        enough.set()
        await task
        return [*states, supervisor.health[0].state, supervisor.healthy()]

    assert judged(judge) == [Health.READY, Health.STOPPED, ""]


def test_a_kept_task_that_dies_ends_the_group_with_its_error_and_is_failed():
    async def main() -> list[object]:
        found: list[object] = []

        async def dies() -> None:
            await asyncio.sleep(1.0)
            raise ZeroDivisionError("defect")

        try:
            async with asyncio.TaskGroup() as group:
                supervisor = Supervisor(group, lambda name, text: found.append((name, text)))
                supervisor.keep("mission", "mission", dies)
        except* ZeroDivisionError:
            found += [supervisor.health[0].state, supervisor.healthy()]
        return found

    assert run_virtual(main()) == [Health.FAILED, "mission (mission): ZeroDivisionError: defect"]


def test_a_supervisor_that_does_not_look_is_a_reason_itself():
    async def judge(supervisor: Supervisor) -> str:
        await asyncio.sleep(1.0)
        supervisor._running[-1].cancel()  # its own task
        await asyncio.sleep(3.0)
        return supervisor.healthy()

    assert "supervisor: has not looked after its tasks" in judged(judge, sensors)


def test_the_same_failures_are_retried_at_the_same_times_again():
    async def times() -> list[float]:
        at_s: list[float] = []

        async def step() -> None:
            at_s.append(asyncio.get_running_loop().time())
            raise DeviceLost("relay", "an answer", "silence", "plug it in")

        async def judge(_: Supervisor) -> None:
            await asyncio.sleep(40.0)

        await _watched([step], judge)
        return at_s

    assert run_virtual(times()) == run_virtual(times())
