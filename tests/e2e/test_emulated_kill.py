"""SIGKILL at random moments of a row over real bytes; the machine lives on, the robot is started again and goes on.

The emulated rover is a process of its own with the clock of the robot's, so that openings and intents can be matched.
A rover serves until its row is done; then comes the next one. Figures are printed (``-s``).
"""

from __future__ import annotations

import json
import os
import random
import select
import signal
import statistics
import subprocess
import sys
import time
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers.relay.values import Channel
from drivers.twin.aftermath import run_on
from drivers.twin.commands import RelayPulse
from drivers.twin.truth_record import ProcessTruth, read_truth
from robot.ledger import LedgerReader, ShotRow
from robot.runtime import ledger_path

from .conftest import EYES
from .emulated import Emulated, emulator

BATCHES = int(os.environ.get("SPRAYER_KILL_BATCHES", "10"))
KILLS = int(os.environ.get("SPRAYER_KILLS", "50"))  # in a batch
VALVE_LAG_S = 0.1  # closing latency and its deviation, and the emulator's own lateness
READY_S = 5.0  # the goal, for half of the starts
BUSY = 3.0  # as much longer may it take on a computer that has other things to do
LONGEST_S = 60.0
IN_VAIN = 5  # starts one after another that end by themselves
AT_REST_S = 3.0  # after the last kill: longer than any pulse
METER = 0.05  # what is booked over what left the nozzle, as a share, by the meter's tolerance
METER_ML = 0.4  # and for each shot


@dataclass
class Row:
    """One emulated rover, and what happened on it."""

    folder: Path
    zero_s: float
    seed: int
    kills_s: list[float] = field(default_factory=list)
    ready_s: list[float] = field(default_factory=list)
    ends: list[str] = field(default_factory=list)

    @property
    def truth(self) -> Path:
        return self.folder / "truth.jsonl"

    def now_s(self) -> float:
        return time.monotonic() - self.zero_s


class Host:
    """A robot, from its start to its end."""

    def __init__(self, row: Row, rover: Emulated, mode: str) -> None:
        self._began_s = time.monotonic()
        self._said = b""
        command = [sys.executable, "-m", "tests.e2e.killed_host", str(row.folder / "out"), json.dumps(rover.ports)]
        env = {name: value for name, value in os.environ.items() if name not in EYES}  # the trained detector: it sprays
        with (row.folder / "errors").open("a") as errors:
            self.process = subprocess.Popen(
                [*command, repr(row.zero_s), mode], stdout=subprocess.PIPE, stderr=errors, env=env,
                cwd=Path(__file__).parents[2],
            )  # fmt: skip

    def wait_for(self, words: str, longest_s: float = LONGEST_S) -> float | None:
        """Seconds from the start until it says ``words``; None when it ends, or does not in time."""
        assert self.process.stdout is not None
        descriptor = self.process.stdout.fileno()
        end_s = time.monotonic() + longest_s
        while words.encode() not in self._said:
            left_s = end_s - time.monotonic()
            if left_s <= 0.0 or not select.select([descriptor], [], [], left_s)[0]:
                return None
            data = os.read(descriptor, 4096)
            if not data:
                return None
            self._said += data
        return time.monotonic() - self._began_s

    def kill(self) -> bool:
        """Whether it was alive to be killed."""
        alive = self.process.poll() is None
        self.process.kill()
        self._drain()
        return alive

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        self._drain()
        return self.process.returncode

    def _drain(self) -> None:
        out, _ = self.process.communicate(timeout=LONGEST_S)
        self._said += out

    @property
    def said(self) -> str:
        return self._said.decode()


class Openings:
    """Counts what is added to a truth file: the valve's openings."""

    _MARK = b'"device":"relay","verb":"pulse","args":{"channel":"valve"'

    def __init__(self, truth: Path) -> None:
        self._truth, self._read_bytes = truth, 0
        self._rest = b""

    def new(self) -> int:
        """How many since the last call."""
        with self._truth.open("rb") as file:
            file.seek(self._read_bytes)
            data = file.read()
        self._read_bytes += len(data)
        data = self._rest + data
        whole, _, self._rest = data.rpartition(b"\n")
        return whole.count(self._MARK)


def strike(host: Host, row: Row, openings: Openings, dice: random.Random) -> None:
    """Wait for a random moment: of coming up, of the row, or of a shot."""
    openings.new()
    what = dice.random()
    if what < 0.2:
        host.wait_for("ended", dice.uniform(0.0, 3.0))
        return
    ready_s = host.wait_for("up")
    if ready_s is None:
        return
    row.ready_s.append(ready_s)
    host.wait_for("armed")
    if what < 0.5:
        host.wait_for("ended", dice.uniform(0.0, 8.0))
        return
    end_s = time.monotonic() + 12.0
    while not openings.new() and time.monotonic() < end_s and host.process.poll() is None:
        time.sleep(0.002)
    time.sleep(dice.uniform(0.0, 0.25))


def kill_on_row(row: Row, kills: int, dice: random.Random) -> int:
    """Kill and start again until the row is done or ``kills`` are; how many there were."""
    row.folder.mkdir(parents=True)
    arguments = ("--truth", str(row.truth), "--zero", repr(row.zero_s), "--seed", str(row.seed))
    with emulator(*arguments) as rover:
        openings, in_vain = Openings(row.truth), 0
        while len(row.kills_s) < kills:
            host = Host(row, rover, "resume" if _has_task(row) else "begin")
            strike(host, row, openings, dice)
            at_s = row.now_s()
            in_vain += 1
            if host.kill():
                row.kills_s.append(at_s)
                in_vain = 0
            elif "ended done" in host.said:
                break
            else:  # a busy computer is late for its devices: that is a safe stop of its own, and begun anew
                row.ends.append(host.said.strip().rpartition("\n")[2] or f"exit code {host.process.returncode}")
                assert in_vain < IN_VAIN, (row.ends, (row.folder / "errors").read_text())
        come_up_and_wait(row, rover)
    return len(row.kills_s)


def come_up_and_wait(row: Row, rover: Emulated) -> None:
    """A last start, disarmed, in which the open intents are booked and everything comes to rest."""
    for _ in range(IN_VAIN):
        last = Host(row, rover, "wait")
        if last.wait_for("up") is not None:
            break
        last.kill()
    last.wait_for("ended", AT_REST_S)
    assert last.stop() == 0, (row.folder / "errors").read_text()
    assert "up" in last.said
    assert "armed" not in last.said


def _has_task(row: Row) -> bool:
    path = ledger_path(row.folder / "out")
    if not path.exists():
        return False
    with LedgerReader.open_read_only(path) as ledger:
        return ledger.latest_task() is not None


@dataclass(frozen=True)
class Opening:
    """The valve's coil from on to off, and when the board's timer would have opened it."""

    on_s: float
    off_s: float
    timer_s: float

    def holds(self, at_s: float) -> bool:
        return self.on_s < at_s < self.off_s


def openings_of(process: ProcessTruth) -> Iterator[Opening]:
    pulses = [
        timed.command for timed in process.commands
        if isinstance(timed.command, RelayPulse) and timed.command.channel is Channel.VALVE
    ]  # fmt: skip
    on_s: float | None = None
    for event in process.events:
        if event.detail.get("channel") != "valve":
            continue
        if event.what == "coil_on":
            on_s = event.t
        elif event.what == "coil_off" and on_s is not None:
            timer_s = max(pulse.at_s + pulse.duration_s for pulse in pulses if pulse.at_s <= event.t)
            yield Opening(on_s, event.t, timer_s)
            on_s = None
    assert on_s is None, "the valve is open"


def judge(row: Row) -> str:
    """Every promise about this row; a line that says what was seen."""
    after, process = run_on(row.truth), read_truth(row.truth).processes[-1]
    assert not any(after.coils.values())
    openings = list(openings_of(process))
    assert all(opening.off_s <= opening.timer_s + VALVE_LAG_S for opening in openings)
    with LedgerReader.open_read_only(ledger_path(row.folder / "out")) as ledger:
        assert ledger.dangling() == ()
        shots = [shot for task in ledger.tasks() for shot in ledger.shots(task.task_id)]
    require_one_row_an_opening(openings, shots)
    booked_ml = sum(shot.result.booked_ml for shot in shots if shot.result is not None)
    full_ml = sum(shot.intent.full_ml for shot in shots if shot.result is not None and shot.result.measured_ml is None)
    assert booked_ml >= after.total_ml - 0.01
    assert booked_ml <= after.total_ml * (1.0 + METER) + METER_ML * len(shots) + full_ml
    stayed_s = [opening.off_s - at_s for opening in openings for at_s in row.kills_s if opening.holds(at_s)]
    return (
        f"seed {row.seed}: {len(row.kills_s)} kills, {len(stayed_s)} of them with the valve open, which it stayed for "
        f"{max(stayed_s, default=0.0):.2f} s at most; {len(openings)} openings, {len(shots)} rows, "
        f"{after.total_ml:.1f} ml given, {booked_ml:.1f} ml booked; ended by itself: {row.ends or 'never'}"
    )


def require_one_row_an_opening(openings: list[Opening], shots: list[ShotRow]) -> None:
    """None lost: each opening has an intent written before it; none doubled: no two have the same one."""
    stamps_s = sorted(shot.intent.stamp_s for shot in shots)
    assert len(set(stamps_s)) == len(stamps_s)
    intents = [bisect_right(stamps_s, opening.on_s) for opening in openings]
    assert 0 not in intents
    assert len(set(intents)) == len(intents)


@pytest.mark.long
@pytest.mark.parametrize("batch", range(BATCHES))
def test_kills_leave_the_valve_shut_the_ledger_whole_and_the_robot_soon_ready(batch: int, tmp_path: Path) -> None:
    dice, done, rows = random.Random(1000 + batch), 0, []
    while done < KILLS:
        seed = dice.randrange(1, 1000)
        row = Row(tmp_path / str(len(rows)), time.monotonic(), seed)
        rows.append(row)
        done += kill_on_row(row, KILLS - done, dice)
        print(f"\n{judge(row)}")  # noqa: T201 - the measured figures
    ready_s = [seconds for row in rows for seconds in row.ready_s]
    median_s, longest_s = statistics.median(ready_s), max(ready_s)
    print(  # noqa: T201
        f"batch {batch}: {done} kills on {len(rows)} rows; from the start of the process to up and disarmed: "
        f"median {median_s:.2f} s, longest {longest_s:.2f} s, n {len(ready_s)}; goal {READY_S:g} s"
    )
    assert median_s <= BUSY * READY_S
