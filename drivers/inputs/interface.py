"""The contract of the inputs."""

from __future__ import annotations

from typing import Protocol

from drivers.inputs.values import InputState


class Inputs(Protocol):
    """E-stop, bumper, tank level, flow, pressure, tilt and battery. Every method raises a ``DeviceError``."""

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    async def read(self) -> InputState: ...
