"""Each device opened, asked what it is and how it fares, and closed again."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Protocol

from drivers.arm.interface import Arm
from drivers.camera.epipolar import SHIFT_LIMIT_PX, Verdict
from drivers.camera.interface import StereoCamera
from drivers.camera.watched import WatchedCamera
from drivers.errors import DeviceError
from drivers.gps.interface import Gps
from drivers.gps.values import FixQuality
from drivers.inputs.interface import Inputs
from drivers.modem.interface import Modem
from drivers.relay.interface import RelayBoard
from drivers.relay.values import refusal_for_automatic
from drivers.wheels.interface import Wheels
from robot.doctor.health import MotorWheels, ServoArm, motor_findings, servo_findings
from robot.doctor.values import Finding, failure, fine, of_device_error, warning
from robot.errors import UnavailableError
from robot.safety.timing import ARM_STALE_S, ODOMETRY_STALE_S, RELAY_STALE_S, SENSORS_STALE_S, TILT_MAX_RAD

OPEN_S = 5.0
LOOK_S = 5.0
CAMERA_STALE_S = 0.5
CLOCKS_APART = timedelta(seconds=5)
ROWS_S = 2.5  # for enough pairs to tell whether the calibration holds
DARK, BRIGHT = 20.0, 235.0  # mean code of a usable picture
WEAK_DBM = -100.0

Look = Callable[[], AsyncIterator[Finding]]


class Opens(Protocol):
    """What all devices have in common."""

    async def open(self) -> None: ...

    async def close(self) -> None: ...


async def examine(name: str, device: Opens, look: Look) -> list[Finding]:
    """Open, look, close. A device that cannot be opened says so in its own words."""
    found: list[Finding] = []
    try:
        async with asyncio.timeout(OPEN_S):
            await device.open()
    except DeviceError as error:
        return [of_device_error(name, "identity", error)]
    except TimeoutError:
        return [_silent(name, "identity", OPEN_S)]
    found.append(fine(name, "identity", "as configured"))
    try:
        async with asyncio.timeout(LOOK_S):
            async for finding in look():
                found.append(finding)
    except DeviceError as error:
        found.append(of_device_error(name, "reading", error))
    except TimeoutError:
        found.append(_silent(name, "reading", LOOK_S))
    with suppress(DeviceError):  # what is wrong with it stands in the table already
        await device.close()
    return found


def _silent(name: str, what: str, limit_s: float) -> Finding:
    return failure(name, what, "silence", f"an answer within {limit_s:g} s", "check its power and its cable",
                   UnavailableError.exit_code)  # fmt: skip


def _age(name: str, stamp_s: float, limit_s: float) -> Finding:
    age_s = asyncio.get_running_loop().time() - stamp_s
    if -0.001 <= age_s <= limit_s:
        return fine(name, "age of data", f"{1000 * age_s:.0f} ms")
    return warning(name, "age of data", f"{1000 * age_s:.0f} ms", f"at most {1000 * limit_s:.0f} ms",
                   "look for a slow or overloaded bus")  # fmt: skip


async def look_at_relay(board: RelayBoard) -> AsyncIterator[Finding]:
    """Everything off, and whether the board can end a pulse by itself."""
    state = await board.read()
    closed = sorted(channel for channel, on in state.coils.items() if on)
    if closed:
        yield failure("relay", "coils", f"{', '.join(closed)} on", "all off", "cut its power and change the relay",
                      UnavailableError.exit_code)  # fmt: skip
    else:
        yield fine("relay", "coils", f"{len(state.coils)} wired, all off")
    yield _age("relay", state.stamp_s, RELAY_STALE_S)
    capability = board.capability
    reason = refusal_for_automatic(capability)
    if reason is not None:
        yield warning("relay", "pulses", reason, "pulses that end without the host", "spray by hand only")
        return
    by = "the host, watched by the board" if capability.host_timed else "the board"
    yield fine("relay", "pulses", f"timed by {by}: {capability.pulse_quantum_s:g} to {capability.pulse_max_s:g} s")


async def look_at_inputs(inputs: Inputs) -> AsyncIterator[Finding]:
    """What would keep the robot from arming."""
    state = await inputs.read()
    yield _age("inputs", state.stamp_s, SENSORS_STALE_S)
    for name, pressed in (("e-stop", state.estop_pressed), ("bumper", state.bumper_pressed)):
        if pressed:
            yield warning("inputs", name, "pressed, or its wire is broken", "released", "release it; check its wire")
        else:
            yield fine("inputs", name, "released")
    tilt_rad = max(abs(state.roll_rad), abs(state.pitch_rad))
    if tilt_rad > TILT_MAX_RAD:
        yield warning("inputs", "tilt", f"{math.degrees(tilt_rad):.1f} deg", f"{math.degrees(TILT_MAX_RAD):.0f} deg",
                      "level the rover or mount the sensor level")  # fmt: skip
    else:
        yield fine("inputs", "tilt", f"{math.degrees(tilt_rad):.1f} deg")
    readings = f"{state.tank_level_ml:.0f} ml, {state.pressure_bar:.2f} bar, {state.battery_v:.1f} V"
    yield fine("inputs", "tank, pressure, battery", readings)


async def look_at_arm(arm: Arm) -> AsyncIterator[Finding]:
    """Joints and the servos' own errors."""
    state = await arm.state()
    yield _age("arm", state.stamp_s, ARM_STALE_S)
    yield fine("arm", "joints", ", ".join(f"{math.degrees(angle):.0f}" for angle in state.position_rad) + " deg")
    yield fine("arm", "torque", "on" if state.torque_on else "off")
    for name, error in zip(arm.joint_names, state.hardware_error, strict=True):
        if error:
            yield failure("arm", name, f"hardware error 0x{error:02x}", "none", "let it cool, free it, restart it",
                          UnavailableError.exit_code)  # fmt: skip
    if isinstance(arm, ServoArm):
        async for finding in servo_findings(arm):
            yield finding


async def look_at_wheels(wheels: Wheels) -> AsyncIterator[Finding]:
    """Counters, and that the base stops by itself."""
    odometry = await wheels.odometry()
    yield _age("wheels", odometry.stamp_s, ODOMETRY_STALE_S)
    yield fine("wheels", "counters", f"{odometry.left_m:.3f} m left, {odometry.right_m:.3f} m right")
    yield fine("wheels", "own time-out", f"{wheels.command_timeout_s:g} s")
    if isinstance(wheels, MotorWheels):
        async for finding in motor_findings(wheels):
            yield finding


async def look_at_gps(gps: Gps, simulated: bool) -> AsyncIterator[Finding]:
    """Quality, and its time against the computer's (a simulated sky has a time of its own)."""
    fix = await gps.next_fix()
    if fix.quality is FixQuality.NONE:
        yield warning("gps", "position", f"none, {fix.satellites} satellites", "a position",
                      "wait under open sky; check the antenna")  # fmt: skip
    else:
        accuracy = "" if fix.accuracy_m is None else f", {fix.accuracy_m:.2f} m"
        yield fine("gps", "position", f"{fix.quality.name.lower()}, {fix.satellites} satellites{accuracy}")
    if not simulated and fix.utc is not None and abs(fix.utc - datetime.now(UTC)) > CLOCKS_APART:
        yield warning("gps", "time", fix.utc.strftime("%Y-%m-%d %H:%M:%S UTC"), "the computer's time",
                      "one of the two clocks is wrong: see the clock's line")  # fmt: skip


async def look_at_modem(modem: Modem) -> AsyncIterator[Finding]:
    """Network and signal."""
    status = await modem.status()
    if not status.registered:
        yield warning("modem", "network", "not registered", "registered", "check antenna, SIM and coverage")
        return
    yield fine("modem", "network", status.operator or "registered")
    if status.signal_dbm is not None and status.signal_dbm < WEAK_DBM:
        yield warning("modem", "signal", f"{status.signal_dbm:.0f} dBm", f"{WEAK_DBM:.0f} dBm", "move the antenna")
    elif status.signal_dbm is not None:
        yield fine("modem", "signal", f"{status.signal_dbm:.0f} dBm")


async def look_at_camera(camera: StereoCamera) -> AsyncIterator[Finding]:
    """A pair of the right size that is neither black nor white."""
    frame = await camera.capture()
    yield _age("camera", frame.stamp_s, CAMERA_STALE_S)
    height, width = frame.left.shape[:2]
    yield fine("camera", "pictures", f"{width}x{height}, {1000 * frame.exposure_s:g} ms, gain {frame.gain:g}")
    for side, view in (("left view", frame.left), ("right view", frame.right)):
        mean = float(view.mean())
        if not DARK <= mean <= BRIGHT:
            yield warning("camera", side, f"mean brightness {mean:.0f}", f"{DARK:.0f} to {BRIGHT:.0f}",
                          "take the cover off, clean the lens, or correct camera.exposure_s")  # fmt: skip
    if isinstance(camera, WatchedCamera):
        yield await _rows(camera)


async def _rows(camera: WatchedCamera) -> Finding:
    """Whether points lie on the rows on which the calibration has them."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + ROWS_S
    while camera.watch.misalignment is None and loop.time() < until_s:
        await camera.capture()
    found = camera.watch.misalignment
    verdict = Verdict.UNSURE if found is None else found.verdict()
    if found is None or verdict is Verdict.UNSURE:
        return fine("camera", "rows", "cannot be told here: too little in view for both lenses")
    if verdict is Verdict.DECALIBRATED:
        return warning("camera", "rows", str(found), f"points on their rows to {SHIFT_LIMIT_PX:g} px",
                       "check with the board: sprayer calibrate check; then sprayer calibrate camera")  # fmt: skip
    return fine("camera", "rows", str(found))
