"""The event loop stands still in the middle of a shot over real bytes: F30, P21.

The machine is emulated in a process of its own, so that it goes on and its truth tells when the coils opened.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers.relay.modbus import ModbusRelay
from drivers.twin.aftermath import run_on
from drivers.twin.truth_record import read_truth
from robot.clock import RealClockLoop
from robot.commands.run import single_error
from robot.config import load_config
from robot.errors import SprayerError
from robot.ledger import LedgerReader
from robot.runtime import StopSignals, ledger_path
from robot.runtime.manual import ByHand, ManualOptions, manual
from robot.runtime.manual.liquid import LiquidByHand
from robot.safety import Mode
from robot.safety.timing import CLOSE_DEADLINE_S, LOOP_STALL_S

from .emulated import EMULATED, emulator

STALL_S = 2.0
PULSE_S = 1.4
IN_TIME_S = LOOP_STALL_S + CLOSE_DEADLINE_S
BUSY_S = 0.5  # what a busy computer may add
MOVING = ("--only", "relay", "--only", "inputs", "--only", "wheels", "--only", "arm")


@dataclass
class Session:
    """What happened, in the clock of loop and machine."""

    truth: Path
    folder: Path
    stalled_s: float = 0.0
    error: str = ""
    told: list[str] = field(default_factory=list)
    causes: tuple[str, ...] = ()
    mode: Mode | None = None
    refused: list[str] = field(default_factory=list)

    def off_s(self, channel: str) -> float:
        """From the beginning of the stall until the channel's coil went off."""
        events = read_truth(self.truth).processes[-1].events
        offs = [e.t for e in events if e.what == "coil_off" and e.detail["channel"] == channel]
        return min(t for t in offs if t > self.stalled_s) - self.stalled_s


def session(folder: Path, stall: Callable[[ByHand], None]) -> Session:
    """Pump on, a long shot; ``stall`` is called in mid-shot, in a callback of the loop."""
    folder.mkdir(exist_ok=True)
    happened = Session(folder / "truth.jsonl", folder / "out")

    async def main(ports: dict[str, str]) -> None:
        loop = asyncio.get_running_loop()
        options = ManualOptions(EMULATED, happened.folder, ports=ports)
        with StopSignals() as signals:
            async with manual(load_config(EMULATED), options, signals, happened.told.append) as hands:
                liquid = LiquidByHand(hands)
                shot = asyncio.create_task(liquid.pulse(PULSE_S))
                try:
                    await open_valve(happened.truth, shot)
                    happened.stalled_s = loop.time()
                    loop.call_soon(stall, hands)
                    loop.call_soon(lambda: asyncio.ensure_future(wants_more(hands)))
                    await asyncio.wait({shot})
                    await asyncio.sleep(10.0)  # the stop ends the session long before
                finally:
                    happened.mode, happened.causes = hands.actuation.state.mode, hands.actuation.state.causes
                    with contextlib.suppress(SprayerError):
                        await shot

    async def wants_more(hands: ByHand) -> None:
        """What the loop is asked for in the very moment it is back."""
        try:
            await hands.actuation.switch_lamp(True)
        except Exception as error:  # noqa: BLE001 - whatever refused it
            happened.refused.append(str(error))

    with asyncio.Runner(loop_factory=RealClockLoop) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, RealClockLoop)
        arguments = ("--truth", str(happened.truth), "--zero", repr(loop.zero_s), *MOVING)
        with emulator(*arguments) as rover:
            try:
                runner.run(main(rover.ports))
            except SprayerError as error:
                happened.error = str(error)
            except ExceptionGroup as group:
                error = single_error(group)
                if not isinstance(error, SprayerError):
                    raise
                happened.error = str(error)
    return happened


async def open_valve(truth: Path, shot: asyncio.Task[object]) -> None:
    while not _valve_was_open(truth):
        assert not shot.done(), f"the valve was never open: {shot}"
        await asyncio.sleep(0.02)


def _valve_was_open(truth: Path) -> bool:
    for line in truth.read_text().splitlines():
        with contextlib.suppress(ValueError):  # the last line may not be whole yet
            event = json.loads(line)
            if event.get("what") == "coil_on" and event["channel"] == "valve":
                return True
    return False


def block(hands: ByHand) -> None:
    time.sleep(STALL_S)


def block_with_the_owner_of_the_relays_port(hands: ByHand) -> None:
    relay = hands.actuation._relay  # what hangs in its port is the fault under test
    assert isinstance(relay, ModbusRelay)
    relay._bus.port.at(0.0, lambda line: time.sleep(STALL_S))
    block(hands)


@pytest.fixture(autouse=True)
def a_board_that_would_go_on_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the board's timer is what shuts in these tests."""
    monkeypatch.setenv("SPRAYER_RELAY__LEASE_S", "8.0")
    monkeypatch.setenv("SPRAYER_SAFETY__MAX_SHOT_ML", "20.0")
    monkeypatch.setenv("SPRAYER_SAFETY__MAX_TARGET_ML", "25.0")


@pytest.mark.parametrize("stall", [block, block_with_the_owner_of_the_relays_port])
def test_everything_is_off_in_time_while_the_loop_stands_and_the_machine_stays_stopped(
    stall: Callable[[ByHand], None], tmp_path: Path
) -> None:
    happened = session(tmp_path, stall)
    took_ms = {channel: round(1e3 * happened.off_s(channel)) for channel in ("valve", "pump", "contactor")}
    print(f"\nall-off after a stall, ms: {took_ms}")  # noqa: T201 - the measured figure
    assert max(took_ms.values()) < 1e3 * (IN_TIME_S + BUSY_S)
    assert happened.mode is Mode.SAFE_STOP, happened.error
    assert happened.causes[0].startswith("the event loop stalled for ")
    assert any(text.startswith("F30: the event loop stalled for 2.") for text in happened.told)
    assert len(happened.refused) == 1  # what the loop was asked for the moment it was back
    after = run_on(happened.truth)
    assert not any(after.coils.values())
    openings = [e.t for e in read_truth(happened.truth).processes[-1].events if e.what == "coil_on"]
    assert all(t < happened.stalled_s for t in openings), "something was switched on after the stop"
    with LedgerReader.open_read_only(ledger_path(happened.folder)) as ledger:
        totals = ledger.totals(ledger.latest_task())
        assert ledger.dangling() == ()
    assert totals.booked_ml >= after.total_ml - 0.01
