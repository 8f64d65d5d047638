"""Where a moving joint can come to rest within its limits."""

from __future__ import annotations

from drivers.arm.control_tables import TICK_RAD, VELOCITY_UNIT_RAD_S
from drivers.arm.joints import JointSettings, ServoSettings
from drivers.arm.register_blocks import Stopping

SLOW_UNITS = 2  # a velocity reading below this many units is noise
OFF_GOAL_RAD = 0.05  # a joint at rest this far from its goal is held up by something
LAG_RAD = 0.12  # a joint farther behind its servo's trajectory does not follow it any more


def stop_angle(
    joint: JointSettings,
    servo: ServoSettings,
    now: Stopping,
    lead_s: float,
    deceleration_rad_s2: float,
    streamed_rad_s: float | None = None,
) -> float | None:
    """The angle at which the joint comes to rest when it brakes ``lead_s`` from the reading; None: it rests already.

    The servo's own trajectory is what brakes (registers 136, 140), so the stop is reckoned from there and the joint
    does not come back; a joint that is held up stops where it is. ``streamed_rad_s``: how fast the goals now move.
    """
    if _rests(now) and not streamed_rad_s:
        return None
    if abs(now.position_trajectory - now.position) * TICK_RAD > LAG_RAD:
        speed_rad_s, tick = servo.direction * now.velocity * VELOCITY_UNIT_RAD_S, now.position
    else:
        own_rad_s = servo.direction * (now.velocity_trajectory or now.velocity) * VELOCITY_UNIT_RAD_S
        speed_rad_s, tick = own_rad_s if streamed_rad_s is None else streamed_rad_s, now.position_trajectory
    return stopped(joint, servo.angle_of(tick) + lead_s * speed_rad_s, speed_rad_s, deceleration_rad_s2)


def _rests(now: Stopping) -> bool:
    """Neither moving nor held up on the way to a goal."""
    still = abs(now.velocity) < SLOW_UNITS and now.velocity_trajectory == 0
    return still and abs(now.goal - now.position) * TICK_RAD <= OFF_GOAL_RAD


def stopped(joint: JointSettings, angle_rad: float, speed_rad_s: float, deceleration_rad_s2: float) -> float:
    """Where a motion ends that brakes from here, inside the joint's limits."""
    angle = angle_rad + speed_rad_s * abs(speed_rad_s) / (2.0 * deceleration_rad_s2)
    return min(max(angle, joint.low_rad), joint.high_rad)
