"""Braking on a road that is slippery on one side: ISO 14512."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict
from vse_gym.manoeuvres.followed import LEFT, Followed, largest, stopping_distance, strayed, true_vehicle, turned_away
from vse_gym.manoeuvres.path import STRAIGHT, Path
from vse_gym.manoeuvres.script import FOLLOW, Script, script_of
from vse_gym.manoeuvres.scripted import Bounds
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log

LANE = 3.5  # width (k) [m]
BEFORE = 5.0  # the split begins so far before the car starts to brake, so that all wheels are on it (chosen) [m]


@dataclass(frozen=True)
class SplitFrictionBraking(Followed):
    """The driver brakes hard on a road that is slippery on one side, and keeps to his lane: ISO 14512.

    Friction 0.8 and 0.3 and 80 km/h are chosen, within the usual condition of a ratio of at least two (k). He presses
    for 1 g (chosen), more than either side can give; the brake unit is the ABS, so that no wheel locks, and lets the
    good side's torque rise slowly, so that he has time to steer against it.
    What lies left and right moves with the car: the car's own left wheels are on the left friction, which is right as
    long as it keeps its lane, and that is judged.

    Judged by (limits chosen): heading, and the body within a lane of 3.5 m. Reported: stopping distance from the begin
    of braking; the hand wheel in the first two seconds and in all, beside the 120 and 240 deg of UN R13, annex 13 (k).
    """

    friction: float = 0.8  # of the other side, and of the road before [-]
    duration: float = 10.0
    side: float = 1.0  # that is slippery: 1 left, -1 right
    friction_low: float = 0.3  # of that side [-]
    begin: float = 1.0  # of braking, at the start speed [s]
    deceleration: float = p.GRAVITY  # that the driver asks for [m/s2]

    positive: ClassVar[tuple[str, ...]] = ("deceleration", "begin")
    not_negative: ClassVar[tuple[str, ...]] = ()

    def road(self) -> p.Road:
        high, low = self.friction, self.friction_low
        plain = p.road((0.0, high), (max(0.1, self.speed * self.begin - BEFORE), low))
        other = np.full(2, high)
        slippery = plain.friction_left
        left, right = (slippery, other) if self.side > 0 else (other, slippery)
        return plain._replace(friction_left=left, friction_right=right)

    def path(self, vehicle: p.Vehicle) -> Path:
        return STRAIGHT

    def script(self, times: Array) -> Script:
        brakes = times >= self.begin
        speed, slowing = np.where(brakes, math.nan, self.speed), np.where(brakes, self.deceleration, 0.0)
        return script_of(times, FOLLOW, speed=speed, deceleration=slowing)

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(STRAIGHT, LEFT)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """Heading and lane are judged until the car stands; a drive that ends before has no stopping distance."""
        path = self.path(nominal.vehicle)
        vehicle = true_vehicle(log, nominal)
        reach = 0.5 * vehicle.width * np.cos(log.truth[:, p.YAW]) + max(
            vehicle.lf + vehicle.front_overhang, vehicle.lr + vehicle.rear_overhang
        ) * np.abs(np.sin(log.truth[:, p.YAW]))
        wheel = np.abs(log.hand_wheel) / DEG
        early = wheel[log.time <= self.begin + 2.0]
        return Verdict(
            (
                Criterion("largest deviation of the heading", largest(turned_away(path, log)) / DEG, 10, "deg"),
                Criterion(
                    "reach of the body from the lane's middle",
                    largest(np.abs(strayed(path, log)) + reach),
                    LANE / 2,
                    "m",
                ),
                Criterion("stopping distance", stopping_distance(log, self.begin), 100, "m", judged=False),
                Criterion("largest hand wheel in the first 2 s", largest(early), 120, "deg", judged=False),
                Criterion("largest hand wheel", largest(wheel), 240, "deg", judged=False),
            )
        )
