"""Every deadline and threshold of the safety envelope in one place; code, tests and documents import it."""

import math

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
TILT_MAX_RAD = 0.26                  # neither motion nor spray beyond 15 degrees
TILT_STOP_RAD = math.radians(25.0)   # latched beyond
LEASE_BEAT_S, LEASE_LOST_S = 0.1, 0.5
LEASE_FREED_S = 5.0                  # others may take a lease that has been silent for so long
LOOP_STALL_S = 0.25
ROLLING_M_S = 0.05                   # nobody asked the base to roll, and it does
COAST_S = 1.5                        # the longest way from full speed to a stop
SELF_RESUME_MAX_M = 0.2              # a base that moved farther while paused does not go on by itself
FENCE_DRIVE_BACK_M_S = 0.1           # by hand, outside of the geofence
