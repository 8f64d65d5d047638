import asyncio
import os
import signal
import time

import pytest

from robot.clock import RealClockLoop, VirtualClockLoop, run_real, run_virtual, work


def test_a_thousand_seconds_pass_without_waiting():
    async def main() -> float:
        await asyncio.sleep(1000.0)
        return asyncio.get_running_loop().time()

    started = time.monotonic()
    assert run_virtual(main()) == 1000.0
    assert time.monotonic() - started < 100.0


@pytest.mark.parametrize("pace", [None, 500.0])
def test_work_arrives_exactly_when_its_modelled_duration_is_over_at_any_pace(pace):
    async def main() -> tuple[int, float, list[float]]:
        loop = asyncio.get_running_loop()
        ticks: list[float] = []

        async def tick() -> None:
            while True:
                await asyncio.sleep(0.1)
                ticks.append(loop.time())

        ticker = asyncio.create_task(tick())
        answer = await work(lambda: (time.sleep(0.05), 42)[1], 0.35)
        ticker.cancel()
        return answer, loop.time(), ticks

    answer, finished_s, ticks = run_virtual(main(), pace)
    assert answer == 42
    assert finished_s == 0.35
    assert ticks == pytest.approx([0.1, 0.2, 0.3])


def without_threads(main):
    with asyncio.Runner(loop_factory=lambda: VirtualClockLoop(threads=False)) as runner:
        return runner.run(main)


def test_without_threads_work_takes_its_modelled_duration_all_the_same():
    async def main() -> tuple[int, float]:
        answer = await work(lambda: 42, 0.35)
        return answer, asyncio.get_running_loop().time()

    assert without_threads(main()) == (42, 0.35)


def test_without_threads_an_error_of_the_work_comes_when_the_work_is_over():
    async def main() -> float:
        with pytest.raises(ZeroDivisionError):
            await work(lambda: 1 // 0, 0.35)
        return asyncio.get_running_loop().time()

    assert without_threads(main()) == 0.35


def test_without_threads_a_cancelled_caller_leaves_and_the_work_is_done():
    done: list[str] = []

    async def main() -> None:
        caller = asyncio.create_task(work(lambda: done.append("work"), 10.0))
        await asyncio.sleep(1.0)
        caller.cancel()
        with pytest.raises(asyncio.CancelledError):
            await caller

    without_threads(main())
    assert done == ["work"]


def test_the_clock_waits_for_work_that_is_slower_than_its_model():
    async def main() -> tuple[float, float]:
        loop = asyncio.get_running_loop()
        await work(lambda: time.sleep(0.2), 0.001)
        at_result = loop.time()
        await asyncio.sleep(1.0)
        return at_result, loop.time()

    assert run_virtual(main()) == (0.001, 1.001)


def test_a_cancelled_caller_leaves_while_the_work_goes_on_to_its_end():
    done: list[str] = []

    async def main() -> None:
        caller = asyncio.create_task(work(lambda: (time.sleep(0.05), done.append("work"))[1], 0.01))
        await asyncio.sleep(0.005)
        caller.cancel()
        with pytest.raises(asyncio.CancelledError):
            await caller
        await asyncio.sleep(1.0)

    run_virtual(main())
    assert done == ["work"]


def test_an_error_in_the_work_reaches_the_caller():
    async def main() -> None:
        await work(lambda: 1 // 0, 0.01)

    with pytest.raises(ZeroDivisionError):
        run_virtual(main())


def test_threads_and_sockets_are_refused_in_virtual_time():
    async def with_thread() -> None:
        await asyncio.to_thread(time.sleep, 0)

    async def with_socket() -> None:
        await asyncio.get_running_loop().create_server(asyncio.Protocol, "127.0.0.1", 0)

    for main in (with_thread, with_socket):
        with pytest.raises(RuntimeError, match="virtual time is for mock back ends"):
            run_virtual(main())


def test_a_pace_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="pace must be positive"):
        VirtualClockLoop(0.0)


def test_work_runs_in_real_time_on_an_ordinary_loop():
    async def main() -> int:
        return await work(lambda: 7, 1000.0)

    assert asyncio.run(main()) == 7


def test_a_timer_never_runs_early_however_near_it_is():
    async def main() -> float:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(4.1)
        due_s = loop.time() + 3e-10  # below asyncio's own clock resolution
        await asyncio.sleep(due_s - loop.time())
        return loop.time() - due_s

    assert run_virtual(main()) >= 0.0


def test_a_signal_is_heard_before_the_clock_jumps():
    async def main() -> float:
        loop = asyncio.get_running_loop()
        heard: list[float] = []
        loop.add_signal_handler(signal.SIGUSR1, lambda: heard.append(loop.time()))
        await asyncio.sleep(1.0)
        os.kill(os.getpid(), signal.SIGUSR1)
        await asyncio.sleep(5.0)
        return heard[0]

    assert run_virtual(main()) == 1.0


def test_two_real_loops_with_one_zero_show_one_time():
    zero_s = time.monotonic() - 5.0
    first, second = RealClockLoop(zero_s), RealClockLoop(zero_s, precise=True)
    try:
        assert 5.0 <= first.time() <= second.time() < 65.0
    finally:
        first.close()
        second.close()


def test_a_real_run_begins_at_zero():
    async def main() -> float:
        return asyncio.get_running_loop().time()

    assert 0.0 <= run_real(main()) < 60.0
