"""A held hand wheel, and a road whose friction may change under the turning car."""

import math
from dataclasses import dataclass
from typing import ClassVar

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict
from vse_gym.manoeuvres.script import TURN_TO, Script, ramp, script_of
from vse_gym.manoeuvres.scripted import Scripted
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log


@dataclass(frozen=True)
class HeldSteer(Scripted):
    """The hand wheel turns to an angle and stays there; with ``friction_after`` the road's friction jumps.

    Raises:
        ValueError: If friction_after is not in (0, 2], or jump is not positive.
    """

    amplitude: float = 60 * DEG  # of the hand wheel, positive to the left [rad]
    rate: float = 400 * DEG  # at which it gets there [rad/s]
    begin: float = 0.5  # of steer [s]
    friction_after: float | None = None  # None: no jump [-]
    jump: float = 1.8  # when a car at the start speed meets the other friction [s]

    positive: ClassVar[tuple[str, ...]] = ("jump", "rate")

    def road(self) -> p.Road:
        if self.friction_after is None:
            return super().road()
        return p.road((0.0, self.friction), (self.jump * self.speed, self.friction_after))

    def script(self, times: Array) -> Script:
        return script_of(times, TURN_TO, ramp(times, self.amplitude, self.rate, self.begin))

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """No standard has limits here; chosen: the car still points where it goes, to within 15 deg."""
        sideslip = math.degrees(log.peak_sideslip)
        return Verdict((Criterion("largest sideslip", sideslip, 15.0, "deg"),))
