"""Every backend of a device runs its device's suite. A later backend joins by one line in its device's table."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import pytest

from drivers.arm.interface import Arm
from drivers.arm.mock import MockArm
from drivers.camera.interface import StereoCamera
from drivers.camera.mock import MockCamera
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
from tests.drivers.twin import rig


class Opens(Protocol):
    """What all devices have in common."""

    async def open(self) -> None: ...


D = TypeVar("D", bound=Opens)
Make = Callable[[Twin, Callable[[], float]], D]

CAMERAS: dict[str, Make[StereoCamera]] = {"mock": MockCamera}
ARMS: dict[str, Make[Arm]] = {"mock": MockArm}
RELAYS: dict[str, Make[RelayBoard]] = {"mock": MockRelay}
INPUTS: dict[str, Make[Inputs]] = {"mock": MockInputs}
RECEIVERS: dict[str, Make[Gps]] = {"mock": MockGps}
MODEMS: dict[str, Make[Modem]] = {"mock": MockModem}
DRIVES: dict[str, Make[Wheels]] = {"mock": MockWheels}


@dataclass(frozen=True)
class Bench(Generic[D]):
    """A way to run one test on one backend: ``run(test, *faults)`` with a fresh twin and a fresh loop."""

    make: Make[D]

    def run(
        self, test: Callable[[D, Twin], Awaitable[None]], *faults: str, opened: bool = True, **changes: Any
    ) -> Twin:
        """``opened``: the device is open when the test begins. Returns the twin as the test left it."""
        twin = rig.twin(*faults, **changes)

        async def main() -> None:
            device = self.make(twin, asyncio.get_running_loop().time)
            if opened:
                await device.open()
            await test(device, twin)
            twin.advance(asyncio.get_running_loop().time())

        run_virtual(main())
        return twin


@pytest.fixture(params=CAMERAS)
def camera(request: pytest.FixtureRequest) -> Bench[StereoCamera]:
    return Bench(CAMERAS[request.param])


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Bench[Arm]:
    return Bench(ARMS[request.param])


@pytest.fixture(params=RELAYS)
def relay(request: pytest.FixtureRequest) -> Bench[RelayBoard]:
    return Bench(RELAYS[request.param])


@pytest.fixture(params=INPUTS)
def inputs(request: pytest.FixtureRequest) -> Bench[Inputs]:
    return Bench(INPUTS[request.param])


@pytest.fixture(params=RECEIVERS)
def gps(request: pytest.FixtureRequest) -> Bench[Gps]:
    return Bench(RECEIVERS[request.param])


@pytest.fixture(params=MODEMS)
def modem(request: pytest.FixtureRequest) -> Bench[Modem]:
    return Bench(MODEMS[request.param])


@pytest.fixture(params=DRIVES)
def wheels(request: pytest.FixtureRequest) -> Bench[Wheels]:
    return Bench(DRIVES[request.param])
