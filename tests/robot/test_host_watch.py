"""What the computer under the program does wrong. F41, F46 and F48 act in tests/faults."""

from __future__ import annotations

import pytest

from robot.clock import run_virtual
from robot.runtime.host_watch import CLOCK_STEP_S, ClockSteps, Heat, HostWatch, hottest_c

from .machine import machine


def test_a_clock_that_is_slewed_has_not_jumped():
    steps = ClockSteps(1e9, 0.0)
    assert [steps.look(1e9 + 1.0005 * k, float(k)) for k in range(1, 10_000)] == [0.0] * 9_999


@pytest.mark.parametrize("step_s", [-7200.0, -CLOCK_STEP_S, CLOCK_STEP_S, 3600.0, 6.2e8])
def test_a_jump_is_told_once_with_its_size(step_s):
    steps = ClockSteps(1e9, 0.0)
    assert steps.look(1e9 + 1.0, 1.0) == 0.0
    assert steps.look(1e9 + 2.0 + step_s, 2.0) == pytest.approx(step_s)
    assert steps.look(1e9 + 3.0 + step_s, 3.0) == 0.0


def test_a_suspended_computer_has_jumped():
    steps = ClockSteps(1e9, 100.0)
    assert steps.look(1e9 + 600.0, 100.5) == pytest.approx(599.5)


def test_heat_ends_five_degrees_below_where_it_began():
    heat, seen = Heat(), []
    for celsius in (74.9, 75.0, 84.9, 85.0, 80.0, 79.9, 70.0, 69.9):
        heat.look(celsius)
        seen.append((heat.warm, heat.hot))
    assert seen == [
        (False, False), (True, False), (True, False), (True, True), (True, True), (True, False), (True, False),
        (False, False),
    ]  # fmt: skip


def zone(root, number: int, kind: str, temp: str | None) -> None:
    folder = root / f"thermal_zone{number}"
    folder.mkdir()
    (folder / "type").write_text(f"{kind}\n")
    if temp is not None:
        (folder / "temp").write_text(temp)


def test_the_hottest_processor_zone_counts_and_no_other(tmp_path):
    zone(tmp_path, 0, "cpu-thermal", "61500\n")
    zone(tmp_path, 1, "x86_pkg_temp", "64000\n")
    zone(tmp_path, 2, "PMIC-Die", "100000\n")
    zone(tmp_path, 3, "soc_thermal", "not a number\n")
    zone(tmp_path, 4, "cpu-big", None)
    assert hottest_c(tmp_path) == 64.0


def test_a_computer_without_zones_is_not_watched(tmp_path):
    assert hottest_c(tmp_path / "gone") is None

    async def main():
        async with machine(tmp_path) as m:
            told = []
            await HostWatch(tmp_path, False, m.actuation, told.append, zones=tmp_path / "gone").look_at_heat()
            return told, m.actuation.state.faults

    assert run_virtual(main()) == ([], ())


def test_of_a_simulated_machine_only_the_configuration_is_watched(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            watches = [HostWatch(tmp_path, simulated, m.actuation, print) for simulated in (True, False)]
            return [[poll.name for poll in watch.polls] for watch in watches]

    assert run_virtual(main()) == [
        ["configuration file"], ["configuration file", "wall clock", "temperature"],
    ]  # fmt: skip


def test_a_configuration_that_is_gone_is_told_once(tmp_path):
    path = tmp_path / "rover.toml"
    path.write_text("seed = 1\n")

    async def main():
        async with machine(tmp_path) as m:
            told = []
            watch = HostWatch(path, True, m.actuation, told.append)
            await watch.look_at_file()
            path.unlink()
            for _ in range(3):
                await watch.look_at_file()
            return told

    (text,) = run_virtual(main())
    assert str(path) in text
    assert "[F46]" in text
