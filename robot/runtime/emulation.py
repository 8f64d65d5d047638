"""The whole rover behind real bytes: every emulator on one simulated machine, each at the end of its own wire."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from drivers.arm.emulator import DynamixelEmulator
from drivers.camera.darkroom import WorkerProcess
from drivers.camera.emulator import CameraEmulator
from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_slave import ModbusSlaves
from drivers.emulation.wire import PtyWire
from drivers.gps.base_station import BaseStation
from drivers.gps.caster import Caster, CasterSettings
from drivers.gps.emulator import EmulatedReceiver, GpsEmulator
from drivers.inputs.emulator import EmulatedInputs
from drivers.modem.emulated_sim import EmulatedSim
from drivers.modem.emulator import ModemEmulator
from drivers.relay.emulator import emulated_board
from drivers.relay.values import Channel
from drivers.twin.faults import FaultPlan, Verb
from drivers.twin.machine import Twin
from drivers.wheels.drive_geometry import Mounting
from drivers.wheels.emulator import Zlac8015dEmulator
from robot.aiming import ArmModel
from robot.config import Config
from robot.config.devices import (
    DynamixelArmSection,
    GsmModemSection,
    ModbusInputsSection,
    ModbusRelaySection,
    NmeaGpsSection,
    StereoUsbCameraSection,
    Zlac8015dWheelsSection,
)
from robot.errors import ConfigError
from robot.runtime.device_settings import servo_joints
from robot.runtime.devices import make_twin
from robot.runtime.settings import load_arm, load_camera, load_row

DEVICES = ("arm", "relay", "inputs", "gps", "modem", "wheels", "camera")
LOOK_S = 0.02  # how often plugs and the clock of the machine are seen to
LOOKS_A_HOST = 10  # so many looks, and dead hosts are forgotten


@asynccontextmanager
async def emulated_rover(
    config: Config, path: Path, devices: frozenset[str], plan: FaultPlan, links: Path | None, truth: Path | None,
    strict_baud: bool = False,
) -> AsyncIterator[dict[str, str]]:  # fmt: skip
    """Serve ``devices`` of the configured machine; gives their ports (device -> terminal or address).

    ``links`` is a folder for names that outlive an unplugging. The twin's clock is the running loop's. The servos
    begin without torque, as after power-on. ``strict_baud``: a host at another rate than the device's is misheard; only
    the modem finds any rate by itself.
    """
    arm_model, urdf_text = load_arm(config, path)
    twin = make_twin(config, load_row(config, path), load_camera(config, path), urdf_text, truth, plan)
    try:
        twin.warm_up()
        rover = EmulatedRover(config, arm_model, twin, asyncio.get_running_loop().time, links, strict_baud)
        try:
            ports: dict[str, str] = {}
            for device in DEVICES:
                if device in devices:
                    ports |= await rover.add(device)
            async with asyncio.TaskGroup() as group:
                lives = [group.create_task(life()) for life in rover.lives]
                try:
                    yield ports
                finally:
                    for life in lives:
                        life.cancel()
        finally:
            rover.unplug()
            for end in rover.ends:
                await end()
    finally:
        twin.close_truth()


class EmulatedRover:
    """Emulators and wires, one after another as they are asked for.

    ``lives`` are to be run as tasks, ``ends`` to be called at the end.
    """

    def __init__(
        self, config: Config, arm_model: ArmModel, twin: Twin, clock: Callable[[], float], links: Path | None,
        strict_baud: bool,
    ) -> None:  # fmt: skip
        self._config, self._arm_model, self._twin, self._clock, self._links = config, arm_model, twin, clock, links
        self._strict_baud = strict_baud
        self._wires: dict[str, PtyWire] = {}
        self._buses: dict[str, tuple[PtyWire, ModbusSlaves]] = {}
        self.lives: list[Callable[[], Coroutine[Any, Any, None]]] = [self._mind]
        self.ends: list[Callable[[], Coroutine[Any, Any, None]]] = []

    async def add(self, device: str) -> dict[str, str]:
        """Build the emulator of a device, plug it in, and say where it is (with the receiver comes its caster)."""
        builders: dict[str, Callable[[], str]] = {
            "arm": self._arm,
            "relay": self._relay,
            "inputs": self._inputs,
            "gps": self._gps,
            "modem": self._modem,
            "wheels": self._wheels,
        }
        ports = {device: await self._camera() if device == "camera" else builders[device]()}
        if device == "gps" and (caster := await self._caster()) is not None:
            ports["ntrip"] = caster
        return ports

    def unplug(self) -> None:
        for wire in self._wires.values():
            wire.unplug()

    async def _mind(self) -> None:
        """Pull and push plugs as the faults say, and let the machine go on when nobody asks it anything."""
        for look in itertools.count():
            now_s = self._clock()
            if look % LOOKS_A_HOST == 0:
                for wire in self._wires.values():
                    wire.forget_dead_host()
            pulled = {wire for name, wire in self._wires.items() if self._twin.verb(name, now_s) is Verb.UNPLUGGED}
            for wire in self._wires.values():
                if wire in pulled:  # with all that is on it
                    wire.unplug()
                else:
                    wire.plug()
            self._twin.advance(self._clock())
            await asyncio.sleep(LOOK_S)

    def _wire(self, device: str, baud: int, receive: Callable[[bytes], None], any_baud: bool = False) -> PtyWire:
        link = None if self._links is None else self._links / device
        wire = PtyWire(baud, receive, link, self._strict_baud and not any_baud)
        self._wires[device] = wire
        wire.plug()
        return wire

    def _line(self, device: str, wire: PtyWire) -> BadLine:
        return BadLine(device, self._twin, self._clock, wire.send, wire.byte_s)

    def _arm(self) -> str:
        section = self._config.arm
        if not isinstance(section, DynamixelArmSection):
            raise _no_emulator("arm", section.backend)
        joints = servo_joints(section, self._arm_model)
        emulator = DynamixelEmulator(
            self._twin, self._clock, joints, baud=section.baud, cold=True,
            host_baud=lambda: wire.host_baud if self._strict_baud else None,
        )  # fmt: skip
        wire = self._wire("arm", section.baud, emulator.receive, any_baud=True)
        emulator.connect(self._line("arm", wire))
        self.lives.append(emulator.serve)
        return wire.path

    def _relay(self) -> str:
        section = self._config.relay
        if not isinstance(section, ModbusRelaySection):
            raise _no_emulator("relay", section.backend)
        wire, slaves = self._bus_at("relay", section.port, section.baud)
        wired = {Channel(name): number for name, number in section.channels.wired.items()}
        board = emulated_board(section.profile, section.unit, self._twin, self._clock, wired)
        slaves.add(section.unit, board, self._line("relay", wire))
        return wire.path

    def _inputs(self) -> str:
        section = self._config.inputs
        if not isinstance(section, ModbusInputsSection):
            raise _no_emulator("inputs", section.backend)
        if section.points:
            raise ConfigError("inputs.points: only the reference rig has an emulator; leave points and modules out")
        wire, slaves = self._bus_at("inputs", section.port, section.baud)
        EmulatedInputs(self._twin, self._clock).join(slaves, self._line("inputs", wire))
        return wire.path

    def _wheels(self) -> str:
        section = self._config.wheels
        if not isinstance(section, Zlac8015dWheelsSection):
            raise _no_emulator("wheels", section.backend)
        wire, slaves = self._bus_at("wheels", section.port, section.baud)
        mounting = Mounting(section.left_mirrored, section.right_mirrored, section.swapped)
        controller = Zlac8015dEmulator(self._twin, self._clock, mounting, section.counts_per_turn)
        slaves.add(section.unit, controller, self._line("wheels", wire))
        return wire.path

    def _gps(self) -> str:
        section = self._config.gps
        if not isinstance(section, NmeaGpsSection):
            raise _no_emulator("gps", section.backend)
        receiver = EmulatedReceiver(needs_corrections=section.ntrip is not None, baud=section.baud)
        emulator = GpsEmulator(self._twin, self._clock, receiver)
        wire = self._wire("gps", section.baud, emulator.receive)
        emulator.connect(self._line("gps", wire))
        self.lives.append(emulator.serve)
        return wire.path

    def _modem(self) -> str:
        section = self._config.modem
        if not isinstance(section, GsmModemSection):
            raise _no_emulator("modem", section.backend)
        sim = EmulatedSim(pin=section.pin.get_secret_value() if section.pin else None)
        emulator = ModemEmulator(self._twin, self._clock, sim)
        wire = self._wire("modem", section.baud, emulator.receive, any_baud=True)
        emulator.connect(self._line("modem", wire))
        self.lives.append(emulator.serve)
        return wire.path

    async def _caster(self) -> str | None:
        """The address of a caster beside the row; None when the receiver is to have no corrections."""
        section = self._config.gps
        if not isinstance(section, NmeaGpsSection) or section.ntrip is None:
            return None
        nominal, ntrip = self._twin.nominal, section.ntrip
        station = BaseStation(nominal.gps_latitude_deg, nominal.gps_longitude_deg, nominal.gps_altitude_m)
        users = {ntrip.user: ntrip.password.get_secret_value()} if ntrip.user else {}
        caster = Caster(CasterSettings({ntrip.mountpoint: station}, users), self._clock)
        port = await caster.start()
        self.ends.append(caster.stop)
        return f"127.0.0.1:{port}"

    async def _camera(self) -> str:
        section = self._config.camera
        if not isinstance(section, StereoUsbCameraSection):
            raise _no_emulator("camera", section.backend)
        darkroom = WorkerProcess(self._twin.scene, self._twin.nominal.optics, self._twin.seed)
        emulator = CameraEmulator(self._twin, self._clock, darkroom)
        await emulator.plug()
        self.lives.append(emulator.serve)
        return emulator.url

    def _bus_at(self, device: str, port: str, baud: int) -> tuple[PtyWire, ModbusSlaves]:
        """The wire of a Modbus bus: one for all devices whose sections name the same port."""
        if port in self._buses:
            wire, slaves = self._buses[port]
            self._wires[device] = wire
        else:
            slaves = ModbusSlaves(self._clock, 10.0 / baud)
            wire = self._wire(device, baud, slaves.receive)
            self._buses[port] = wire, slaves
        return wire, slaves


def _no_emulator(device: str, backend: str) -> ConfigError:
    return ConfigError(
        f"{device}.backend is '{backend}', which has no emulator; choose a production back end or use --only"
    )
