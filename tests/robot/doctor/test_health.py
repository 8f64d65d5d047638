"""What servos and motors tell of themselves, judged."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass, replace

import pytest

from drivers.arm.servo_health import ArmDiagnostics, ServoDiagnostics
from drivers.wheels.zlac_diagnostics import MotorDiagnostics, Zlac8015dDiagnostics
from robot.clock import run_virtual
from robot.doctor import Finding, Level
from robot.doctor.health import MotorWheels, ServoArm, motor_findings, servo_findings

SERVO = ServoDiagnostics(1, "waist", "XM540-W270", 46, True, False, True, 0, 41.0, 12.0, 0.0, 0, 0)
COOLER = replace(SERVO, servo_id=2, joint="shoulder", temperature_c=38.0)
ARM = ArmDiagnostics((SERVO, COOLER), 0, 0.0, 0.0, 0, 0, 0, ())
MOTOR = MotorDiagnostics("enabled", False, 31.0, 0.4, (), 4096)
WHEELS = Zlac8015dDiagnostics(100, 25.2, 35.0, MOTOR, MOTOR)


@dataclass
class Arm:
    """Tells each of these in turn, the last for good."""

    told: list[ArmDiagnostics]

    def diagnostics(self) -> ArmDiagnostics:
        return self.told.pop(0) if len(self.told) > 1 else self.told[0]


@dataclass
class Wheels:
    told: Zlac8015dDiagnostics

    async def diagnostics(self) -> Zlac8015dDiagnostics:
        return self.told


def found(findings: AsyncIterator[Finding]) -> dict[str, Finding]:
    async def main() -> dict[str, Finding]:
        return {finding.what: finding async for finding in findings}

    return run_virtual(main())


def of_arm(*told: ArmDiagnostics) -> dict[str, Finding]:
    arm = Arm(list(told))
    assert isinstance(arm, ServoArm)
    return found(servo_findings(arm))


def of_wheels(told: Zlac8015dDiagnostics) -> dict[str, Finding]:
    wheels = Wheels(told)
    assert isinstance(wheels, MotorWheels)
    return found(motor_findings(wheels))


def with_servo(**changes: object) -> ArmDiagnostics:
    return replace(ARM, servos=(*ARM.servos, replace(SERVO, servo_id=7, joint="wrist_angle", **changes)))  # type: ignore[arg-type]


def test_a_healthy_arm_tells_its_hottest_servo_and_its_supply() -> None:
    told = of_arm(ARM)
    assert {finding.level for finding in told.values()} == {Level.OK}
    assert told["temperatures"].found == "41 C at most (waist, servo 1)"
    assert told["supply"].found == "12.0 to 12.0 V"


def test_servos_that_have_not_been_asked_yet_are_waited_for() -> None:
    told = of_arm(with_servo(temperature_c=None, voltage_v=None), with_servo(temperature_c=45.0))
    assert told["temperatures"].found == "45 C at most (wrist_angle, servo 7)"


def test_a_servo_that_never_tells_is_named() -> None:
    told = of_arm(with_servo(temperature_c=None, voltage_v=None))
    assert told["temperatures"].level is Level.WARN
    assert told["temperatures"].found == "none of wrist_angle, servo 7"


def test_a_hot_servo_is_named() -> None:
    told = of_arm(with_servo(temperature_c=66.0))["temperatures"]
    assert (told.level, told.code) == (Level.WARN, 1)
    assert "wrist_angle, servo 7" in told.found
    assert told.remedy


@pytest.mark.parametrize("voltage_v", [9.8, 15.0])
def test_a_wrong_supply_of_a_servo_is_told(voltage_v: float) -> None:
    told = of_arm(with_servo(voltage_v=voltage_v))["supply"]
    assert told.level is Level.WARN
    assert f"{voltage_v:.1f}" in told.found


def test_a_bad_bus_and_what_the_driver_noted_are_told() -> None:
    note = "servo 6 answers 500 us late: set return_delay_time to 0"
    told = of_arm(replace(ARM, garbled=3, silences=1, notes=(note,)))
    assert told["bus"].found == "3 garbled answers, 1 missing"
    assert (told["servos"].found, told["servos"].remedy) == (
        "servo 6 answers 500 us late", "set return_delay_time to 0",
    )  # fmt: skip
    assert told["bus"].level is told["servos"].level is Level.WARN


def test_healthy_wheels_tell_supply_and_temperatures() -> None:
    told = of_wheels(WHEELS)
    assert {finding.level for finding in told.values()} == {Level.OK}
    assert (told["supply"].found, told["controller"].found) == ("25.2 V", "35 C")
    assert told["left motor"].found == "enabled, 31 C, 0.4 A"


def test_a_faulty_motor_fails_with_its_fault() -> None:
    told = of_wheels(replace(WHEELS, right=replace(MOTOR, state="alarm", faults=("hall sensor",))))
    assert (told["right motor"].level, told["right motor"].code) == (Level.FAIL, 69)
    assert "hall sensor" in told["right motor"].found
    assert told["left motor"].level is Level.OK


def test_an_empty_battery_and_heat_are_told() -> None:
    hot = replace(MOTOR, temperature_c=90.0)
    told = of_wheels(replace(WHEELS, battery_v=21.4, controller_temperature_c=72.0, left=hot))
    assert {told[what].level for what in ("supply", "controller", "left motor")} == {Level.WARN}
    assert told["right motor"].level is Level.OK
