"""The sections of the devices: each back end has its own keys, chosen by ``backend``."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, SecretStr, model_validator

from robot.config.base import Pixels, Radians, Section, between

Baud = Annotated[int, Field(ge=1200, le=4_500_000)]
UnitId = Annotated[int, Field(ge=1, le=247)]
Place = Annotated[str, Field(min_length=1, max_length=300)]
Parity = Literal["N", "E", "O"]
MainsHz = Annotated[
    Literal[0, 50, 60], BeforeValidator(lambda value: int(value) if value in ("0", "50", "60") else value)
]


# --- camera


class _Camera(Section):
    """``exposure`` "auto": metered on the plants at every stop, within the bounds; it begins with ``exposure_s`` and
    ``gain``. "fixed": those two, always.

    ``mains_hz``: longer exposures are whole half periods of it; None: the camera's ``power_line_hz``, else 50.
    ``lamp`` "auto": lit when a good picture would need more than ``lamp_beyond_s`` of exposure (times gain) without it.
    Plants below ``dark_signal`` (linear, 1 is white at a gain of 1) with no more light to be had are too dark to trust:
    that stop is skipped, or the mission stops, as ``when_dark`` says.
    """

    calibration: str
    image_size_px: tuple[Pixels, Pixels] = (640, 480)
    exposure_s: Annotated[float, between(1e-5, 0.2)]
    gain: Annotated[float, between(1.0, 32.0)] = 1.0
    rate_hz: Annotated[float, between(0.1, 120.0)] = 15.0
    white_balance_k: Annotated[int, Field(ge=2000, le=10_000)] | None = None
    exposure: Literal["auto", "fixed"] = "auto"
    max_exposure_s: Annotated[float, between(1e-4, 0.2)] = 0.02
    max_gain: Annotated[float, between(1.0, 32.0)] = 8.0
    mains_hz: MainsHz | None = None
    lamp: Literal["off", "on", "auto"] = "off"
    lamp_beyond_s: Annotated[float, between(1e-3, 10.0)] = 0.02
    dark_signal: Annotated[float, between(1e-5, 0.06)] = 0.0015
    when_dark: Literal["skip", "stop"] = "skip"


class MockCameraSection(_Camera):
    backend: Literal["mock"]


class GainUnits(Section):
    """The camera's gain number: ``unity`` at a gain of 1; linear, or in decibels, ``units`` each. See the test card."""

    kind: Literal["linear", "decibel"] = "linear"
    unity: Annotated[float, between(-1e6, 1e6)] = 1.0
    units: Annotated[float, Field(gt=0.0, le=1e6)] = 1.0


class StereoUsbCameraSection(_Camera):
    """A UVC camera that gives both views side by side, or two of them (``device`` left, ``right_device`` right).

    A device is a path such as ``/dev/v4l/by-id/...`` or the address of an MJPEG stream (``http://...``). Controls in
    ``may_differ`` need not keep their value; without ``controlled`` a stream has the exposure that it has.
    """

    backend: Literal["stereo_usb"]
    device: Place
    right_device: Place | None = None
    format: Literal["MJPG", "YUYV"] = "MJPG"
    power_line_hz: MainsHz = 50
    latency_s: Annotated[float, between(0.0, 1.0)] = 0.03
    frame_timeout_s: Annotated[float, between(0.1, 5.0)] = 0.5
    swapped: bool = False
    gain_units: GainUnits = GainUnits()
    in_flight_frames: Annotated[int, Field(ge=1, le=20)] = 1
    controlled: bool = True
    may_differ: tuple[
        Literal[
            "auto_exposure", "exposure_s", "gain", "auto_white_balance", "white_balance_k", "power_line_hz",
            "auto_focus", "auto_rate",
        ], ...
    ] = ()  # fmt: skip


class DepthAiCameraSection(_Camera):
    """The stereo pair of an OAK camera; ``device_id`` chooses one of several."""

    backend: Literal["depthai"]
    device_id: str | None = None


class FilesCameraSection(_Camera):
    """Recorded pairs, at their own pace: a folder of ``*left*`` and ``*right*`` images, or a side-by-side video."""

    backend: Literal["files"]
    source: Place
    loop: bool = True


# --- arm


class _Arm(Section):
    urdf: str
    stow_rad: tuple[Radians, ...]
    ready_rad: tuple[Radians, ...]
    max_velocity_rad_s: Annotated[float, between(0.05, 5.0)]
    max_acceleration_rad_s2: Annotated[float, between(0.1, 40.0)]
    settle_tolerance_rad: Annotated[float, between(0.001, 0.1)] = 0.012
    settle_s: Annotated[float, between(0.02, 1.0)] = 0.1
    settle_timeout_s: Annotated[float, between(0.1, 10.0)] = 2.0


class MockArmSection(_Arm):
    backend: Literal["mock"]


class JointServos(Section):
    """The servo of a joint, or the two that share it (the second turns the other way round, ``shadow_reversed``)."""

    ids: Annotated[tuple[Annotated[int, Field(ge=0, le=252)], ...], Field(min_length=1, max_length=2)]
    model: str
    reversed: bool = False
    shadow_reversed: bool = True
    zero_tick: Annotated[int, Field(ge=0, le=4095)] = 2048


class DynamixelArmSection(_Arm):
    """Dynamixel X-series servos on one bus; ``servos`` by joint name, in any order."""

    backend: Literal["dynamixel"]
    port: Place
    baud: Baud = 1_000_000
    servos: dict[str, JointServos]
    operating_mode: Literal["position", "extended_position"] = "extended_position"
    watchdog_s: Annotated[float, between(0.2, 0.5)] = 0.3
    torque_on_close: Literal["hold", "off"] = "hold"
    fast_sync_read: bool = False
    writes_return_delay: bool = True
    minimum_firmware: Annotated[int, Field(ge=0, le=255)] | None = None


# --- relay board


RelayNumber = Annotated[int, Field(ge=1, le=32)]


class RelayChannels(Section):
    """The relay of each consumer, by the number printed on the board, from 1; what is not wired is left out."""

    valve: RelayNumber
    pump: RelayNumber
    lamp: RelayNumber | None = None
    contactor: RelayNumber | None = None
    beacon: RelayNumber | None = None

    @property
    def wired(self) -> dict[str, int]:
        """Name -> number of all that is wired."""
        return {name: number for name, number in self.model_dump().items() if number is not None}

    @model_validator(mode="after")
    def _each_its_own(self) -> Self:
        numbers = list(self.wired.values())
        if len(set(numbers)) != len(numbers):
            raise ValueError("two channels share one relay number; give each its own")
        return self


class ModbusRelaySection(Section):
    """A Modbus relay board. ``profile`` says which; ``port`` is a serial device, or ``tcp://host:port``."""

    backend: Literal["modbus"]
    port: Place
    baud: Baud = 9600
    parity: Parity = "N"
    stop_bits: Literal[1, 2] = 1
    unit: UnitId = 1
    profile: str
    channels: RelayChannels
    lease_s: Annotated[float, between(0.2, 30.0)] = 1.0
    watchdog_s: Annotated[float, between(1.0, 5.0)] = 1.0
    timeout_s: Annotated[float, between(0.02, 1.0)] = 0.1


class MockRelaySection(Section):
    backend: Literal["mock"]
    channels: RelayChannels
    pulse_quantum_s: Annotated[float, between(0.001, 1.0)]
    pulse_max_s: Annotated[float, between(0.1, 6553.5)]


# --- inputs


class MockInputsSection(Section):
    backend: Literal["mock"]


class InputModule(Section):
    """A module on the bus, by its kind."""

    kind: Literal["analog-8", "digital-8", "inclinometer"]
    unit: UnitId


class InputPoint(Section):
    """Where a quantity is read: ``raw * scale + offset``; outside ``low`` to ``high`` it is not believed.

    ``kind`` "4-20ma" is a sensor on a module that gives microamperes: 20 mA are ``full``, and a broken wire is told.
    """

    quantity: str
    unit: UnitId
    area: Literal["coils", "contacts", "holding", "input"] = "input"
    address: Annotated[int, Field(ge=0, le=0xFFFF)]
    kind: Literal["contact", "4-20ma", "u16", "i16", "u32", "u32_low_first", "f32", "f32_low_first", "counter"]
    full: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    scale: float = 1.0
    offset: float = 0.0
    low: float = float("-inf")
    high: float = float("inf")

    @model_validator(mode="after")
    def _full_for_a_current(self) -> Self:
        if (self.kind == "4-20ma") != (self.full is not None):
            raise ValueError("'full' (what 20 mA mean) belongs to kind '4-20ma' and to no other; correct it")
        return self


class ModbusInputsSection(Section):
    """Sensors on Modbus modules; they may share the relay board's port.

    Without ``modules`` and ``points`` they are wired as in the reference rig, whose pressure and battery sensors give
    20 mA at ``pressure_full_bar`` and ``battery_full_v``.
    """

    backend: Literal["modbus"]
    port: Place
    baud: Baud = 9600
    parity: Parity = "N"
    stop_bits: Literal[1, 2] = 1
    modules: tuple[InputModule, ...] = ()
    points: tuple[InputPoint, ...] = ()
    pressure_full_bar: Annotated[float, between(1.0, 100.0)] = 10.0
    battery_full_v: Annotated[float, between(5.0, 100.0)] = 40.0
    timeout_s: Annotated[float, between(0.02, 1.0)] = 0.1

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if bool(self.modules) != bool(self.points):
            raise ValueError("give modules and points together, or neither for the reference rig")
        return self


# --- position


class MockGpsSection(Section):
    backend: Literal["mock"]


class NtripSection(Section):
    """A caster of corrections for RTK. The password may come from the environment (SPRAYER_GPS__NTRIP__PASSWORD)."""

    host: Place
    port: Annotated[int, Field(ge=1, le=65535)] = 2101
    mountpoint: Place
    user: str = ""
    password: SecretStr = SecretStr("")
    tls: bool = False
    tls_ca_file: Place | None = None
    gga_every_s: Annotated[float, between(0.0, 600.0)] = 10.0
    timeout_s: Annotated[float, between(1.0, 120.0)] = 15.0


class NmeaGpsSection(Section):
    """A receiver that speaks NMEA 0183; ``delay_s`` is from the moment of a position to its first byte."""

    backend: Literal["nmea"]
    port: Place
    baud: Baud = 115_200
    delay_s: Annotated[float, between(0.0, 1.0)] = 0.06
    ntrip: NtripSection | None = None


# --- modem


class MockModemSection(Section):
    backend: Literal["mock"]


class GsmModemSection(Section):
    """A GSM modem on its AT port. The PIN may come from the environment (SPRAYER_MODEM__PIN)."""

    backend: Literal["gsm"]
    port: Place
    baud: Baud = 115_200
    pin: SecretStr | None = None
    storage: Literal["SM", "ME"] = "SM"
    delivery_reports: bool = False


# --- wheels


class _Wheels(Section):
    radius_m: Annotated[float, between(0.03, 1.0)]
    track_m: Annotated[float, between(0.1, 3.0)]
    max_speed_m_s: Annotated[float, between(0.01, 1.0)]
    max_acceleration_m_s2: Annotated[float, between(0.05, 2.0)]
    command_timeout_s: Annotated[float, between(0.1, 2.0)] = 0.5


class MockWheelsSection(_Wheels):
    backend: Literal["mock"]


class Zlac8015dWheelsSection(_Wheels):
    """Two hub motors on a ZLAC8015D controller; without ``max_deceleration_m_s2`` it brakes twice as hard."""

    backend: Literal["zlac8015d"]
    port: Place
    baud: Baud = 115_200
    unit: UnitId = 1
    counts_per_turn: Annotated[int, Field(ge=100, le=1_000_000)] = 4096
    max_deceleration_m_s2: Annotated[float, between(0.05, 4.0)] | None = None
    left_mirrored: bool = False
    right_mirrored: bool = True
    swapped: bool = False
    timeout_s: Annotated[float, between(0.02, 1.0)] = 0.1


_ByBackend = Field(discriminator="backend")

CameraSection = Annotated[
    MockCameraSection | StereoUsbCameraSection | DepthAiCameraSection | FilesCameraSection, _ByBackend
]
ArmSection = Annotated[MockArmSection | DynamixelArmSection, _ByBackend]
RelaySection = Annotated[MockRelaySection | ModbusRelaySection, _ByBackend]
InputsSection = Annotated[MockInputsSection | ModbusInputsSection, _ByBackend]
GpsSection = Annotated[MockGpsSection | NmeaGpsSection, _ByBackend]
ModemSection = Annotated[MockModemSection | GsmModemSection, _ByBackend]
WheelsSection = Annotated[MockWheelsSection | Zlac8015dWheelsSection, _ByBackend]
