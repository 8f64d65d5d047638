"""One device after another, as its section of the configuration says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import assert_never

from drivers.arm.control_tables import OperatingMode
from drivers.arm.dynamixel import DynamixelArm
from drivers.arm.interface import Arm
from drivers.arm.joints import DynamixelSettings
from drivers.arm.mock import MockArm
from drivers.camera.controls import Control, GainScale
from drivers.camera.depthai import DepthAiCamera, DepthAiSettings
from drivers.camera.files import FilesCamera, FilesSettings
from drivers.camera.interface import StereoCamera
from drivers.camera.mock import MockCamera
from drivers.camera.stereo_usb import StereoUsb
from drivers.camera.stereo_usb_settings import StereoUsbSettings
from drivers.gps.corrected import CorrectedGps
from drivers.gps.interface import Gps
from drivers.gps.mock import MockGps
from drivers.gps.nmea import NmeaGps, NmeaSettings
from drivers.gps.ntrip import NtripSettings
from drivers.inputs.interface import Inputs
from drivers.inputs.mock import MockInputs
from drivers.inputs.modbus import ModbusInputs
from drivers.line import PortSettings
from drivers.modem.gsm import GsmModem
from drivers.modem.gsm_settings import GsmSettings
from drivers.modem.interface import Modem
from drivers.modem.mock import MockModem
from drivers.relay.interface import RelayBoard
from drivers.relay.mock import MockRelay
from drivers.relay.modbus import ModbusRelay, RelaySettings
from drivers.relay.values import Channel
from drivers.twin.machine import Twin
from drivers.wheels.interface import Wheels
from drivers.wheels.mock import MockWheels
from drivers.wheels.zlac8015d import Zlac8015dWheels
from drivers.wheels.zlac_settings import Zlac8015dSettings
from robot.aiming import ArmModel
from robot.config import Config
from robot.config.devices import (
    DepthAiCameraSection,
    DynamixelArmSection,
    FilesCameraSection,
    GsmModemSection,
    MockArmSection,
    MockCameraSection,
    MockGpsSection,
    MockInputsSection,
    MockModemSection,
    MockRelaySection,
    MockWheelsSection,
    ModbusInputsSection,
    ModbusRelaySection,
    NmeaGpsSection,
    StereoUsbCameraSection,
    Zlac8015dWheelsSection,
)
from robot.errors import ConfigError
from robot.runtime.device_settings import inputs_settings, servo_joints
from robot.runtime.ports import Ports


class Workshop:
    """Builds devices, opens none. ``ConfigError`` names the section whose settings a driver cannot keep."""

    def __init__(
        self, config: Config, arm_model: ArmModel, twin: Twin | None, clock: Callable[[], float], ports: Ports
    ) -> None:
        self._config, self._arm_model, self._clock, self._ports = config, arm_model, clock, ports
        self._simulated = twin

    @property
    def _twin(self) -> Twin:
        assert self._simulated is not None  # made whenever a section names a mock
        return self._simulated

    def relay(self) -> RelayBoard:
        match self._config.relay:
            case MockRelaySection():
                return MockRelay(self._twin, self._clock)
            case ModbusRelaySection() as section:
                with _settings_of("relay"):
                    settings = RelaySettings(
                        profile=section.profile,
                        unit_id=section.unit,
                        channels={Channel(name): number for name, number in section.channels.wired.items()},
                        lease_s=section.lease_s,
                        watchdog_s=section.watchdog_s,
                        reply_timeout_s=section.timeout_s,
                    )
                port = PortSettings(section.port, "relay", section.baud, "modbus", section.parity, section.stop_bits)
                return ModbusRelay(settings, self._ports.modbus(port, section.timeout_s), self._clock)
            case _ as never:
                assert_never(never)

    def wheels(self) -> Wheels:
        match self._config.wheels:
            case MockWheelsSection():
                return MockWheels(self._twin, self._clock)
            case Zlac8015dWheelsSection() as section:
                with _settings_of("wheels"):
                    settings = Zlac8015dSettings(
                        radius_m=section.radius_m,
                        track_m=section.track_m,
                        max_speed_m_s=section.max_speed_m_s,
                        max_acceleration_m_s2=section.max_acceleration_m_s2,
                        unit_id=section.unit,
                        counts_per_turn=section.counts_per_turn,
                        command_timeout_s=section.command_timeout_s,
                        max_deceleration_m_s2=section.max_deceleration_m_s2,
                        left_mirrored=section.left_mirrored,
                        right_mirrored=section.right_mirrored,
                        swapped=section.swapped,
                    )
                port = PortSettings(section.port, "wheels", section.baud, "modbus")
                return Zlac8015dWheels(settings, self._ports.modbus(port, section.timeout_s), self._clock)
            case _ as never:
                assert_never(never)

    def gps(self) -> Gps:
        match self._config.gps:
            case MockGpsSection():
                return MockGps(self._twin, self._clock)
            case NmeaGpsSection() as section:
                port = self._ports.alone(PortSettings(section.port, "gps", section.baud, "nmea"))
                settings = NmeaSettings(output_delay_s=section.delay_s)
                receiver = NmeaGps(settings, port, self._clock, self._ports.trace_of(port))
                if section.ntrip is None:
                    return receiver
                with _settings_of("gps.ntrip"):
                    ntrip = NtripSettings(
                        host=section.ntrip.host,
                        mountpoint=section.ntrip.mountpoint,
                        port=section.ntrip.port,
                        user=section.ntrip.user,
                        password=section.ntrip.password.get_secret_value(),
                        tls=section.ntrip.tls,
                        tls_ca_file=Path(section.ntrip.tls_ca_file) if section.ntrip.tls_ca_file else None,
                        gga_every_s=section.ntrip.gga_every_s,
                        timeout_s=section.ntrip.timeout_s,
                    )
                return CorrectedGps(receiver, ntrip, self._clock)
            case _ as never:
                assert_never(never)

    def modem(self) -> Modem:
        match self._config.modem:
            case MockModemSection():
                return MockModem(self._twin, self._clock)
            case GsmModemSection() as section:
                with _settings_of("modem"):
                    settings = GsmSettings(
                        pin=section.pin.get_secret_value() if section.pin else None,
                        storage=section.storage,
                        delivery_reports=section.delivery_reports,
                    )
                port = self._ports.alone(PortSettings(section.port, "modem", section.baud, "at"))
                return GsmModem.on_port(settings, port, self._clock, trace=self._ports.trace_of(port))
            case _ as never:
                assert_never(never)

    def camera(self) -> StereoCamera:
        match self._config.camera:
            case MockCameraSection():
                return MockCamera(self._twin, self._clock)
            case StereoUsbCameraSection() as section:
                places = (section.device,) if section.right_device is None else (section.device, section.right_device)
                with _settings_of("camera"):
                    settings = StereoUsbSettings(
                        places=places,
                        image_size=section.image_size_px,
                        exposure_s=section.exposure_s,
                        gain=section.gain,
                        pixel_format=section.format,
                        rate_hz=section.rate_hz,
                        white_balance_k=section.white_balance_k,
                        power_line_hz=section.power_line_hz or None,
                        latency_s=section.latency_s,
                        frame_timeout_s=section.frame_timeout_s,
                        swapped=section.swapped,
                        gain_scale=GainScale(
                            section.gain_units.kind, section.gain_units.unity, section.gain_units.units
                        ),
                        in_flight_frames=section.in_flight_frames,
                        controlled=section.controlled,
                        may_differ=frozenset(Control(name) for name in section.may_differ),
                    )
                return StereoUsb(settings, self._clock)
            case DepthAiCameraSection() as section:
                oak = DepthAiSettings(
                    image_size=section.image_size_px,
                    exposure_s=section.exposure_s,
                    gain=section.gain,
                    rate_hz=section.rate_hz,
                    device_id=section.device_id,
                    white_balance_k=section.white_balance_k,
                )
                return DepthAiCamera(oak, self._clock)
            case FilesCameraSection() as section:
                recording = FilesSettings(
                    source=Path(section.source),
                    image_size=section.image_size_px,
                    exposure_s=section.exposure_s,
                    gain=section.gain,
                    rate_hz=section.rate_hz,
                    loops=section.loop,
                )
                return FilesCamera(recording, self._clock)
            case _ as never:
                assert_never(never)

    def inputs(self) -> Inputs:
        match self._config.inputs:
            case MockInputsSection():
                return MockInputs(self._twin, self._clock)
            case ModbusInputsSection() as section:
                with _settings_of("inputs"):
                    settings = inputs_settings(section, self._config.fluid)
                port = PortSettings(section.port, "inputs", section.baud, "modbus", section.parity, section.stop_bits)
                return ModbusInputs(settings, self._ports.modbus(port, section.timeout_s), self._clock)
            case _ as never:
                assert_never(never)

    def arm(self) -> Arm:
        match self._config.arm:
            case MockArmSection():
                return MockArm(self._twin, self._clock)
            case DynamixelArmSection() as section:
                with _settings_of("arm"):
                    settings = DynamixelSettings(
                        joints=servo_joints(section, self._arm_model),
                        max_velocity_rad_s=section.max_velocity_rad_s,
                        max_acceleration_rad_s2=section.max_acceleration_rad_s2,
                        operating_mode=OperatingMode[section.operating_mode.upper()],
                        watchdog_s=section.watchdog_s,
                        torque_on_close=section.torque_on_close,
                        fast_sync_read=section.fast_sync_read,
                        writes_return_delay=section.writes_return_delay,
                        minimum_firmware=section.minimum_firmware,
                    )
                port = PortSettings(section.port, "arm", section.baud, "dynamixel")
                return DynamixelArm(settings, self._ports.serial(port), self._clock)
            case _ as never:
                assert_never(never)


@contextmanager
def _settings_of(section: str) -> Iterator[None]:
    """What a driver refuses of its settings, as an error of the configuration."""
    try:
        yield
    except ValueError as error:
        raise ConfigError(f"[{section}] {error}") from error
