"""Why a drive is over before its time is up."""

import math

from vse_gym.compiled import compiled
from vse_gym.physics.parameters import VX, VY, YAW_RATE

SPIN = math.radians(80)  # sideslip beyond which a drive is over
FASTEST = 150.0  # an estimate of a higher speed ends a drive [m/s]
SLOWEST_SPIN = 1.0  # below this speed the direction of travel means nothing [m/s]
ENDINGS = (
    "",
    "state not finite",
    "estimate not finite",
    "estimate absurd",
    "spin",
    "beyond the multi-body model",
    "off course",
)
GOES_ON, STATE, ESTIMATE, ABSURD, SPUN, BEYOND_MODEL, OFF_COURSE = range(len(ENDINGS))


@compiled
def ending(state, motion):
    """Which of ENDINGS the car and the estimate have met, as a number; what the course says is not asked here.

    Args:
        state: Of the plant, (STATE_SIZE,).
        motion: Estimated vx, vy, yaw rate, ax, ay, (5,).
    """
    vx, vy = state[VX], state[VY]
    if not math.isfinite(vx + vy + state[YAW_RATE]):
        return STATE
    if not math.isfinite(motion[0] + motion[1] + motion[2] + motion[4]):
        return ESTIMATE
    if math.hypot(motion[0], motion[1]) > FASTEST:
        return ABSURD
    if abs(math.atan2(vy, vx)) > SPIN and math.hypot(vx, vy) > SLOWEST_SPIN:
        return SPUN
    return GOES_ON
