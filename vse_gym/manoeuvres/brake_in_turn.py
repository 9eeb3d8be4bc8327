"""Braking in a turn: ISO 7975."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict
from vse_gym.manoeuvres.followed import Followed, largest, stopping_distance, strayed
from vse_gym.manoeuvres.path import Circle
from vse_gym.manoeuvres.script import FOLLOW, HOLD, TURN_TO, Script, ramp, script_of
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log

LOOKS = 1.0  # after the begin of braking, at which the yaw rate is compared (k) [s]


@dataclass(frozen=True)
class BrakeInTurn(Followed):
    """Round a circle at a steady speed, then a step of the brakes with the hand wheel held where it is: ISO 7975.

    The standard's circle of 100 m (k) at 80 km/h (chosen: 4.9 m/s2); the driver follows it until he brakes. With an
    ``amplitude`` he turns the hand wheel to that angle instead and holds it from the start.

    Judged by (chosen): sideslip; and, where the driver follows the circle, how far the car strays from it in the first
    second, so that one that ploughs straight on fails as well as one that turns in. Reported: the yaw rate 1 s after
    the begin of braking over that of the same circle at the speed then (k), largest deceleration, stopping distance.
    """

    duration: float = 10.0
    radius: float = 100.0  # of the circle, positive whatever the side [m]
    side: float = 1.0  # 1 to the left, -1 to the right
    amplitude: float | None = (
        None  # of a hand wheel held from ``begin`` on, positive left; None: follow the circle [rad]
    )
    rate: float = 400 * DEG  # at which it gets there [rad/s]
    begin: float = 0.5  # of steer, with an amplitude [s]
    brake: float = 4.0  # when the driver brakes [s]
    deceleration: float = 0.5 * p.GRAVITY  # that he asks for [m/s2]

    positive: ClassVar[tuple[str, ...]] = ("brake", "deceleration", "radius", "rate")

    def path(self, vehicle: p.Vehicle) -> Circle:
        return Circle(self.side * self.radius)

    def script(self, times: Array) -> Script:
        brakes = times >= self.brake
        speed, slowing = np.where(brakes, math.nan, self.speed), np.where(brakes, self.deceleration, 0.0)
        if self.amplitude is None:
            return script_of(times, np.where(brakes, HOLD, FOLLOW), speed=speed, deceleration=slowing)
        turned = ramp(times, self.amplitude, self.rate, self.begin)
        return script_of(times, TURN_TO, turned, speed, deceleration=slowing)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The largest sideslip is judged; the standard has no limits."""
        yaw_rate, speed = log.truth[:, p.YAW_RATE], np.hypot(log.truth[:, p.VX], log.truth[:, p.VY])
        before, then = (
            [float(np.interp(when, log.time, values, right=math.nan)) for values in (yaw_rate, speed)]
            for when in (self.brake, self.brake + LOOKS)
        )
        steady = before[0] / before[1] * then[1] if before[1] > 0 else math.nan
        ratio = then[0] / steady if abs(steady) > 0 else math.nan
        braking = log.truth[log.time >= self.brake, p.AX]
        first = (log.time >= self.brake) & (log.time <= self.brake + LOOKS)
        away = largest(strayed(self.path(nominal.vehicle), log)[first])
        return Verdict(
            (
                Criterion("largest sideslip", math.degrees(log.peak_sideslip), 10, "deg"),
                Criterion("strays from the circle within 1 s", away, 1.0, "m", judged=self.amplitude is None),
                Criterion("yaw rate over that of the circle after 1 s", ratio, 1.3, "", judged=False),
                Criterion("largest deceleration", -float(np.min(braking, initial=0.0)), 9.81, "m/s2", judged=False),
                Criterion("stopping distance", stopping_distance(log, self.brake), 100, "m", judged=False),
            )
        )
