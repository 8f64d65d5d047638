"""Every backend of a device runs its device's suite. A later backend joins by one line in its device's table."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, Protocol, TypeVar

import pytest

from drivers.arm.interface import Arm
from drivers.arm.mock import MockArm
from drivers.camera.interface import StereoCamera
from drivers.camera.mock import MockCamera
from drivers.errors import DeviceError
from drivers.gps.interface import Gps
from drivers.gps.mock import MockGps
from drivers.inputs.interface import Inputs
from drivers.inputs.mock import MockInputs
from drivers.modem.interface import Modem
from drivers.modem.mock import MockModem
from drivers.relay.interface import RelayBoard
from drivers.relay.mock import MockRelay
from drivers.twin import Twin
from drivers.wheels.interface import Wheels
from drivers.wheels.mock import MockWheels
from robot.clock import run_virtual
from tests.contract.leaping import LeapingLoop
from tests.contract.rigged import Rigged
from tests.contract.rigs.arm import emulated_arm
from tests.contract.rigs.camera import emulated_camera, recorded_camera
from tests.contract.rigs.gps import emulated_gps
from tests.contract.rigs.inputs import emulated_inputs
from tests.contract.rigs.modem import emulated_modem
from tests.contract.rigs.relay import emulated_relay
from tests.contract.rigs.wheels import emulated_wheels
from tests.drivers.twin import rig


class Opens(Protocol):
    """What all devices have in common."""

    async def open(self) -> None: ...

    async def close(self) -> None: ...


D = TypeVar("D", bound=Opens)
Clock = Callable[[], float]
Make = Callable[[Twin, Clock], D]
Test = Callable[[D, Twin], Awaitable[None]]


class Bench(Protocol[D]):
    """A way to run one test on one backend: ``run(test, *faults)`` with a fresh twin and a fresh loop.

    ``opened``: the device is open when the test begins. Returns the twin as the test left it.
    """

    def run(self, test: Test[D], *faults: str, opened: bool = True, **changes: Any) -> Twin: ...


@dataclass(frozen=True)
class Virtual(Generic[D]):
    """A mock, in virtual time."""

    make: Make[D]

    def run(self, test: Test[D], *faults: str, opened: bool = True, **changes: Any) -> Twin:
        twin = rig.twin(*faults, **changes)

        async def main() -> None:
            device = self.make(twin, asyncio.get_running_loop().time)
            if opened:
                await device.open()
            await test(device, twin)
            twin.advance(asyncio.get_running_loop().time())

        run_virtual(main())
        return twin


@dataclass(frozen=True)
class OnTheWire(Generic[D]):
    """A production driver that speaks with the emulator of its device, in real time that leaps over silence."""

    make: Callable[[Twin, Clock], Rigged[D]]

    def run(self, test: Test[D], *faults: str, opened: bool = True, **changes: Any) -> Twin:
        twin = rig.twin(*faults, **changes)

        async def main() -> None:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, LeapingLoop)
            rigged = self.make(twin, loop.time)
            loop.busy = rigged.busy
            try:
                if opened:
                    await rigged.device.open()
                await test(rigged.device, twin)
                twin.advance(loop.time())
            finally:
                with suppress(DeviceError):  # a device that a fault took away cannot be closed in order
                    await rigged.device.close()
                await rigged.take_down()

        with asyncio.Runner(loop_factory=LeapingLoop) as runner:
            runner.run(main())
        return twin


# device -> {backend: bench}. A later backend joins by one line.
CAMERAS: dict[str, Bench[StereoCamera]] = {
    "mock": Virtual(MockCamera),
    "stereo_usb": OnTheWire(emulated_camera),
    "files": OnTheWire(recorded_camera),
}
ARMS: dict[str, Bench[Arm]] = {"mock": Virtual(MockArm), "dynamixel": OnTheWire(emulated_arm)}
RELAYS: dict[str, Bench[RelayBoard]] = {"mock": Virtual(MockRelay), "modbus": OnTheWire(emulated_relay)}
INPUTS: dict[str, Bench[Inputs]] = {"mock": Virtual(MockInputs), "modbus": OnTheWire(emulated_inputs)}
RECEIVERS: dict[str, Bench[Gps]] = {"mock": Virtual(MockGps), "nmea": OnTheWire(emulated_gps)}
MODEMS: dict[str, Bench[Modem]] = {
    "mock": Virtual(partial(MockModem, delivery_reports=True)), "gsm": OnTheWire(emulated_modem)
}  # fmt: skip
DRIVES: dict[str, Bench[Wheels]] = {"mock": Virtual(MockWheels), "zlac8015d": OnTheWire(emulated_wheels)}


@pytest.fixture(params=CAMERAS)
def camera(request: pytest.FixtureRequest) -> Bench[StereoCamera]:
    return CAMERAS[request.param]


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Bench[Arm]:
    return ARMS[request.param]


@pytest.fixture(params=RELAYS)
def relay(request: pytest.FixtureRequest) -> Bench[RelayBoard]:
    return RELAYS[request.param]


@pytest.fixture(params=INPUTS)
def inputs(request: pytest.FixtureRequest) -> Bench[Inputs]:
    return INPUTS[request.param]


@pytest.fixture(params=RECEIVERS)
def gps(request: pytest.FixtureRequest) -> Bench[Gps]:
    return RECEIVERS[request.param]


@pytest.fixture(params=MODEMS)
def modem(request: pytest.FixtureRequest) -> Bench[Modem]:
    return MODEMS[request.param]


@pytest.fixture(params=DRIVES)
def wheels(request: pytest.FixtureRequest) -> Bench[Wheels]:
    return DRIVES[request.param]
