"""What the driver is taken to want: the reference yaw rate."""

import math
from typing import NamedTuple

from vse_gym.compiled import compiled
from vse_gym.physics.parameters import GRAVITY


class Reference(NamedTuple):
    """What the driver is taken to want: the yaw rate of a mildly understeering car, within what the road bears."""

    wheelbase: float  # [m]
    understeer: float  # K of the wanted car, not of the real one, which may oversteer [rad s2/m]
    friction: float  # nominal [-]
    lag: float  # [s]
    release: float  # time in which the envelope of |ay| forgets [s]
    dt: float  # [s]


@compiled
def follow_reference(reference, wanted, envelope, vx, ay, steer):
    """Reference yaw rate [rad/s] and envelope of |ay| [m/s2] one step on, from those before.

    |r| <= min(0.85 mu g, 1.2 envelope + 2.5)/v: the second limit learns the road's friction from what the car does.
    """
    speed = max(vx, 1.0)
    envelope = max(abs(ay), envelope * math.exp(-reference.dt / reference.release))
    steady = speed * steer / (reference.wheelbase + reference.understeer * speed * speed)
    limit = min(0.85 * reference.friction * GRAVITY, 1.2 * envelope + 2.5) / speed
    steady = max(-limit, min(limit, steady))
    return wanted + (1 - math.exp(-reference.dt / reference.lag)) * (steady - wanted), envelope
