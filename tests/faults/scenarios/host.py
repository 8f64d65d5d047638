"""Faults of the program, its computer, storage and time."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from drivers.inputs.mock import MockInputs
from drivers.twin.aftermath import run_on
from robot.clock import run_virtual
from robot.commands.run import single_error
from robot.ledger import Ledger, LedgerReader
from robot.ledger.values import Outcome
from robot.mission import State
from robot.runtime import ledger_path
from robot.runtime.host_watch import CLOCK_PERIOD_S, HEAT_PERIOD_S, HostWatch
from robot.safety import Mode, Verb
from robot.safety.catalogue import Action
from tests.e2e.rover_process import short_row
from tests.robot.machine import machine
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import DEMO, World, spray_row
from tests.robot.mission.truths import last_process, valve_pulses

from .buses import during_a_shot
from .disks import failing_disk
from .judging import VALVE_LAG_S, judged, shut_after_s
from .refusals import BUSY, CONFIG, FILE, nothing_was_asked_of, refused, run_of
from .values import Scenario, Scenarios, Seen, Stage

ROOT = Path(__file__).parents[3]
KILL = "from tests.faults.scenarios.killed import spray_and_be_killed; spray_and_be_killed({folder!r})"


def killed(stage: Stage) -> Seen:
    """SIGKILL in the middle of a shot: the board shuts the valve, the next start books the shot in full."""
    done = subprocess.run(
        [sys.executable, "-c", KILL.format(folder=str(stage.folder))], cwd=ROOT, timeout=120, check=False
    )
    assert done.returncode == -signal.SIGKILL
    after = run_on(stage.folder / "truth.jsonl")
    assert not any(on for channel, on in after.coils.items() if channel.value in ("valve", "pump"))
    with LedgerReader.open_read_only(ledger_path(stage.folder / "run")) as ledger:
        assert len(ledger.dangling()) == 1

    async def end(world: World) -> None:
        await asyncio.sleep(3.0)
        signal.raise_signal(signal.SIGTERM)

    again = spray_row(stage.folder, meddler=end, start=False, **SHORT)
    assert len(again.result.dangling) == 1
    assert again.dangling == 0
    assert again.result.mode is Mode.DISARMED
    assert valve_pulses(last_process(again)) == []
    with LedgerReader.open_read_only(ledger_path(stage.folder / "run")) as ledger:
        (task,) = ledger.tasks()
        (shot,) = ledger.shots(task.task_id)
        assert shot.result is not None
        assert shot.result.booked_ml == pytest.approx(shot.intent.full_ml)
        assert ledger.totals(task.task_id).booked_ml >= after.total_ml
    assert after.longest_opening_s <= shot.intent.pulse_s + VALVE_LAG_S
    return Seen(Action.SAFE_STOP, after.longest_opening_s, "the dangling intent, booked as the full pulse")


def told_to_end(number: signal.Signals) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        async def strike(world: World) -> None:
            signal.raise_signal(number)

        run, at_s = during_a_shot(stage, strike)
        assert run.shots[-1].result.outcome is Outcome.SHORTENED
        seen = judged(run, at_s, f"stopped by {number.name}", kept="everything: the shot is booked shortened")
        return replace(seen, after_s=max(seen.after_s, shut_after_s(run, at_s)))

    return scenario


def task_cancelled(stage: Stage) -> Seen:
    async def main() -> Seen:
        async with machine(stage.folder) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(1.0))
            while not m.twin.valve_open:
                await asyncio.sleep(0.005)
                m.twin.advance(m.twin.now_s)
            loop = asyncio.get_running_loop()
            at_s = loop.time()
            shot.cancel()
            with pytest.raises(asyncio.CancelledError):
                await shot
            assert not m.twin.valve_open
            after_s = loop.time() - at_s
            (result,) = m.results()
            assert result.outcome is Outcome.SHORTENED
            await asyncio.sleep(5.0)
            assert result.booked_ml >= m.twin.dispensed_ml
            assert m.actuation.state.mode is Mode.AUTO
            return Seen(Action.WARN, after_s, "the shot's row, booked shortened")

    return run_virtual(main())


def error_while_closing(error: Exception) -> Scenario:
    """The driver raises on every try to shut the valve: the contactor takes its power."""

    def scenario(stage: Stage) -> Seen:
        async def main() -> Seen:
            async with machine(stage.folder) as m:
                await m.ready_to_spray()
                cancel, at_s = m.devices.relay.cancel, 0.0
                loop = asyncio.get_running_loop()

                async def broken(channel: Any) -> None:
                    nonlocal at_s
                    if channel == "valve":
                        at_s = at_s or loop.time()
                        raise error
                    await cancel(channel)

                m.devices.relay.cancel = broken  # type: ignore[method-assign]
                result = await m.spray(0.32)
                after_s = loop.time() - at_s
                assert m.actuation.state.mode is Mode.SAFE_STOP
                assert any("closing is unconfirmed" in cause for cause in m.actuation.state.causes)
                assert not m.twin.coils(loop.time())["contactor"]  # type: ignore[index]
                assert not m.twin.valve_open
                await asyncio.sleep(5.0)
                assert result.booked_ml >= m.twin.dispensed_ml
                return Seen(Action.SAFE_STOP, after_s, f"the error ({error}); contactor off")

        return run_virtual(main())

    return scenario


def task_dies(stage: Stage) -> Seen:
    """A bug in a poll: the program ends with its error, everything off."""
    moments: list[float] = []

    async def strike(world: World) -> None:
        await world.until_valve_opens()
        moments.append(world.now_s)

        def broken(now_s: float) -> None:
            raise RuntimeError("a bug")

        world.twin.odometry = broken  # type: ignore[assignment, method-assign]

    with pytest.raises(ExceptionGroup) as caught:
        spray_row(stage.folder, meddler=strike, **SHORT)
    assert "a bug" in str(single_error(caught.value))
    after = run_on(stage.folder / "truth.jsonl")
    assert not any(after.coils.values())
    with LedgerReader.open_read_only(ledger_path(stage.folder / "run")) as ledger:
        (task,) = ledger.tasks()
        totals = ledger.totals(task.task_id)
        latched_s = next(e.stamp_s for e in ledger.events() if e.kind == "mode" and e.text.startswith("safe_stop"))
    assert totals.pending_ml == 0.0
    assert totals.booked_ml >= after.total_ml
    return Seen(Action.SAFE_STOP, latched_s - moments[0], "the error's trace: it leaves with the program")


def task_falls_silent(stage: Stage) -> Seen:
    """A driver that never comes back from a reading."""
    moments: list[float] = []
    read = MockInputs.read

    async def hang(inputs: MockInputs):  # type: ignore[no-untyped-def]
        if moments:
            await asyncio.Event().wait()
        return await read(inputs)

    async def strike(world: World) -> None:
        await world.until(State.MOVE)
        await asyncio.sleep(0.5)
        moments.append(world.now_s)

    with patch.object(MockInputs, "read", hang):
        run = spray_row(stage.folder, meddler=strike, **SHORT)
    return judged(run, moments[0], "silent for", kept="which task, and for how long")


def disk_fails(sqlite_name: str, words: str, kept: str) -> Scenario:
    """No intent can be written."""

    def scenario(stage: Stage) -> Seen:
        moments: list[float] = []

        with failing_disk(moments) as disk:
            disk.failing = sqlite_name
            run = spray_row(stage.folder, **SHORT)
        assert run.shots == ()
        assert run.twin.dispensed_ml == 0.0
        return judged(run, moments[0], words, kept=kept)

    return scenario


def power_cut(stage: Stage) -> Seen:
    """The ledger's files as they lay on the disk in the middle of a shot, the log torn at any byte of its tail."""
    copies = stage.folder / "copies"

    async def cut(world: World) -> None:
        await world.until_valve_opens()
        shutil.copytree(stage.folder / "run", copies)

    run = spray_row(stage.folder, meddler=cut, **SHORT)
    log = ledger_path(copies).with_name(ledger_path(copies).name + "-wal")
    whole = log.read_bytes()
    known = {shot.intent.target_id for shot in run.shots[:1]}
    longest_s, found = 0.0, []
    for lost in (0, 1, 100, 4096 + 24, 20_000, len(whole) // 2, len(whole)):
        folder = stage.folder / f"torn{lost}"
        shutil.copytree(copies, folder)
        log = ledger_path(folder).with_name(ledger_path(folder).name + "-wal")
        log.write_bytes(whole[: len(whole) - lost])
        began_s = time.process_time()
        with Ledger.open(ledger_path(folder)) as ledger:
            longest_s = max(longest_s, time.process_time() - began_s)
            dangling = ledger.dangling()
            ledger.begin_run("after the cut", datetime.now(UTC))
            assert len(ledger.book_dangling(datetime.now(UTC))) == len(dangling)
            assert ledger.dangling() == ()
            assert {item.intent.target_id for item in dangling} <= known
            found.append(len(dangling))
    assert found[0] == 1  # what was committed before the valve opened is there when no byte is lost
    assert found == sorted(found, reverse=True)
    return Seen(Action.SAFE_STOP, longest_s, "every committed row")


@contextmanager
def time_zone(name: str) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("TZ", name)
        time.tzset()
        yield
    time.tzset()


def other_zone(zone: str) -> Scenario:
    """Nothing of a mission depends on where the clock on the wall is read."""

    def scenario(stage: Stage) -> Seen:
        with time_zone(zone):
            run = spray_row(stage.folder, **SHORT)
        assert run.result.state is State.DONE
        same = stage.undisturbed
        assert [shot.intent for shot in run.shots] == [shot.intent for shot in same.shots]
        assert [shot.result for shot in run.shots] == [shot.result for shot in same.shots]
        with sqlite3.connect(ledger_path(stage.folder / "run")) as db:
            (text,) = db.execute("SELECT started_utc FROM run").fetchone()
        db.close()
        started = datetime.fromisoformat(text)
        assert abs((started.replace(tzinfo=started.tzinfo or UTC) - datetime.now(UTC)).total_seconds()) < 600.0
        return Seen(Action.WARN, 0.0, "everything: nothing is affected")

    return scenario


def wrong_configuration(old: str, new: str, *words: str) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        config = short_row(stage.folder, (0.45,))
        text = config.read_text()
        assert old in text
        config.write_text(text.replace(old, new))
        seen = refused(run_of(config, stage.folder / "out"), CONFIG, *words, kept="refused, exit 78")
        assert not (stage.folder / "out").exists()
        return seen

    return scenario


def newer_ledger(stage: Stage) -> Seen:
    (stage.folder / "out").mkdir()
    path = ledger_path(stage.folder / "out")
    Ledger.open(path).close()
    with sqlite3.connect(path) as db:
        db.execute("PRAGMA user_version = 999")
    db.close()
    before = path.read_bytes()
    config = short_row(stage.folder, (0.45,))
    seen = refused(run_of(config, path.parent), FILE, "newer program", "update the program", kept="the file, untouched")
    assert path.read_bytes() == before
    nothing_was_asked_of(path.parent / "truth.jsonl")
    return seen


def second_runtime(stage: Stage) -> Seen:
    (stage.folder / "out").mkdir()
    config = short_row(stage.folder, (0.45,))
    with Ledger.open(ledger_path(stage.folder / "out")):
        seen = refused(run_of(config, stage.folder / "out"), BUSY, str(os.getpid()), kept="who holds it")
    nothing_was_asked_of(stage.folder / "out" / "truth.jsonl")
    return seen


def clock_jumps(stage: Stage) -> Seen:
    """Two hours in no time: told, and a start is still possible."""

    async def main() -> Seen:
        async with machine(stage.folder, start=False) as m:
            loop, jump_s, told = asyncio.get_running_loop(), 0.0, list[str]()
            watch = HostWatch(stage.folder, False, m.actuation, told.append, lambda: loop.time() + jump_s)

            async def keep_looking() -> None:
                while True:
                    await watch.look_at_clock()
                    await asyncio.sleep(CLOCK_PERIOD_S)

            looking = asyncio.create_task(keep_looking())
            await asyncio.sleep(2.2)
            assert told == []
            at_s, jump_s = loop.time(), -7200.0
            while not told:
                assert loop.time() - at_s < 5.0
                await asyncio.sleep(0.01)
            after_s = loop.time() - at_s
            assert "jumped by -7200.0 s" in told[0]
            assert [fault.id for fault in m.actuation.state.faults] == ["F41"]
            await m.actuation.energise(lamp=False)
            for verb in (Verb.ARM, Verb.START):
                assert m.actuation.change_mode(verb, "test").allowed
            await m.ready_to_spray()
            result = await m.spray(0.32)
            assert result.outcome is Outcome.SPRAYED
            assert result.open_s == pytest.approx(0.32, abs=0.01)
            assert m.actuation.state.faults == ()
            looking.cancel()
            return Seen(Action.WARN, after_s, "durations and the order of rows")

    return run_virtual(main())


def too_hot(stage: Stage) -> Seen:
    """Told from 75 degrees on, paused from 85 on, over when it has cooled."""
    zone = stage.folder / "thermal_zone0"
    zone.mkdir()
    (zone / "type").write_text("cpu-thermal\n")
    other = stage.folder / "thermal_zone1"
    other.mkdir()
    (other / "type").write_text("battery\n")
    (other / "temp").write_text("99000\n")

    async def main() -> Seen:
        async with machine(stage.folder) as m:
            loop, told = asyncio.get_running_loop(), list[str]()
            watch = HostWatch(stage.folder, False, m.actuation, told.append, zones=stage.folder)

            async def at(celsius: float) -> None:
                (zone / "temp").write_text(f"{round(1000 * celsius)}\n")
                await asyncio.sleep(HEAT_PERIOD_S)
                await watch.look_at_heat()

            await at(60.0)
            assert told == []
            await at(76.0)
            assert "76 C" in told[0]
            assert m.actuation.state.mode is Mode.AUTO
            at_s = loop.time()
            await at(86.0)
            after_s = loop.time() - at_s
            assert m.actuation.state.mode is Mode.PAUSED
            assert "86 C" in m.actuation.state.causes[0]
            await at(81.0)
            assert [fault.id for fault in m.actuation.state.faults] == ["F48"]
            await at(79.0)
            assert m.actuation.state.faults == ()
            assert len(told) == 2
            return Seen(Action.PAUSE, after_s, "the temperature")

    return run_virtual(main())


def configuration_edited(stage: Stage) -> Seen:
    """In the middle of the mission somebody halves every dose in the file: told, and not obeyed."""
    path, moments = stage.folder / "mine.toml", list[float]()
    text = DEMO.read_text()
    path.write_text(text)

    async def edit(world: World) -> None:
        await world.until(State.AIM)
        moments.append(world.now_s)
        assert "coefficient = 0.02 " in text
        path.write_text(text.replace("coefficient = 0.02 ", "coefficient = 0.01 "))

    run = spray_row(stage.folder, meddler=edit, config_path=path, **SHORT)
    assert [shot.intent.dose_ml for shot in run.shots] == [shot.intent.dose_ml for shot in stage.undisturbed.shots]
    return judged(run, moments[0], "was changed", "[F46]", kept="the configuration of the start")


HOST: Scenarios = {
    "F26": {"": killed},
    "F27": {name.name: told_to_end(name) for name in (signal.SIGTERM, signal.SIGINT)},
    "F28": {"": task_cancelled},
    "F29": {
        "a bug in the driver": error_while_closing(RuntimeError("a bug")),
        "an error of the system": error_while_closing(OSError("bad descriptor")),
    },
    "F34": {"dies": task_dies, "falls silent": task_falls_silent},
    "F36": {"": disk_fails("SQLITE_FULL", "free space", "the ledger; without it no shot")},
    "F37": {"": power_cut},
    "F38": {
        "read-only": disk_fails("SQLITE_READONLY", "can be written", "what is in memory"),
        "failing": disk_fails("SQLITE_IOERR_WRITE", "replace it", "what is in memory"),
    },
    "F41": {"": clock_jumps},
    "F43": {zone: other_zone(zone) for zone in ("Pacific/Kiritimati", "America/St_Johns")},
    "F44": {
        "unknown key": wrong_configuration("max_ml = 12.0", "max_ml = 12.0\nmin_pulze_s = 1", "did you mean"),
        "wrong type": wrong_configuration("hour = 12.0", 'hour = "noon"', "twin.hour"),
    },
    "F45": {
        "milliseconds for seconds": wrong_configuration("valve_open_s = 0.025", "valve_open_s = 25", "found 25"),
        "degrees for radians": wrong_configuration("-0.8, 1.35, 0.0", "-0.8, 135.0, 0.0", "arm.stow_rad"),
    },
    "F46": {"": configuration_edited},
    "F47": {"": newer_ledger},
    "F48": {"": too_hot},
    "F49": {"": second_runtime},
}
