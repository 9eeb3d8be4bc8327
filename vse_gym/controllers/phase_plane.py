"""Control by the stable region of the phase plane of sideslip and its rate."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.controllers.moment import MomentControl, beyond, yaw_moment
from vse_gym.models import Nominal
from vse_gym.types import Array


class PhasePlaneLaw(NamedTuple):
    """The band's constants over friction, and the gain beyond it."""

    frictions: Array  # rising, (n,)
    on_sideslip: Array  # B1, (n,) [1/rad]
    on_rate: Array  # B2, (n,) [s/rad]
    share: float  # of the stable band that is let be [-]
    gain: float  # K, on the excess beyond that [N m]


@compiled
def between(x, xs, ys):
    """Linear interpolation in a table of rising xs (n,), held at its ends."""
    for k in range(1, xs.size):
        if x <= xs[k]:
            share = max(0.0, (x - xs[k - 1]) / (xs[k] - xs[k - 1]))
            return ys[k - 1] + share * (ys[k] - ys[k - 1])
    return ys[xs.size - 1]


@yaw_moment.register(PhasePlaneLaw)
@compiled
def _(law, error, sideslip, sideslip_rate, speed, friction):
    place = between(friction, law.frictions, law.on_sideslip) * sideslip
    place += between(friction, law.frictions, law.on_rate) * sideslip_rate
    return law.gain * beyond(place, law.share)


@dataclass(frozen=True)
class PhasePlaneControl(MomentControl):
    """Nothing while |B1 sideslip + B2 d sideslip/dt| < share, then K times the excess. Inagaki et al. (AVEC 1994).

    At 1 the uncontrolled car no longer comes back: waiting for that keeps it from spinning, at some 30 deg of
    sideslip. B1 and B2 go by friction: that of the estimate if it has one, else the nominal one.
    """

    frictions: tuple[float, ...] = (0.2, 0.5, 0.9)  # [-]
    on_sideslip: tuple[float, ...] = (3.75, 3.25, 2.25)  # B1, middle of what a prototype's trajectories fit [1/rad]
    on_rate: tuple[float, ...] = (5.0, 1.8, 0.8)  # B2, likewise [s/rad]
    share: float = 0.4  # of the stable band that is let be [-]
    gain: float = 50e3  # K [N m]

    def law(self, nominal: Nominal) -> PhasePlaneLaw:
        on_sideslip, on_rate = np.array(self.on_sideslip, dtype=float), np.array(self.on_rate, dtype=float)
        frictions = np.array(self.frictions, dtype=float)
        return PhasePlaneLaw(frictions, on_sideslip, on_rate, float(self.share), float(self.gain))
