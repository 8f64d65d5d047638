"""A trajectory followed goal by goal, in the owner thread of the port, as long as the program shows that it lives."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

from drivers.arm.servo_group import ServoGroup
from drivers.arm.servo_line import DEVICE
from drivers.arm.values import JointTrajectory
from drivers.errors import DeviceError, DeviceFault, DeviceLost
from drivers.line import Line
from drivers.serial_port import SerialPort

HEARTBEAT_S = 0.05
STALLED_S = 0.4  # without a heartbeat for so long the event loop hangs


class Follower:
    """``done`` ends with the last goal sent, or with what went wrong, the arm braking. ``lasts``: no stop has come.

    The event loop owes a ``heartbeat`` every ``HEARTBEAT_S``; when it hangs the arm brakes all the same.
    """

    def __init__(
        self,
        port: SerialPort,
        group: ServoGroup,
        trajectory: JointTrajectory,
        clock: Callable[[], float],
        lasts: Callable[[], bool],
    ) -> None:
        self.done: Future[None] = Future()
        self._port, self._group, self._trajectory = port, group, trajectory
        self._clock, self._lasts = clock, lasts
        self._cycle_s = group.cadence.due_s
        self._start_s = self._heard_s = 0.0
        self._cycles = 0

    def heartbeat(self) -> None:
        """From the event loop."""
        self._heard_s = self._clock()

    def start(self, line: Line) -> None:
        self._group.begin_stream(line)
        self._start_s = self._heard_s = self._clock()
        self._cycle(line)

    def _cycle(self, line: Line) -> None:
        """The goals of this moment, and a timer for the next."""
        try:
            now_s = self._clock()
            self._require_leave(now_s)
            self._group.cycle(line, self._trajectory.at(now_s - self._start_s))
            if now_s >= self._end_s:
                self._group.end_stream(self._trajectory.goal_rad)
        except OSError:
            self.done.set_exception(
                DeviceLost(DEVICE, "its port to be there", "it unplugged", "plug it in again; the servos hold")
            )
            raise
        except BaseException as error:  # noqa: BLE001 - told to the one who waits
            self._fail(line, error)
        else:
            if now_s >= self._end_s:
                self.done.set_result(None)
            else:
                self._port.at(self._next_s(), self._cycle)

    def _require_leave(self, now_s: float) -> None:
        if not self._lasts():
            raise DeviceFault(DEVICE, "to follow to the end", "a stop meanwhile", "plan from where the arm is")
        if now_s - self._heard_s > STALLED_S:
            raise DeviceFault(
                DEVICE, f"the program to show that it lives every {HEARTBEAT_S:g} s",
                f"nothing for {now_s - self._heard_s:.2f} s", "the computer is too busy; plan from where the arm is",
            )  # fmt: skip

    def _fail(self, line: Line, error: BaseException) -> None:
        try:
            if self._lasts():
                self._group.brake(line)
        except DeviceError as failed:
            error.add_note(f"stopping: {failed}")
        finally:
            self.done.set_exception(error)

    @property
    def _end_s(self) -> float:
        return self._start_s + self._trajectory.duration_s

    def _next_s(self) -> float:
        """The next full cycle from here, so that other jobs have their turn; those that were missed are left out."""
        self._cycles = max(self._cycles + 1, int((self._clock() - self._start_s) / self._cycle_s) + 1)
        return min(self._start_s + self._cycles * self._cycle_s, self._end_s)
