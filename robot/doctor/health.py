"""What servos and motors tell of themselves: supply, temperatures, faults, how well the bus works."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from typing import Protocol, runtime_checkable

from robot.doctor.values import Finding, failure, fine, warning
from robot.errors import UnavailableError

SERVO_HOT_C, MOTOR_HOT_C, CONTROLLER_HOT_C = 65.0, 80.0, 70.0
SERVO_LOW_V, SERVO_HIGH_V = 10.5, 14.4  # of 12 V servos
MOTOR_LOW_V = 22.0  # of a 24 V supply
FIRST_ROUND_S = 2.0  # until every servo has been asked
LOOK_S = 0.05


class ServoHealth(Protocol):
    """As of the latest round; None is not known yet."""

    @property
    def servo_id(self) -> int: ...
    @property
    def joint(self) -> str: ...
    @property
    def temperature_c(self) -> float | None: ...
    @property
    def voltage_v(self) -> float | None: ...


class ArmHealth(Protocol):
    @property
    def servos(self) -> Sequence[ServoHealth]: ...
    @property
    def garbled(self) -> int: ...
    @property
    def silences(self) -> int: ...
    @property
    def notes(self) -> Sequence[str]: ...


class MotorHealth(Protocol):
    @property
    def state(self) -> str: ...
    @property
    def temperature_c(self) -> float: ...
    @property
    def current_a(self) -> float: ...
    @property
    def faults(self) -> Sequence[str]: ...


class WheelsHealth(Protocol):
    @property
    def battery_v(self) -> float: ...
    @property
    def controller_temperature_c(self) -> float: ...
    @property
    def left(self) -> MotorHealth: ...
    @property
    def right(self) -> MotorHealth: ...


@runtime_checkable
class ServoArm(Protocol):
    """An arm that knows its servos."""

    def diagnostics(self) -> ArmHealth: ...


@runtime_checkable
class MotorWheels(Protocol):
    """Wheels that know their motors. ``DeviceError`` like any reading."""

    async def diagnostics(self) -> WheelsHealth: ...


async def servo_findings(arm: ServoArm) -> AsyncIterator[Finding]:
    """The hottest, the supply, and what the driver noticed."""
    for _ in range(round(FIRST_ROUND_S / LOOK_S)):  # the driver asks them one after another
        if all(servo.temperature_c is not None for servo in arm.diagnostics().servos):
            break
        await asyncio.sleep(LOOK_S)
    health = arm.diagnostics()
    warm = [(servo.temperature_c, servo) for servo in health.servos if servo.temperature_c is not None]
    if warm:
        hottest_c, servo = max(warm, key=lambda each: each[0])
        yield _warm("arm", "temperatures", f"{hottest_c:.0f} C at most ({_named(servo)})", hottest_c, SERVO_HOT_C)
    supplied = [servo.voltage_v for servo in health.servos if servo.voltage_v is not None]
    if supplied:
        shown = f"{min(supplied):.1f} to {max(supplied):.1f} V"
        if min(supplied) < SERVO_LOW_V or max(supplied) > SERVO_HIGH_V:
            yield warning("arm", "supply", shown, f"{SERVO_LOW_V:g} to {SERVO_HIGH_V:g} V at every servo",
                          "charge the battery; look at plugs and cables of the arm")  # fmt: skip
        else:
            yield fine("arm", "supply", shown)
    unknown = [_named(servo) for servo in health.servos if servo.temperature_c is None]
    if unknown:
        yield warning("arm", "temperatures", f"none of {', '.join(unknown)}", "of every servo",
                      "look for a loose plug: it answers seldom")  # fmt: skip
    if health.garbled or health.silences:
        yield warning("arm", "bus", f"{health.garbled} garbled answers, {health.silences} missing", "none",
                      "check plugs, cables and the supply of the arm")  # fmt: skip
    for note in health.notes:
        what, _, remedy = note.partition(": ")
        yield warning("arm", "servos", what, "nothing to note", remedy or "see the arm's manual page")


async def motor_findings(wheels: MotorWheels) -> AsyncIterator[Finding]:
    """Supply, temperatures, and what stops a motor."""
    health = await wheels.diagnostics()
    shown = f"{health.battery_v:.1f} V"
    if health.battery_v < MOTOR_LOW_V:
        yield warning("wheels", "supply", shown, f"{MOTOR_LOW_V:g} V or more", "charge the battery")
    else:
        yield fine("wheels", "supply", shown)
    controller_c = health.controller_temperature_c
    yield _warm("wheels", "controller", f"{controller_c:.0f} C", controller_c, CONTROLLER_HOT_C)
    for side, motor in (("left motor", health.left), ("right motor", health.right)):
        shown = f"{motor.state}, {motor.temperature_c:.0f} C, {motor.current_a:.1f} A"
        if motor.faults:
            yield failure(
                "wheels", side, f"{shown}; {', '.join(motor.faults)}", "no fault",
                "find its cause, then switch the controller off and on", UnavailableError.exit_code,
            )  # fmt: skip
        else:
            yield _warm("wheels", side, shown, motor.temperature_c, MOTOR_HOT_C)


def _warm(device: str, what: str, shown: str, temperature_c: float, hot_c: float) -> Finding:
    if temperature_c < hot_c:
        return fine(device, what, shown)
    return warning(device, what, shown, f"below {hot_c:.0f} C", "let it cool; look for what blocks it or its air")


def _named(servo: ServoHealth) -> str:
    return f"{servo.joint}, servo {servo.servo_id}"
