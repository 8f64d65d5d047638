"""How long a text takes through the GSM driver and the wire, with what the network takes shown apart."""

from __future__ import annotations

import asyncio
import statistics
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime

from drivers.emulation.bad_line import BadLine
from drivers.emulation.wire import PtyWire
from drivers.line import PortSettings
from drivers.modem.emulated_sim import EmulatedSim
from drivers.modem.emulator import ModemEmulator
from drivers.modem.gsm import GsmModem
from drivers.modem.gsm_settings import GsmSettings
from drivers.modem.pdu import Deliver, encode_deliver
from drivers.twin import commands as c
from tests.bench.lines import Say, say
from tests.drivers.twin import rig

BAUDS = (9600, 115_200)
REPEATS = 5
SENDING_S = 1.0
WORKER = "+4915112345678"
TEXT = "row 3 done: 41 fruit, 190 ml, 2 refused"


@dataclass
class Took:
    """Seconds of each repeat, and the bytes that they cost on the wire."""

    seconds: list[float] = field(default_factory=list)
    bytes_: list[int] = field(default_factory=list)


async def measured(baud: int) -> tuple[Took, Took, Took]:
    """From ``send`` to its return without the network's time; from ``+CMTI`` to the text handed over; a status."""
    loop = asyncio.get_running_loop()
    zero_s = loop.time()

    def clock() -> float:
        return loop.time() - zero_s

    twin = rig.twin()
    emulator = ModemEmulator(twin, clock, sending_s=SENDING_S)
    wire = PtyWire(baud, emulator.receive)
    emulator.connect(BadLine("modem", twin, clock, wire.send, wire.byte_s))
    wire.plug()
    serving = loop.create_task(emulator.serve())
    device = GsmModem.on_port(GsmSettings(), PortSettings(wire.path, "modem", baud, "at"), clock)
    await device.open()
    told_s: list[float] = []
    notify = emulator.notify

    told = asyncio.Event()

    def notified(line: str) -> None:
        told_s.append(clock())
        told.set()
        notify(line)

    emulator.notify = notified  # type: ignore[method-assign]
    sent, received, asked = Took(), Took(), Took()

    def on_wire() -> int:
        return device.port.statistics.bytes_in + device.port.statistics.bytes_out

    for number in range(REPEATS):
        await asyncio.sleep(0.3)
        begun_s, before = clock(), on_wire()
        await device.send(WORKER, TEXT)
        sent.seconds.append(clock() - begun_s - SENDING_S)
        sent.bytes_.append(on_wire() - before)

        begun_s, before = clock(), on_wire()
        await device.status()
        asked.seconds.append(clock() - begun_s)
        asked.bytes_.append(on_wire() - before)

        twin.apply(clock(), c.WorldText(WORKER, f"STATUS? {number}"))
        await told.wait()
        told.clear()
        while not await device.receive():
            pass
        received.seconds.append(clock() - told_s[number])
        listing = listing_of(f"STATUS? {number}", twin.nominal.start_utc)
        received.bytes_.append(len(b'\r\n+CMTI: "SM",1\r\n' + b"AT+CMGL=4\r" + listing))
    await device.close()
    serving.cancel()
    with suppress(asyncio.CancelledError):
        await serving
    wire.unplug()
    return sent, received, asked


def listing_of(text: str, sent_utc: datetime) -> bytes:
    """What the modem says when it is asked for its store with this text alone."""
    pdu, octets = encode_deliver(Deliver(WORKER, text, sent_utc, smsc=EmulatedSim().smsc))
    return f"\r\n+CMGL: 1,0,,{octets}\r\n{pdu}\r\n\r\nOK\r\n".encode()


def bench(line: Say) -> None:
    for baud in BAUDS:
        sent, received, asked = asyncio.run(measured(baud))
        for name, took in (("send to +CMGS", sent), ("+CMTI to handed over", received), ("status", asked)):
            median_s, worst_s = statistics.median(took.seconds), max(took.seconds)
            wire_s = statistics.median(took.bytes_) * 10.0 / baud
            network = f"   network {SENDING_S:.1f} s apart" if took is sent else ""
            figures = f"median {1e3 * median_s:6.0f} ms   worst {1e3 * worst_s:6.0f} ms   wire {1e3 * wire_s:6.1f} ms"
            line(f"modem: {name}, {baud}", figures + network, "")


def main() -> None:
    began_s = time.monotonic()
    bench(say)
    sys.stdout.write(f"{time.monotonic() - began_s:.0f} s\n")


if __name__ == "__main__":
    main()
