"""F28: wherever a shot is cancelled, the valve is shut and the liquid accounted for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Generator
from typing import Any

from drivers.relay.values import Channel
from robot.clock import run_virtual
from robot.safety import Mode
from tests.robot.machine import Machine, a_target, machine

OPEN_S = 0.1
ALL = 10_000


class AwaitPoints:
    """Counts how often the tasks of a shot wait, and calls ``strike`` at the ``at``-th."""

    def __init__(self) -> None:
        self.passed = 0
        self._at, self._strike = ALL, lambda: None

    def arm(self, at: int, strike: Callable[[], object]) -> None:
        self.passed, self._at, self._strike = 0, at, strike

    def disarm(self) -> None:
        self._at = ALL

    def make_task(
        self, loop: asyncio.AbstractEventLoop, coro: Coroutine[Any, Any, Any], **more: Any
    ) -> asyncio.Task[Any]:
        name = str(getattr(coro, "__qualname__", ""))
        of_a_shot = "spray" in name or "_account_for" in name
        return asyncio.Task(_counted(coro, self) if of_a_shot else coro, loop=loop, **more)

    def wait(self) -> None:
        self.passed += 1
        if self.passed == self._at:
            asyncio.get_running_loop().call_soon(self._strike)


class _Steps:
    """Awaits a coroutine, telling of every time that it waits."""

    def __init__(self, coro: Coroutine[Any, Any, Any], points: AwaitPoints) -> None:
        self._coro, self._points = coro, points

    def __await__(self) -> Generator[Any, Any, Any]:
        value: Any = None
        while True:
            try:
                waited = self._coro.send(value)
            except StopIteration as end:
                return end.value
            while True:
                self._points.wait()
                try:
                    value = yield waited
                except BaseException as error:  # noqa: BLE001 - handed on to the coroutine
                    try:
                        waited = self._coro.throw(error)
                    except StopIteration as end:
                        return end.value
                else:
                    break


async def _counted(coro: Coroutine[Any, Any, Any], points: AwaitPoints) -> Any:
    return await _Steps(coro, points)


async def cancelled_at(m: Machine, points: AwaitPoints, number: int, at: int) -> None:
    """A shot at target ``number`` that is cancelled, twice, at its ``at``-th await point."""
    m.ledger.upsert_targets(m.task_id, [a_target(number)])
    before_ml = m.twin.dispensed_ml
    shot = asyncio.ensure_future(m.actuation.spray(m.order(OPEN_S, number, 1.0)))

    def strike() -> None:
        shot.cancel()
        asyncio.get_running_loop().call_soon(shot.cancel)

    points.arm(at, strike)
    await asyncio.wait({shot})
    points.disarm()
    assert not m.twin.valve_open
    assert not (await m.devices.relay.read()).coils[Channel.VALVE]
    given_ml = m.twin.dispensed_ml - before_ml
    await asyncio.sleep(1.0)
    assert m.twin.dispensed_ml - before_ml == given_ml
    assert m.ledger.dangling() == ()
    assert sum(result.booked_ml for result in m.results()) >= m.twin.dispensed_ml
    if at == ALL:
        assert given_ml > 0.5
        assert not shot.cancelled()


def test_a_shot_that_is_cancelled_at_any_of_its_await_points_is_shut_and_booked(tmp_path):
    """At each of them, whatever task of the shot waits there, and cancelled again while it shuts."""

    async def main() -> tuple[int, float]:
        points = AwaitPoints()
        async with machine(tmp_path) as m:
            asyncio.get_running_loop().set_task_factory(points.make_task)
            await m.ready_to_spray()
            await cancelled_at(m, points, 1, ALL)
            count = points.passed
            for at in range(1, count + 1):
                await m.actuation.start_pump()
                await cancelled_at(m, points, 1 + at, at)
                assert m.actuation.state.mode is Mode.AUTO
            print(f"{count} await points")  # noqa: T201
            return count, m.twin.dispensed_ml

    count, given_ml = run_virtual(main())
    assert count >= 8  # of the caller, the ledger, the relay, the valve's time, the read-back, the meter
    assert given_ml > 0.0
