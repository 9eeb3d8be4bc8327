"""Braking, in a bend or straight on, over a jump of the road's friction."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict
from vse_gym.manoeuvres.followed import LEFT, Followed, largest, stopping_distance, strayed, turned_away
from vse_gym.manoeuvres.path import STRAIGHT, Circle, Path
from vse_gym.manoeuvres.script import FOLLOW, Script, script_of
from vse_gym.manoeuvres.scripted import Bounds
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log


@dataclass(frozen=True)
class FrictionJump(Followed):
    """The driver brakes in a gentle bend, and the road turns slippery under him, or the other way round.

    After the transitions between high and low friction of UN R13, annex 13 (k), and with a bend (chosen). ``lateral``
    is the bend's lateral acceleration at the start speed; with 0 the road is straight.

    Judged by (limits chosen): sideslip, and the distance from the line. Reported: deviation of the heading from the
    line's, stopping distance.
    """

    duration: float = 9.0
    friction_after: float = 0.35  # [-]
    jump: float = 2.0  # when a car at the start speed meets the other friction [s]
    lateral: float = 1.0  # [m/s2]
    side: float = 1.0  # of the bend: 1 to the left, -1 to the right
    straight: float = 0.5  # way to the bend at the start speed [s]
    begin: float = 1.5  # of braking [s]
    deceleration: float = 5.0  # that the driver asks for [m/s2]

    positive: ClassVar[tuple[str, ...]] = ("jump",)
    not_negative: ClassVar[tuple[str, ...]] = ("begin", "deceleration", "lateral", "straight")

    def road(self) -> p.Road:
        return p.road((0.0, self.friction), (self.jump * self.speed, self.friction_after))

    def path(self, vehicle: p.Vehicle) -> Path:
        if self.lateral == 0:
            return STRAIGHT
        return Circle(self.side * self.speed**2 / self.lateral, self.straight * self.speed)

    def script(self, times: Array) -> Script:
        brakes = times >= self.begin
        speed, slowing = np.where(brakes, math.nan, self.speed), np.where(brakes, self.deceleration, 0.0)
        return script_of(times, FOLLOW, speed=speed, deceleration=slowing)

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(self.path(vehicle), LEFT)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """Sideslip and distance from the line."""
        path = self.path(nominal.vehicle)
        return Verdict(
            (
                Criterion("largest sideslip", math.degrees(log.peak_sideslip), 10, "deg"),
                Criterion("largest distance from the line", largest(strayed(path, log)), 1.0, "m"),
                Criterion(
                    "largest deviation of the heading", largest(turned_away(path, log)) / DEG, 10, "deg", judged=False
                ),
                Criterion("stopping distance", stopping_distance(log, self.begin), 100, "m", judged=False),
            )
        )
