import asyncio
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
