"""A ZLAC8015D on the twin: its registers, states and time-outs behind Modbus."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from enum import Enum

from drivers.emulation.modbus_slave import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, ModbusException
from drivers.twin.commands import WheelsDrive, WheelsRamps, WheelsStop
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin
from drivers.wheels import zlac_registers as r
from drivers.wheels.drive_geometry import Mounting, WheelPair, base_motion, count_m, rpm_of, speed_of
from drivers.wheels.mock import WRONG_SCALE
from drivers.wheels.values import Odometry

SOFTWARE_VERSION = 0x0104
NEVER_S = 1e9
ROLLING_CURRENT_A = 0.6
AMBIENT_C, FULL_SPEED_RISE_K, WARMING_S = 25.0, 20.0, 300.0
MOTION = frozenset(
    register.address for register in (r.OFFLINE_TIME, r.MAX_SPEED, r.LEFT_RISE, r.RIGHT_RISE, r.LEFT_FALL, r.RIGHT_FALL)
)
TARGETS = frozenset({r.LEFT_TARGET.address, r.RIGHT_TARGET.address})


class State(Enum):
    """What the controller does with the motors, as the upper bits of a status byte."""

    RELEASED = r.Status(0)
    ENABLED = r.Status.LOCKED
    EMERGENCY_STOP = r.Status.EMERGENCY_STOP
    ALARM = r.Status.ALARM


class Zlac8015dEmulator:
    """Implements ``drivers.emulation.modbus_slave.SlaveUnit``; ``clock`` gives loop time.

    Wanted speeds are obeyed while enabled in velocity mode; every frame for the unit holds off the offline time; wheel
    speeds rise and fall by the highest speed over the times set. The e-stop chain opens the emergency stop input.
    ``lacks`` are registers that this firmware does not know.
    """

    def __init__(
        self,
        twin: Twin,
        clock: Callable[[], float],
        mounting: Mounting | None = None,
        counts_per_turn: int = 4096,
        lacks: frozenset[int] = frozenset(),
    ) -> None:
        self._twin, self._clock = twin, clock
        self._mounting = mounting or Mounting()
        self._radius_m, self._track_m = twin.nominal.wheel_radius_m, twin.nominal.track_m
        self._count_m = count_m(self._radius_m, counts_per_turn)
        self._lacks = lacks
        self._origin = WheelPair(0, 0)  # what the channels' counters showed where they show 0
        self._frozen: Odometry | None = None
        self._warm_s, self._warmth = 0.0, 0.0
        self._faults = (0, 0)
        self._power_on()

    # --- what happens to it -----------------------------------------------------------------------------------

    def raise_alarm(self, left: int = 0, right: int = 0) -> None:
        """Latch fault bits of its channels: the motors stop and take no command."""
        self._faults = (self._faults[0] | left, self._faults[1] | right)
        self._halt(State.ALARM)

    def power_cycle(self) -> None:
        """Off and on: registers as at power-on, motors released, counters at 0."""
        self._origin = self._counted(self._twin.odometry(self._clock()))
        self._twin.apply(self._clock(), WheelsStop())
        self._power_on()

    def preset_counters(self, left: int, right: int) -> None:
        """Let its channels' counters show these values now."""
        counted = self._counted(self._twin.odometry(self._clock()))
        self._origin = WheelPair(counted.left - left, counted.right - right)

    def preset_targets(self, left_rpm: int, right_rpm: int) -> None:
        """Let wanted speeds stand in its registers, as a host that died may leave them."""
        self._words[r.LEFT_TARGET.address] = r.word_of(left_rpm)
        self._words[r.RIGHT_TARGET.address] = r.word_of(right_rpm)

    def _power_on(self) -> None:
        self._words = {a: register.at_power_on for a, register in r.REGISTERS.items() if register.writable}
        self._state = State.RELEASED
        self._faults = (0, 0)
        self._heard_s = -math.inf
        self._set_motion = True

    # --- what it is asked -------------------------------------------------------------------------------------

    def answer(self, function: int, data: bytes) -> bytes | None:
        now_s = self._clock()
        self._twin.advance(now_s)
        self._notice(now_s)
        self._heard_s = now_s
        if function == 3:
            address, count = struct.unpack(">HH", data)
            words = self._read(range(address, address + count))
            self._go_on()
            return bytes([2 * count]) + struct.pack(f">{count}H", *words)
        if function == 6:
            address, value = struct.unpack(">HH", data)
            self._write(address, (value,))
            return data
        if function == 16:
            address, count = struct.unpack(">HH", data[:4])
            self._write(address, struct.unpack(f">{count}H", data[5:]))
            return data[:4]
        raise ModbusException(ILLEGAL_FUNCTION)

    def _notice(self, now_s: float) -> None:
        """What has happened since the last frame: silence beyond the offline time, an opened e-stop chain."""
        timeout_s = self._timeout_s
        if now_s - self._heard_s > timeout_s:
            self._targets_to_zero()
        if not self._twin.physics.drive.powered and self._state is State.ENABLED:
            self._targets_to_zero()
            self._state = State.EMERGENCY_STOP

    @property
    def _timeout_s(self) -> float:
        return 0.001 * self._words[r.OFFLINE_TIME.address] or NEVER_S

    def _write(self, first: int, values: tuple[int, ...]) -> None:
        addresses = range(first, first + len(values))
        for address, value in zip(addresses, values, strict=True):
            self._require_writable(address, value)
        for address, value in zip(addresses, values, strict=True):
            self._words[address] = value
        if self._set_motion or not MOTION.isdisjoint(addresses):
            self._set_motion = False
            self._apply_ramps()
        if r.CONTROL.address in addresses:
            self._control(self._words[r.CONTROL.address])
        elif r.MODE.address in addresses and self._words[r.MODE.address] != r.VELOCITY_MODE:
            self._targets_to_zero()
            self._twin.apply(self._clock(), WheelsStop())
        elif not TARGETS.isdisjoint(addresses):
            self._obey()
        else:
            self._go_on()

    def _require_writable(self, address: int, value: int) -> None:
        register = r.REGISTERS.get(address)
        if register is None or not register.writable or address in self._lacks:
            raise ModbusException(ILLEGAL_ADDRESS)
        number = r.signed_16(value) if register.low < 0 else value
        if not register.low <= number <= register.high:
            raise ModbusException(ILLEGAL_VALUE)
        if register is r.CONTROL and value not in (*r.Control, 0x10, 0x11, 0x12):
            raise ModbusException(ILLEGAL_VALUE)

    def _control(self, word: int) -> None:
        if word == r.Control.CLEAR_ALARM:
            self._faults = (0, 0)
            if self._state is State.ALARM:
                self._state = State.RELEASED
        elif self._state is State.ALARM:
            return
        elif word == r.Control.EMERGENCY_STOP:
            self._halt(State.EMERGENCY_STOP)
        elif word == r.Control.DISABLE:
            self._halt(State.RELEASED)
        elif word == r.Control.ENABLE:
            self._state = State.ENABLED if self._twin.physics.drive.powered else State.EMERGENCY_STOP
            self._obey()

    # --- what it does -----------------------------------------------------------------------------------------

    def _apply_ramps(self) -> None:
        highest_m_s = speed_of(self._words[r.MAX_SPEED.address], self._radius_m)

        def rate(left: r.Register, right: r.Register) -> float:
            return 1000.0 * highest_m_s / max(1, self._words[left.address], self._words[right.address])

        ramps = WheelsRamps(rate(r.LEFT_RISE, r.RIGHT_RISE), rate(r.LEFT_FALL, r.RIGHT_FALL), self._timeout_s)
        self._twin.apply(self._clock(), ramps)

    def _obey(self) -> None:
        """Let the base have the wanted speeds, if they are to be obeyed."""
        if self._state is not State.ENABLED or self._words[r.MODE.address] != r.VELOCITY_MODE:
            return
        highest = self._words[r.MAX_SPEED.address]
        rpm = [
            max(-highest, min(highest, r.signed_16(self._words[target.address])))
            for target in (r.LEFT_TARGET, r.RIGHT_TARGET)
        ]
        wheels = self._mounting.wheels(WheelPair(*(speed_of(value, self._radius_m) for value in rpm)))
        self._twin.apply(self._clock(), WheelsDrive(*base_motion(wheels, self._track_m)))

    def _go_on(self) -> None:
        """A frame holds the offline time off."""
        if any(self._words[target] for target in TARGETS):
            self._obey()

    def _targets_to_zero(self) -> None:
        self._words.update(dict.fromkeys(TARGETS, 0))

    def _halt(self, state: State) -> None:
        self._state = state
        self._targets_to_zero()
        self._twin.apply(self._clock(), WheelsStop())

    # --- what it tells ----------------------------------------------------------------------------------------

    def _read(self, addresses: range) -> list[int]:
        if not all(address in r.REGISTERS and address not in self._lacks for address in addresses):
            raise ModbusException(ILLEGAL_ADDRESS)
        told = self._words if all(address in self._words for address in addresses) else self._words | self._telling()
        return [told[address] for address in addresses]

    def _telling(self) -> dict[int, int]:
        """The registers that only tell."""
        now_s = self._clock()
        seen = self._seen(self._twin.odometry(now_s))
        counted = self._counted(seen)
        position = WheelPair(counted.left - self._origin.left, counted.right - self._origin.right)
        speed = self._mounting.channels(
            WheelPair(rpm_of(seen.left_m_s, self._radius_m), rpm_of(seen.right_m_s, self._radius_m))
        )
        left, right = self._faults
        halves = r.Status.RUNNING if speed != WheelPair(0.0, 0.0) else r.Status(0)
        status = self._state.value | halves
        motor_c = round(AMBIENT_C + self._warming(now_s))
        current = self._mounting.channels(WheelPair(_sign(seen.left_m_s), _sign(seen.right_m_s)))
        high_low = (*r.words_of(int(position.left)), *r.words_of(int(position.right)))
        return {
            r.SOFTWARE.address: SOFTWARE_VERSION,
            r.BUS_VOLTAGE.address: round(100.0 * self._twin.inputs(now_s).battery_v),
            r.STATUS.address: status << 8 | status,
            r.HALLS.address: self._hall(position.left) << 8 | self._hall(position.right),
            r.MOTOR_TEMPERATURES.address: motor_c << 8 | motor_c,
            r.LEFT_FAULTS.address: left,
            r.RIGHT_FAULTS.address: right,
            **{r.LEFT_POSITION_HIGH.address + k: word for k, word in enumerate(high_low)},
            r.LEFT_SPEED.address: r.word_of(round(10.0 * speed.left)),
            r.RIGHT_SPEED.address: r.word_of(round(10.0 * speed.right)),
            r.LEFT_CURRENT.address: r.word_of(round(10.0 * ROLLING_CURRENT_A * current.left)),
            r.RIGHT_CURRENT.address: r.word_of(round(10.0 * ROLLING_CURRENT_A * current.right)),
            r.CONNECTED.address: 0,
            r.DRIVER_TEMPERATURE.address: round(10.0 * (AMBIENT_C + 0.5 * self._warmth)),
        }

    def _seen(self, odometry: Odometry) -> Odometry:
        """As its encoders give it: frozen, or off, as the declared fault has it."""
        verb = self._twin.verb("wheels", self._clock())
        if verb is Verb.STUCK:
            self._frozen = self._frozen or odometry
            return self._frozen
        self._frozen = None
        if verb is Verb.WRONG:
            return replace(odometry, left_m=odometry.left_m * WRONG_SCALE, right_m=odometry.right_m * WRONG_SCALE)
        return odometry

    def _counted(self, odometry: Odometry) -> WheelPair:
        """Its channels' counts since the machine was built."""
        wheels = WheelPair(round(odometry.left_m / self._count_m), round(odometry.right_m / self._count_m))
        return self._mounting.channels(wheels)

    @staticmethod
    def _hall(count: float) -> int:
        """The three Hall sensors at this count: six patterns, never none or all."""
        return (0b001, 0b011, 0b010, 0b110, 0b100, 0b101)[int(count) // 45 % 6]

    def _warming(self, now_s: float) -> float:
        """How much warmer than the air the motors are; they follow the speed slowly."""
        share = abs(self._twin.physics.drive.speeds_m_s[0]) / self._twin.nominal.max_speed_m_s
        pull = 1.0 - math.exp(-(now_s - self._warm_s) / WARMING_S)
        self._warmth += pull * (FULL_SPEED_RISE_K * share - self._warmth)
        self._warm_s = now_s
        return self._warmth


def _sign(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0
