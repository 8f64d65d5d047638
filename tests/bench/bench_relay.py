"""How long the relay board's bus takes from a command to the coil, and from a stop to the last frame that shuts."""

from __future__ import annotations

import asyncio
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

from drivers.emulation.reference_bus import ReferenceBus
from drivers.line import PortSettings
from drivers.modbus_framing import SHORTEST_SILENCE_S, SILENT_CHARACTERS
from drivers.modbus_master import ModbusMaster
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from drivers.twin import TruthLog
from tests.bench.lines import Say, say
from tests.drivers.twin import rig

BAUDS = (9600, 115200)
REPEATS = 25
QUEUED = 12
WIRED = {Channel.VALVE: 1, Channel.PUMP: 2}
FLASH_BYTES, READ_BYTES, READ_ANSWER_BYTES, ALL_OFF_BYTES = 8, 8, 6, 10


def measured(baud: int, folder: Path) -> tuple[list[float], list[float]]:
    """Seconds from the call to the closed coil, and from the stop to the open one with a full queue."""
    file = folder / f"truth-{baud}.jsonl"
    truth = TruthLog(file)
    pulsed_s: list[float] = []
    stopped_s: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        zero_s = loop.time()

        def clock() -> float:
            return loop.time() - zero_s

        bus = ReferenceBus(rig.twin(truth=truth), clock, baud=baud, wired=WIRED)
        bus.wire.plug()
        port = SerialPort(PortSettings(bus.wire.path, "relay", baud, "modbus"), clock)
        relay = ModbusRelay(RelaySettings("waveshare-8", 1, WIRED, lease_s=10.0), ModbusMaster(port), clock)
        await relay.open()
        for repeat in range(REPEATS):
            await asyncio.sleep(0.013)
            pulsed_s.append(clock())
            await relay.pulse(Channel.VALVE, 5.0)
            queue = [asyncio.ensure_future(relay.read()) for _ in range(QUEUED)]
            await asyncio.sleep(0.005 + 0.001 * (repeat % 17))
            stopped_s.append(clock())
            await relay.all_off()
            assert not queue[-1].done()
            for job in queue:
                job.cancel()
            await asyncio.gather(*queue, return_exceptions=True)
            await port.run(lambda line: None)
        await relay.close()
        bus.wire.unplug()

    asyncio.run(main())
    truth.close()
    events = [event for event in map(json.loads, file.read_text().splitlines()) if event.get("kind") == "event"]

    def waited_s(what: str, since_s: list[float]) -> list[float]:
        at_s = [event["t"] for event in events if event["what"] == what and event["channel"] == "valve"]
        return [after - before for before, after in zip(since_s, at_s, strict=True)]

    return waited_s("coil_on", pulsed_s), waited_s("coil_off", stopped_s)


def bench(line: Say) -> None:
    """One line a figure, through ``line(name, figures, goal)``."""
    with tempfile.TemporaryDirectory() as folder:
        for baud in BAUDS:
            byte_s = 10.0 / baud
            silence_s = max(SILENT_CHARACTERS * byte_s, SHORTEST_SILENCE_S)
            pulses_s, stops_s = measured(baud, Path(folder))
            under_way_s = (READ_BYTES + READ_ANSWER_BYTES) * byte_s + silence_s
            _tell(line, f"relay: pulse to coil, {baud}", pulses_s, FLASH_BYTES * byte_s)
            _tell(
                line, f"relay: stop to last OFF, full queue, {baud}", stops_s,
                under_way_s + silence_s + ALL_OFF_BYTES * byte_s,
            )  # fmt: skip


def _tell(line: Say, name: str, took_s: list[float], limit_s: float) -> None:
    median_s, worst_s = statistics.median(took_s), max(took_s)
    figures = f"median {1e3 * median_s:6.2f} ms   worst {1e3 * worst_s:6.2f} ms   wire {1e3 * limit_s:6.2f} ms"
    line(name, figures, "<= 150 ms" if "stop" in name else "")


def main() -> None:
    began_s = time.monotonic()
    bench(say)
    sys.stdout.write(f"{time.monotonic() - began_s:.0f} s\n")


if __name__ == "__main__":
    main()
