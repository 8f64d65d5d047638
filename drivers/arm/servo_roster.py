"""Which servos there are, how each is, and what stands against moving them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from drivers.arm.control_tables import VELOCITY_UNIT_RAD_S, hardware_error_text
from drivers.arm.joints import DynamixelSettings
from drivers.arm.register_blocks import Condition, Motion
from drivers.arm.servo_health import ServoHealth
from drivers.arm.servo_line import DEVICE, Answers
from drivers.arm.values import ArmState
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout


class ServoRoster:
    """``health`` by id, in the order of the joints. Faults of servos stay until ``forget``."""

    def __init__(self, settings: DynamixelSettings) -> None:
        self.health = {
            servo.servo_id: ServoHealth(servo.servo_id, joint.name, servo.model)
            for joint in settings.joints
            for servo in joint.servos
        }
        self.garbled = self.silences = 0
        self._all = tuple(self.health.values())
        self._names = settings.joint_names
        self._joints = tuple(
            tuple((servo, servo.table.effort_at_stall) for servo in joint.servos) for joint in settings.joints
        )

    def forget(self) -> None:
        """Begin anew: no servo is dead or has been rebooted."""
        for health in self.health.values():
            health.alive, health.rebooted, health.misses, health.tick = True, False, 0, None

    @property
    def alive(self) -> list[int]:
        return [servo_id for servo_id, health in self.health.items() if health.alive]

    @property
    def limp(self) -> list[int]:
        """Servos without torque, as last seen."""
        return [servo_id for servo_id, health in self.health.items() if not health.torque_on]

    def note(self, data: Mapping[int, bytes]) -> None:
        """Registers 64 to 98 of some servos."""
        for servo_id, raw in data.items():
            condition, health = Condition.of(raw), self.health[servo_id]
            health.torque_on, health.hardware_error = condition.torque_on, condition.hardware_error

    def note_missing(self, missing: Iterable[int], asked_alone: Callable[[int], bool], *, someone: bool) -> bool:
        """Who of the ``missing`` is silent when asked alone has missed; the answer is whether any servo is there.

        ``someone``: others did answer. Where nobody does it is the bus, and no servo is held to be dead.
        """
        missing = tuple(missing)
        there = {servo_id for servo_id in missing if asked_alone(servo_id)}
        if not there and not someone:
            return False
        for servo_id in missing:
            if servo_id in there:
                self.health[servo_id].answered()
            else:
                self.health[servo_id].missed()
        return True

    def require_alive(self) -> None:
        dead = [health.servo_id for health in self._all if not health.alive]
        if dead:
            raise DeviceTimeout(
                DEVICE, "an answer of every servo", f"silence of {self.names_of(dead)}",
                "check the cable and the power there; it is asked again every second",
            )  # fmt: skip

    def require_sound(self) -> None:
        """No servo is dead or has been rebooted."""
        self.require_alive()
        for health in self._all:
            if health.rebooted:
                raise DeviceFault(
                    DEVICE, f"{health.joint} to have kept its power and its settings",
                    f"servo {health.servo_id} rebooted",
                    "look for a loose cable or a low supply there, then open the arm again",
                )  # fmt: skip

    def require_working(self) -> None:
        """Torque on and no hardware error, as last seen."""
        for name, error in zip(self._names, self._errors, strict=True) if self._any_error else ():
            if error:
                found = f"{name} reports {hardware_error_text(error)}"
                raise DeviceFault(DEVICE, "servos without errors", found, "look at that servo, then reboot it")
        if self.limp:
            raise DeviceFault(DEVICE, "torque on", "torque off", "switch torque on when nobody is near the arm")

    def unanswered(self, answers: Answers) -> DeviceError:
        names = self.names_of(answers.missing)
        if answers.garbled:
            self.garbled += 1
            expected = f"valid answers of {names}"
            return DeviceFault(DEVICE, expected, "a garbled answer", "check the cable and its shield")
        return DeviceTimeout(
            DEVICE, f"answers of {names}", "silence", "check power and cable; where the arm is is unknown"
        )

    def names_of(self, servo_ids: Iterable[int]) -> str:
        return ", ".join(f"{self.health[servo_id].joint} (servo {servo_id})" for servo_id in servo_ids)

    def state(self, stamp_s: float, data: Mapping[int, bytes]) -> ArmState:
        """From registers 126 to 135 of every servo; a joint's angle and speed are its first servo's."""
        position, velocity, load = [], [], []
        motions = {servo_id: Motion.of(raw) for servo_id, raw in data.items()}
        for servos in self._joints:
            first, _ = servos[0]
            motion = motions[first.servo_id]
            position.append(first.angle_of(motion.position))
            velocity.append(first.direction * motion.velocity * VELOCITY_UNIT_RAD_S)
            effort = sum(servo.direction * motions[servo.servo_id].effort / stall for servo, stall in servos)
            load.append(min(max(effort / len(servos), -1.0), 1.0))
        return ArmState(stamp_s, tuple(position), tuple(velocity), tuple(load), not self.limp, self._errors)

    @property
    def _any_error(self) -> bool:
        return any(health.hardware_error for health in self._all)

    @property
    def _errors(self) -> tuple[int, ...]:
        """By joint, of all its servos."""
        errors = []
        for servos in self._joints:
            byte = 0
            for servo, _ in servos:
                byte |= self.health[servo.servo_id].hardware_error
            errors.append(byte)
        return tuple(errors)
