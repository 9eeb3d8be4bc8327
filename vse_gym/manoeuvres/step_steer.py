"""Step steer: the transient response of ISO 7401."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict, held_together, lateral_acceleration
from vse_gym.manoeuvres.script import TURN_TO, Script, ramp, script_of
from vse_gym.manoeuvres.scripted import Scripted
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log

SETTLED = 0.5  # the steady state is the mean of so much at the end of the drive (chosen) [s]


@dataclass(frozen=True)
class StepSteer(Scripted):
    """The hand wheel turns fast to an angle and stays there, at a steady speed: ISO 7401.

    80 km/h, at least 200 deg/s, and an amplitude that makes about 4 m/s2 (k); 25 deg is right for the understeering
    sister, other cars want other angles.

    Judged by (chosen): sideslip. Reported, times from when the hand wheel has turned half its way (k): yaw rate and
    lateral acceleration until 90 % of the steady value (k), first peak of the yaw rate, overshoot, steady gain.
    """

    duration: float = 5.0
    amplitude: float = 25 * DEG  # of the hand wheel, positive to the left [rad]
    rate: float = 400 * DEG  # at which it gets there [rad/s]
    begin: float = 0.5  # of steer [s]

    positive: ClassVar[tuple[str, ...]] = ("rate",)

    def script(self, times: Array) -> Script:
        return script_of(times, TURN_TO, ramp(times, self.amplitude, self.rate, self.begin), self.speed)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """No limits in the standard but what it reports."""
        half = self.begin + 0.5 * abs(self.amplitude) / self.rate
        side = math.copysign(1.0, self.amplitude)
        yaw_rate, ay = side * log.truth[:, p.YAW_RATE], side * lateral_acceleration(log)
        end = log.time > log.time[-1] - SETTLED
        steady, cornering = float(np.mean(yaw_rate[end])), float(np.mean(ay[end]))
        peak = int(np.argmax(yaw_rate))
        angle = abs(self.amplitude)
        over = 100 * (float(yaw_rate[peak]) / steady - 1) if steady > 0 else math.nan
        return Verdict(
            (
                held_together(log),
                Criterion(
                    "response time of the yaw rate",
                    _reaches(log.time, yaw_rate, 0.9 * steady) - half,
                    0.5,
                    "s",
                    judged=False,
                ),
                Criterion(
                    "response time of the lateral acceleration",
                    _reaches(log.time, ay, 0.9 * cornering) - half,
                    0.7,
                    "s",
                    judged=False,
                ),
                Criterion("peak time of the yaw rate", float(log.time[peak]) - half, 1.0, "s", judged=False),
                Criterion("overshoot of the yaw rate", over, 30, "%", judged=False),
                Criterion(
                    "steady gain of the yaw rate", steady / angle if angle else math.nan, 1.0, "1/s", judged=False
                ),
                Criterion("steady lateral acceleration", cornering, 4.0, "m/s2", judged=False),
            )
        )


def _reaches(time: Array, values: Array, level: float) -> float:
    """When values first reach a level, by straight lines between the instants; NaN if never [s]."""
    above = np.nonzero(values >= level)[0]
    if not above.size or not level > 0:
        return math.nan
    k = int(above[0])
    if k == 0:
        return float(time[0])
    return float(np.interp(level, values[k - 1 : k + 1], time[k - 1 : k + 1]))
