"""The relay boards that are known.

Sources: Waveshare wiki, Modbus_RTU_Relay (protocol V2 and later); LC Technology, manual of the 8-channel Modbus board;
eletechsup, manual and a public hardware test of R4D8A08 and RYN408F; Wiren Board wiki, Relay_Module_Modbus_Management.
"""

from __future__ import annotations

from drivers import modbus_pdu as pdu
from drivers.modbus_probe import Probe
from drivers.relay.board_profile import BoardProfile, ChannelWrite, PowerOn, PulseTimer, ReadBack, Watchdog, Write

_COIL_ON = ChannelWrite(pdu.WRITE_COIL, 0, (pdu.COIL_ON,))
_COIL_OFF = ChannelWrite(pdu.WRITE_COIL, 0, (pdu.COIL_OFF,))
_COILS = ReadBack(pdu.READ_COILS, 0)

# R4D8A08 and its kin: a register a channel, whose high byte is the command and whose low byte its seconds.
_ON, _DELAY, _ALL_OFF = 0x0100, 0x0600, 0x0800


def _coils(count: int) -> Probe:
    return Probe(f"{count} coils", pdu.READ_COILS, 0, count)


def _no_coils(count: int) -> Write:
    return Write(pdu.WRITE_COILS, 0, (0,) * count)


def _waveshare(name: str, title: str, channels: int) -> BoardProfile:
    return BoardProfile(
        name=name,
        title=title,
        channels=channels,
        probes=(
            Probe("its own unit id", pdu.READ_HOLDING, 0x4000, own_id=True),
            Probe("its software version times 100", pdu.READ_HOLDING, 0x8000, low=100, high=9999),
            _coils(channels),
        ),
        on=_COIL_ON,
        cancel=_COIL_OFF,
        clear=_no_coils(channels),
        read=_COILS,
        pulse=PulseTimer(ChannelWrite(pdu.WRITE_COIL, 0x0200, (0,)), quantum_s=0.1, most=0x7FFF),
    )


def _by_register(name: str, title: str, first: int, probes: tuple[Probe, ...]) -> BoardProfile:
    """Neither off nor all-off stops a running delay on these boards; a delay of 0 s does."""
    return BoardProfile(
        name=name,
        title=title,
        channels=8,
        probes=probes,
        on=ChannelWrite(pdu.WRITE_REGISTER, first, (_ON,)),
        cancel=ChannelWrite(pdu.WRITE_REGISTER, first, (_DELAY,)),
        clear=Write(pdu.WRITE_REGISTER, 0, (_ALL_OFF,)),
        read=ReadBack(pdu.READ_HOLDING, first),
        pulse=PulseTimer(ChannelWrite(pdu.WRITE_REGISTER, first, (_DELAY,)), quantum_s=1.0, most=255),
        clear_stops_timers=False,
        off_first=True,
    )


_WAVESHARE_8 = _waveshare("waveshare-8", "Waveshare Modbus RTU Relay", 8)
_WAVESHARE_POE_8 = _waveshare("waveshare-poe-8", "Waveshare Modbus POE ETH Relay", 8)
_WAVESHARE_16 = _waveshare("waveshare-16", "Waveshare Modbus RTU Relay 16CH", 16)
_WAVESHARE_32 = _waveshare("waveshare-32", "Waveshare Modbus RTU Relay 32CH", 32)

_LC_8 = BoardProfile(
    name="lc-8",
    title="LC Technology 8-channel Modbus relay board",
    channels=8,
    probes=(
        Probe("its own unit id", pdu.READ_HOLDING, 0, own_id=True),
        Probe("8 inputs", pdu.READ_DISCRETE_INPUTS, 0, 8),
        _coils(8),
    ),
    on=_COIL_ON,
    cancel=_COIL_OFF,
    clear=_no_coils(8),
    read=_COILS,
    pulse=PulseTimer(ChannelWrite(pdu.WRITE_REGISTERS, 3, (0x0002, 0), stride=5, timed=1), quantum_s=0.1, most=0x7FFF),
)

_R4D8A08 = _by_register(
    "r4d8a08",
    "R4D8A08 relay board",
    1,
    (
        Probe("8 relay states of 0 or 1", pdu.READ_HOLDING, 1, 8, high=1),
        Probe("coils, as its kin with other addresses have them", pdu.READ_COILS, 0, 8, absent=True),
    ),
)

_RYN408F = _by_register(
    "ryn408f",
    "RYN408F relay board",
    0,
    (
        Probe("its own unit id", pdu.READ_HOLDING, 0x00FD, own_id=True),
        Probe("8 relay states of 0 or 1", pdu.READ_HOLDING, 0, 8, high=1),
    ),
)

_WB_MR6 = BoardProfile(
    name="wb-mr6",
    title="Wiren Board WB-MR6 relay module",
    channels=6,
    probes=(
        Probe("its model", pdu.READ_HOLDING, 200, 6, text="MR6"),
        Probe("its own unit id", pdu.READ_HOLDING, 128, own_id=True),
        _coils(6),
    ),
    on=_COIL_ON,
    cancel=_COIL_OFF,
    clear=_no_coils(6),
    read=_COILS,
    watchdog=Watchdog(8, unit_s=1.0, most=65534),
    power_on=PowerOn(6, off=0),
)

_GENERIC_COILS = BoardProfile(
    name="generic-coils",
    title="board with 8 plain coils",
    channels=8,
    probes=(_coils(8),),
    on=_COIL_ON,
    cancel=_COIL_OFF,
    clear=_no_coils(8),
    read=_COILS,
)

PROFILES: dict[str, BoardProfile] = {
    profile.name: profile
    for profile in (
        _WAVESHARE_8,
        _WAVESHARE_POE_8,
        _WAVESHARE_16,
        _WAVESHARE_32,
        _LC_8,
        _R4D8A08,
        _RYN408F,
        _WB_MR6,
        _GENERIC_COILS,
    )
}


def profile_named(name: str) -> BoardProfile:
    """Raises ``ValueError`` that lists the known ones."""
    if name not in PROFILES:
        raise ValueError(f"relay: unknown board profile {name!r}; known are {', '.join(PROFILES)}")
    return PROFILES[name]
