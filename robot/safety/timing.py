"""Every deadline of the safety envelope in one place; code, tests and documents import it."""

SENSORS_STALE_S = 0.5
ODOMETRY_STALE_S = 0.3
ARM_STALE_S = 0.3
RELAY_STALE_S = 1.0
CLOSE_DEADLINE_S = 0.4
CLOSE_TRIES = 3
PULSE_HARD_MAX_S = 5.0
BASE_STILL_M_S = 0.01
FRAME_MOTION_MAX_M = 0.005
MINUTE_S = 60.0
TILT_MAX_RAD = 0.26
LOOP_STALL_S = 0.25
