"""Sine steer: periods of a sine of the hand wheel within a window of time."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict, held_together, lateral_acceleration
from vse_gym.manoeuvres.followed import largest
from vse_gym.manoeuvres.script import TURN_TO, Script, script_of, sine
from vse_gym.manoeuvres.scripted import Scripted
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log


@dataclass(frozen=True)
class SineSteer(Scripted):
    """The hand wheel as a sine between two times, straight before and after, at a steady speed.

    As it is: one period of 4 s and 60 deg from 2 to 6 s at 80 km/h, of Tian, Zhang, Wang, Chen (2018), J. Jilin
    University (Engineering). With ``period=2, stop=8``, 60 km/h and friction 0.85: of Wang, Wei, Zhao, Zhang, Yan
    (2017), doi:10.3969/j.issn.1004-132X.2017.06.019.

    Judged by (chosen): sideslip. Reported: largest yaw rate and lateral acceleration.
    """

    duration: float = 8.0
    amplitude: float = 60 * DEG  # of the hand wheel, positive: first to the left [rad]
    period: float = 4.0  # [s]
    begin: float = 2.0  # [s]
    stop: float = 6.0  # [s]

    positive: ClassVar[tuple[str, ...]] = ("period",)

    def hand_wheel(self, times: Array) -> Array:
        """Angle of the hand wheel, (steps,) [rad]."""
        angle, turning = np.zeros(times.shape), (times > self.begin) & (times < self.stop)
        angle[turning] = self.amplitude * sine(2 * math.pi * (times[turning] - self.begin) / self.period)
        return angle

    def script(self, times: Array) -> Script:
        return script_of(times, TURN_TO, self.hand_wheel(times), self.speed)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The largest sideslip is judged."""
        aside = largest(lateral_acceleration(log))
        return Verdict(
            (
                held_together(log),
                Criterion("largest yaw rate", largest(log.truth[:, p.YAW_RATE]) / DEG, 30, "deg/s", judged=False),
                Criterion("largest lateral acceleration", aside, 9.81, "m/s2", judged=False),
                Criterion("speed lost", float(log.truth[0, p.VX] - log.truth[-1, p.VX]), 1.0, "m/s", judged=False),
            )
        )
