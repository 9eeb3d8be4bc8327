"""Sliding-mode control of yaw rate and sideslip in one surface."""

from dataclasses import dataclass
from typing import NamedTuple

from vse_gym.compiled import compiled
from vse_gym.controllers.moment import DEG, MomentControl, beyond, yaw_moment
from vse_gym.models import Nominal


class SlidingLaw(NamedTuple):
    """The surface and the way to it."""

    slope: float  # xi: yaw rate above its reference that a sideslip calls for [1/s]
    moment: float  # k [N m]
    width: float  # of the boundary layer [rad/s]
    band: float  # of the surface's variable that is let be [rad/s]


@yaw_moment.register(SlidingLaw)
@compiled
def _(law, error, sideslip, sideslip_rate, speed, friction):
    s = beyond(error - law.slope * sideslip, law.band)
    return -law.moment * max(-1.0, min(1.0, s / law.width))


@dataclass(frozen=True)
class SlidingModeControl(MomentControl):
    """M = -k sat(s/width) on s = (r - r_ref) - xi sideslip. Utkin (1977); boundary layer after Slotine, Li (1991).

    On s = 0 a sideslip to the left is met by turning further left, towards where the car goes:
    d sideslip/dt = -(a + c xi) sideslip with a, c > 0. With the other sign of xi that is unstable.
    """

    slope: float = 5.7  # xi [1/s]
    moment: float = 10e3  # k, about what one side's brakes can do [N m]
    width: float = 10 * DEG  # of the boundary layer [rad/s]
    band: float = 5 * DEG  # let be, because gentle driving has some sideslip [rad/s]

    def law(self, nominal: Nominal) -> SlidingLaw:
        return SlidingLaw(*map(float, (self.slope, self.moment, self.width, self.band)))
