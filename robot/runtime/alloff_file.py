"""The flat file from which ``sprayer-alloff`` switches everything off without the program: ports and finished frames.

Its format stands at the head of ``systemd/sprayer-alloff``, which knows no device: all that is known of one is here.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers import modbus_pdu as pdu
from drivers.line import TCP, PortSettings
from drivers.modbus_frames import with_crc
from drivers.modbus_framing import HEADER, SHORTEST_SILENCE_S, SILENT_CHARACTERS
from drivers.relay.board_profile import BoardProfile
from drivers.relay.profiles import profile_named
from drivers.relay.values import Channel
from drivers.wheels import zlac_registers as zlac
from robot.atomic_file import atomic_file
from robot.config import Config
from robot.config.devices import ModbusRelaySection, Zlac8015dWheelsSection
from robot.config.emulated import with_ports
from robot.errors import ConfigError

FILE_NAME = "alloff.conf"
SOCKET_NAME = "control.sock"
USB_PAUSE_S = 0.004  # adapters hand bytes over in lumps


@dataclass(frozen=True, slots=True)
class Exchange:
    """A request and the one answer that is right, both without unit id and checksum."""

    request: bytes
    answer: bytes


def runtime_directory(run_directory: Path) -> Path:
    """Where the service's control socket and flat file stand: systemd's runtime directory, else the run directory."""
    given = os.environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    return Path(given) if given else run_directory


def write_alloff_files(config: Config, run_directory: Path, ports: Mapping[str, str] | None = None) -> None:
    """For a life that is about to open its ports; under systemd also in the run directory, for /run is empty after a
    boot. To be called by the holder of the ledger's lock. Raises as ``write_alloff_file``.
    """
    folder = runtime_directory(run_directory)
    for place in dict.fromkeys((folder, run_directory)):
        write_alloff_file(config, place / FILE_NAME, folder / SOCKET_NAME, ports)


def write_alloff_file(config: Config, path: Path, socket: Path, ports: Mapping[str, str] | None = None) -> None:
    """Render and put in place, whole or not at all. Raises ``FileError``, and what ``render`` raises."""
    text = render(config, socket, ports)
    with atomic_file(path) as stream:
        stream.write(text.encode("utf-8"))


def render(config: Config, socket: Path, ports: Mapping[str, str] | None = None) -> str:
    """The flat file of a checked configuration. ``ports`` are those of an emulated rover, as for a run.

    ``ConfigError`` for a relay board that is not known, or a path that does not go into a line.
    """
    config = with_ports(config, ports or {})
    lines = ["sprayer-alloff 1", f"socket {_on_one_line('the control socket', str(socket.absolute()))}"]
    lines += _relay(config)
    lines += _wheels(config)
    return "\n".join([*lines, "end", ""])


def _relay(config: Config) -> Iterator[str]:
    section = config.relay
    if not isinstance(section, ModbusRelaySection):
        yield "simulated relay"
        return
    try:
        profile = profile_named(section.profile)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    port = PortSettings(section.port, "relay", section.baud, "modbus", section.parity, section.stop_bits)
    yield from _device("relay", f"{profile.title}, unit {section.unit}", port, section.timeout_s)
    wired = section.channels.wired
    first = [wired[name] for name in (Channel.VALVE, Channel.PUMP)]
    numbers = dict.fromkeys((*first, *wired.values()))
    yield from _frames(port, section.unit, off_exchanges(profile, numbers), (_read_back(profile),))


def off_exchanges(profile: BoardProfile, numbers: Iterable[int]) -> tuple[Exchange, ...]:
    """What opens every coil of a board and stops every timer, the channels ``numbers`` (from 1) before the others.

    A board whose all-off stops no timers has each channel cancelled before it; on the others the one frame for all goes
    first, and the wired channels are cancelled one by one after it.
    """
    wired = tuple(dict.fromkeys(numbers))
    if profile.clear_stops_timers:
        writes = (profile.clear, *(profile.cancel.of(number) for number in wired))
    else:
        others = (number for number in range(1, profile.channels + 1) if number not in wired)
        writes = profile.all_off((*wired, *others))
    return tuple(_write(write.request()) for write in writes)


def _read_back(profile: BoardProfile) -> Exchange:
    if profile.read.function == pdu.READ_COILS:
        return _zeros(pdu.read_bits(pdu.READ_COILS, profile.read.first, profile.channels))
    return _zeros(pdu.read_words(pdu.READ_HOLDING, profile.read.first, profile.channels))


def _wheels(config: Config) -> Iterator[str]:
    """Speed 0, which the controller brakes to by itself; read back is what it was told, not whether it stands yet."""
    section = config.wheels
    if not isinstance(section, Zlac8015dWheelsSection):
        yield "simulated wheels"
        return
    port = PortSettings(section.port, "wheels", section.baud, "modbus")
    yield from _device("wheels", f"ZLAC8015D, unit {section.unit}", port, section.timeout_s)
    target = zlac.LEFT_TARGET.address
    halt = _write(pdu.write_registers(target, [0, 0]))
    yield from _frames(port, section.unit, (halt,), (_zeros(pdu.read_words(pdu.READ_HOLDING, target, 2)),))


def _write(request: pdu.Request) -> Exchange:
    return Exchange(request.payload, request.payload[:5])  # the echo: address and value, or address and count


def _zeros(request: pdu.Request) -> Exchange:
    """A read whose answer must be nothing but zeros."""
    size = request.answer_bytes - 2
    return Exchange(request.payload, bytes([request.function, size]) + bytes(size))


def _device(name: str, about: str, port: PortSettings, answer_s: float) -> Iterator[str]:
    silence_s = max(SILENT_CHARACTERS * port.byte_s, SHORTEST_SILENCE_S) + USB_PAUSE_S
    yield f"device {name} {_on_one_line(name, about)}"
    yield f"port {_on_one_line(f'{name}.port', port.path)}"
    yield f"line {port.baud} {port.parity} {port.stop_bits}"
    yield f"wait {answer_s:g} {silence_s:.4f}"


def _frames(port: PortSettings, unit: int, off: Iterable[Exchange], check: Iterable[Exchange]) -> Iterator[str]:
    numbered = [("off", exchange) for exchange in off] + [("check", exchange) for exchange in check]
    for number, (word, exchange) in enumerate(numbered, start=1):
        request, answer = (
            _frame(port, unit, payload, number).hex() for payload in (exchange.request, exchange.answer)
        )
        yield f"{word} {request} {answer}"


def _frame(port: PortSettings, unit: int, payload: bytes, number: int) -> bytes:
    if port.path.startswith(TCP):
        return HEADER.pack(number, 0, len(payload) + 1, unit) + payload
    return with_crc(bytes([unit]) + payload)


def _on_one_line(what: str, text: str) -> str:
    if text != " ".join(text.split()) or not text.isprintable():
        raise ConfigError(f"{what}: {text!r} does not go into the all-off file; choose a path without strange signs")
    return text
