"""Whatever kills the program, and whenever: the valve shuts by the board, the ledger covers what the nozzle gave."""

import random
import signal
import time
from pathlib import Path

import pytest

from drivers.relay.values import Channel
from drivers.twin.aftermath import run_on
from drivers.twin.commands import Command, RelayPulse
from drivers.twin.truth_record import read_truth
from robot.ledger import LedgerReader
from robot.ledger.values import Outcome

from .rover_process import begin, finish, load, short_row, wait_for_line, wait_for_message

SPEED = "14"
VALVE_LAG_S = 0.06  # closing latency and its deviation, on top of the board's timer
QUICK = 4
MOMENTS = [pytest.param(n, marks=[pytest.mark.long] if n >= QUICK else []) for n in range(20)]
KILLS = 8  # of a row that is gone on with after each
STOPS_M = (0.45, 0.85, 1.25)
VIEW = '"kind":"view"'
OPENING = '"device":"relay","verb":"pulse","args":{"channel":"valve"'


def _begin_and_strike(config: Path, out: Path, moment: int, number: signal.Signals, *more: str) -> tuple[int, str]:
    """(exit code, stderr) of a run that gets the signal at a random moment: every second time when it has just opened
    the valve, and else after its next look."""
    dice, truth = random.Random(moment), out / "truth.jsonl"
    wanted, wait_s, count = VIEW, dice.uniform(0.0, 1.5), 1
    if moment % 2:
        just_now = moment % 4 == 1
        wanted, wait_s, count = OPENING, dice.uniform(0.0, 0.01 if just_now else 0.08), 1 if just_now else 2
    before = truth.read_text(errors="replace").count(wanted) if truth.exists() else 0
    process = begin(config, out, *more, "--speed", SPEED)
    wait_for_line(process, truth, wanted, before + count)
    time.sleep(wait_s)
    process.send_signal(number)
    return finish(process)


def _ledger_ml(out: Path) -> tuple[float, int]:
    """(booked and pending, number of dangling intents) over all tasks."""
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        totals = [ledger.totals(row.task_id) for row in ledger.tasks()]
        return sum(total.booked_ml + total.pending_ml for total in totals), len(ledger.dangling())


def _longest_pulse_s(truth: Path) -> float:
    pulses = [
        timed.command.duration_s
        for process in read_truth(truth).processes
        for timed in process.commands
        if _opens_valve(timed.command)
    ]
    return max(pulses, default=0.0)


def _opens_valve(command: Command) -> bool:
    return isinstance(command, RelayPulse) and command.channel is Channel.VALVE


@pytest.mark.parametrize("chain", [0, 1, pytest.param(2, marks=pytest.mark.long)])
def test_after_each_of_many_kills_the_row_goes_on_with_no_shot_lost_or_doubled(chain, tmp_path):
    config, rows, kills, openings, in_a_shot = short_row(tmp_path, STOPS_M), 0, 0, 0, 0
    while kills < KILLS:
        out = tmp_path / str(rows)
        out.mkdir()
        kills += _kill_until_done(config, out, KILLS - kills, moment=100 * chain + kills)
        opened, cut = _is_shut_and_booked(out)
        openings, in_a_shot = openings + opened, in_a_shot + cut
        _comes_up_disarmed(config, out)
        rows += 1
    assert openings >= 3  # or nothing was shown
    assert in_a_shot >= 1


def _kill_until_done(config: Path, out: Path, most: int, moment: int) -> int:
    """How many processes were killed before one came to the end of the row."""
    for kills in range(most):
        resume = ("--resume",) if (out / "ledger.sqlite").exists() and _tasks(out) else ()
        code, errors = _begin_and_strike(config, out, moment + kills, signal.SIGKILL, "--start", *resume)
        if code == 0:
            return kills
        assert code == -signal.SIGKILL, errors
    return most


def _tasks(out: Path) -> int:
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        return len(ledger.tasks())


def _is_shut_and_booked(out: Path) -> tuple[int, int]:
    """The openings of the valve, and how many of them a kill left without an outcome."""
    truth = out / "truth.jsonl"
    after = run_on(truth)
    assert after.longest_opening_s <= _longest_pulse_s(truth) + VALVE_LAG_S
    assert not any(on for channel, on in after.coils.items() if channel.value in ("valve", "pump"))
    assert _ledger_ml(out)[0] >= after.total_ml - 1e-6
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        shots = [shot for row in ledger.tasks() for shot in ledger.shots(row.task_id)]
    openings = sum(
        _opens_valve(timed.command) for process in read_truth(truth).processes for timed in process.commands
    )
    never_opened = [shot for shot in shots if shot.result is not None and shot.result.outcome is Outcome.NOT_OPENED]
    killed_before = sum(shot.result is None or "outcome" in shot.result.reason for shot in shots)
    assert openings <= len(shots) - len(never_opened) <= openings + killed_before
    return openings, killed_before


def _comes_up_disarmed(config: Path, out: Path) -> None:
    """Started again it opens nothing, and books what was left open as its full pulse."""
    ledger_ml, dangling = _ledger_ml(out)
    again = begin(config, out, "--summary", str(out / "summary.json"), "--speed", SPEED)
    told = wait_for_message(again, "up, disarmed, waiting")
    again.send_signal(signal.SIGTERM)
    code, errors = finish(again)
    assert code == 0, told + errors
    summary = load(out / "summary.json")
    assert summary["mode"] == "disarmed"
    assert len(summary["dangling"]) == dangling
    assert (told + errors).count("booked as its full pulse") == dangling
    second = read_truth(out / "truth.jsonl").processes[-1]
    assert not any(_opens_valve(timed.command) for timed in second.commands)
    assert _ledger_ml(out) == (pytest.approx(ledger_ml), 0)


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_stop_signal_shuts_the_valve_at_once_and_books_every_shot(moment, tmp_path):
    config, truth = short_row(tmp_path), tmp_path / "truth.jsonl"
    code, errors = _begin_and_strike(config, tmp_path, moment, signal.SIGTERM, "--start")
    assert code == 0, errors

    after = run_on(truth)
    assert after.after_ml == pytest.approx(0.0, abs=1e-9)
    assert not any(after.coils.values())
    ledger_ml, dangling = _ledger_ml(tmp_path)
    assert dangling == 0
    assert ledger_ml >= after.total_ml - 1e-6
    assert ledger_ml <= after.total_ml * 1.05 + 0.4
