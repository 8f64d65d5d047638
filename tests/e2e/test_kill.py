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

from .rover_process import begin, finish, load, short_row, wait_for_line, wait_for_message

SPEED = "14"
VALVE_LAG_S = 0.06  # closing latency and its deviation, on top of the board's timer
QUICK = 4
MOMENTS = [pytest.param(n, marks=[pytest.mark.long] if n >= QUICK else []) for n in range(20)]
OPENING = '"device":"relay","verb":"pulse","args":{"channel":"valve"'


def _strike(process, truth: Path, moment: int, number: signal.Signals) -> None:
    """Send the signal at a random moment: every second time while a shot is under way."""
    dice = random.Random(moment)
    if moment % 2:
        wait_for_line(process, truth, OPENING, count=dice.randint(1, 3))
        time.sleep(dice.uniform(0.0, 0.08))
    else:
        wait_for_line(process, truth, '"kind":"view"')
        time.sleep(dice.uniform(0.0, 1.5))
    process.send_signal(number)


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


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_kill_leaves_the_valve_shut_within_the_pulse_and_no_millilitre_unbooked(moment, tmp_path):
    config, truth = short_row(tmp_path), tmp_path / "truth.jsonl"
    process = begin(config, tmp_path, "--start", "--speed", SPEED)
    _strike(process, truth, moment, signal.SIGKILL)
    finish(process)

    after = run_on(truth)
    assert after.longest_opening_s <= _longest_pulse_s(truth) + VALVE_LAG_S
    assert not any(on for channel, on in after.coils.items() if channel.value in ("valve", "pump"))
    ledger_ml, dangling = _ledger_ml(tmp_path)
    assert ledger_ml >= after.total_ml - 1e-6

    again = begin(config, tmp_path, "--summary", str(tmp_path / "summary.json"), "--speed", SPEED)
    told = wait_for_message(again, "up, disarmed, waiting")
    again.send_signal(signal.SIGTERM)
    code, errors = finish(again)
    assert code == 0, told + errors
    summary = load(tmp_path / "summary.json")
    assert summary["mode"] == "disarmed"
    assert len(summary["dangling"]) == dangling
    assert (told + errors).count("booked as its full pulse") == dangling
    second = read_truth(truth).processes[-1]
    assert not any(_opens_valve(timed.command) for timed in second.commands)
    assert _ledger_ml(tmp_path) == (pytest.approx(ledger_ml), 0)


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_stop_signal_shuts_the_valve_at_once_and_books_every_shot(moment, tmp_path):
    config, truth = short_row(tmp_path), tmp_path / "truth.jsonl"
    process = begin(config, tmp_path, "--start", "--speed", SPEED)
    _strike(process, truth, moment, signal.SIGTERM)
    code, errors = finish(process)
    assert code == 0, errors

    after = run_on(truth)
    assert after.after_ml == pytest.approx(0.0, abs=1e-9)
    assert not any(after.coils.values())
    ledger_ml, dangling = _ledger_ml(tmp_path)
    assert dangling == 0
    assert ledger_ml >= after.total_ml - 1e-6
    assert ledger_ml <= after.total_ml * 1.05 + 0.4
