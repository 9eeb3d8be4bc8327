"""Steady-state circle: the understeer gradient of ISO 4138."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, KMH, Criterion, Verdict, lateral_acceleration
from vse_gym.manoeuvres.followed import LEFT, Followed, largest, strayed, true_vehicle
from vse_gym.manoeuvres.path import Circle
from vse_gym.manoeuvres.script import FOLLOW, Script, script_of
from vse_gym.manoeuvres.scripted import Bounds
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log

FITTED = 3.0  # lateral acceleration up to which the gradient is fitted, on friction 0.9 (chosen) [m/s2]


@dataclass(frozen=True)
class SteadyCircle(Followed):
    """Round a circle of constant radius, faster and faster, so slowly that each instant is a steady state: ISO 4138.

    100 m (k), from 30 km/h on at 0.1 m/s2 until 3.2 m/s2 of lateral acceleration (chosen).

    Judged by (chosen): distance from the circle, and that the car cornered at 3 m/s2, so that the fit has its data.
    Reported: understeer gradient, in road-wheel angle, at small lateral acceleration; theory's stands as its limit.
    """

    speed: float = 30 * KMH
    duration: float = 105.0
    radius: float = 100.0  # [m]
    side: float = 1.0  # 1 to the left, -1 to the right
    settle: float = 5.0  # time at the start speed before it rises [s]
    gain: float = 0.1  # of speed [m/s2]
    most: float = 3.2  # lateral acceleration at which the speed stays [m/s2]

    positive: ClassVar[tuple[str, ...]] = ("gain", "most", "radius")
    not_negative: ClassVar[tuple[str, ...]] = ("settle",)

    def path(self, vehicle: p.Vehicle) -> Circle:
        return Circle(self.side * self.radius)

    def script(self, times: Array) -> Script:
        last = max(self.speed, math.sqrt(self.most * self.radius))
        rising = self.speed + self.gain * np.maximum(0.0, times - self.settle)
        return script_of(times, FOLLOW, speed=np.minimum(last, rising))

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(self.path(vehicle), LEFT)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The circle must be kept and 3 m/s2 reached; the gradient is reported."""
        settled = log.time >= self.settle
        away = largest(strayed(self.path(nominal.vehicle), log)[settled])
        theory = true_vehicle(log, nominal).understeer_gradient / DEG * p.GRAVITY
        reached = largest(lateral_acceleration(log))
        return Verdict(
            (
                Criterion("largest distance from the circle", away, 1.0, "m"),
                Criterion("largest lateral acceleration", reached, FITTED, "m/s2", at_least=True),
                Criterion(
                    "understeer gradient",
                    understeer_gradient(log, self.settle) / DEG * p.GRAVITY,
                    theory,
                    "deg/g",
                    judged=False,
                ),
            )
        )


def understeer_gradient(log: Log, since: float, most: float = FITTED) -> float:
    """Slope at no lateral acceleration of the road-wheel angle beyond that of a car without sideslip [rad s2/m].

    The angle is fitted, from a time on and up to a lateral acceleration, by a length times the curvature and a cubic in
    the lateral acceleration, whose higher terms take up the tyres' softening. NaN if there is too little to fit.
    """
    speed, aside = np.hypot(log.truth[:, p.VX], log.truth[:, p.VY]), lateral_acceleration(log)
    use = (log.time >= since) & (np.abs(aside) <= most) & (speed > 1.0)
    if np.count_nonzero(use) < 100:
        return math.nan
    curvature = log.truth[use, p.YAW_RATE] / speed[use]
    side = math.copysign(1.0, float(np.mean(curvature)))
    ay = side * aside[use]
    columns = np.column_stack((side * curvature, ay, ay**2, ay**3))
    return float(np.linalg.lstsq(columns, side * log.steer[use], rcond=None)[0][1])
