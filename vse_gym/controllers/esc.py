"""Electronic stability control as in production: proportional to what exceeds bands of yaw rate error and sideslip."""

from dataclasses import dataclass
from typing import NamedTuple

from vse_gym.compiled import compiled
from vse_gym.controllers.moment import DEG, MomentControl, beyond, yaw_moment
from vse_gym.models import Nominal


class EscLaw(NamedTuple):
    """Gains from errors to yaw moment."""

    yaw_gain: float  # [N m s/rad]
    yaw_band: float  # yaw rate error that is let be [rad/s]
    sideslip_gain: float  # on what exceeds the band [N m/rad]
    sideslip_band: float  # [rad]
    sideslip_rate_gain: float  # only while sideslip exceeds its band [N m s/rad]


@yaw_moment.register(EscLaw)
@compiled
def _(law, error, sideslip, sideslip_rate, speed, friction):
    moment = -law.yaw_gain * beyond(error, law.yaw_band)
    excess = beyond(sideslip, law.sideslip_band)
    if excess != 0:
        moment += law.sideslip_gain * excess + law.sideslip_rate_gain * sideslip_rate
    return moment


@dataclass(frozen=True)
class StabilityControl(MomentControl):
    """C1, as in production: yaw rate first, sideslip where it grows beyond a band."""

    yaw_gain: float = 45e3  # [N m s/rad]
    yaw_band: float = 2.5 * DEG  # [rad/s]
    sideslip_gain: float = 120e3  # [N m/rad]
    sideslip_band: float = 3 * DEG  # [rad]
    sideslip_rate_gain: float = 15e3  # [N m s/rad]

    def law(self, nominal: Nominal) -> EscLaw:
        gains = (self.yaw_gain, self.yaw_band, self.sideslip_gain, self.sideslip_band, self.sideslip_rate_gain)
        return EscLaw(*map(float, gains))


@dataclass(frozen=True)
class SideslipStabilityControl(StabilityControl):
    """C2, sideslip first: no yaw-rate term at all, so that the sideslip estimate decides."""

    yaw_gain: float = 0.0
    sideslip_gain: float = 200e3
    sideslip_band: float = 1.5 * DEG
    sideslip_rate_gain: float = 30e3
