"""A gentle curve: a car that needs no help. What is braked here is braked in vain."""

import math
from dataclasses import dataclass
from typing import ClassVar

from vse_gym.manoeuvres.base import KMH, Criterion, Verdict
from vse_gym.manoeuvres.followed import LEFT, Followed, largest, strayed
from vse_gym.manoeuvres.path import Circle
from vse_gym.manoeuvres.scripted import Bounds
from vse_gym.manoeuvres.straight_driving import false_interventions
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Log


@dataclass(frozen=True)
class GentleCurve(Followed):
    """Straight on and then round a bend of 2 m/s2 at 90 km/h, the speed held: a car that needs no help.

    Judged by (limits chosen): distance from the line, needless brake energy. Reported: time of false interventions,
    sideslip.
    """

    speed: float = 90 * KMH
    duration: float = 8.0
    lateral: float = 2.0  # acceleration in the bend at the start speed [m/s2]
    side: float = 1.0  # of the bend: 1 to the left, -1 to the right
    straight: float = 2.0  # way to the bend at the start speed [s]

    positive: ClassVar[tuple[str, ...]] = ("lateral",)
    not_negative: ClassVar[tuple[str, ...]] = ("straight",)

    def path(self, vehicle: p.Vehicle) -> Circle:
        return Circle(self.side * self.speed**2 / self.lateral, self.straight * self.speed)

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(self.path(vehicle), LEFT)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """No standard has limits here; these are chosen so that a driver would not notice anything."""
        away = largest(strayed(self.path(nominal.vehicle), log))
        return Verdict(
            (
                Criterion("largest distance from the line", away, 0.5, "m"),
                *false_interventions(log),
                Criterion("largest sideslip", math.degrees(log.peak_sideslip), 3.0, "deg", judged=False),
            )
        )
