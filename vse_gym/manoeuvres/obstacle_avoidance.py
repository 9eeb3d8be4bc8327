"""Obstacle avoidance: the lane change of ISO 3888-2."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import KMH
from vse_gym.manoeuvres.course import Course, Lane, course_of
from vse_gym.manoeuvres.followed import LEFT, Coned
from vse_gym.manoeuvres.path import Line
from vse_gym.manoeuvres.script import FOLLOW, Script, script_of
from vse_gym.physics import parameters as p
from vse_gym.types import Array

LENGTHS = (12.0, 13.5, 11.0, 12.5, 12.0)  # lane, swing, lane, swing, lane (k) [m]
GAP = 1.0  # between the inner borders of the first and the second lane (k) [m]
LIFTS = 2.0  # the accelerator is released so far into the first lane (k) [m]
AFTER = 10.0  # straight after the last lane (chosen) [m]
# What the driver makes of it (chosen): where in front of a lane's end he leaves it, how far in the next he arrives, and
# by how much he stays short of the middle of the second lane, which is wide
LEAVES, ARRIVES, SHORT = (1.5, 2.4), (2.6, 2.8), 0.1  # [m]


@lru_cache(maxsize=64)
def _lanes(width: float, start: float, side: float) -> tuple[Lane, Lane, Lane]:
    ends = list(accumulate((start, *LENGTHS)))
    first, second, third = 1.1 * width + 0.25, width + 1.0, min(1.3 * width + 0.25, 3.0)
    return (
        Lane(ends[0], ends[1], 0.0, first),
        Lane(ends[2], ends[3], side * (0.5 * first + GAP + 0.5 * second), second),
        Lane(ends[4], ends[5], side * 0.5 * (third - first), third),
    )


@lru_cache(maxsize=64)
def _line(width: float, start: float, side: float) -> Line:
    first, second, third = _lanes(width, start, side)
    return Line(
        (
            (first.end - LEAVES[0], second.begin + ARRIVES[0], second.centre - side * SHORT),
            (second.end - LEAVES[1], third.begin + ARRIVES[1], third.centre),
        )
    )


@lru_cache(maxsize=64)
def _course(width: float, start: float, side: float) -> Course:
    lanes = _lanes(width, start, side)
    x = np.arange(0.0, lanes[2].end + AFTER + 0.5)
    return course_of(lanes, np.column_stack((x, _line(width, start, side).at(x))))


@dataclass(frozen=True)
class ObstacleAvoidance(Coned):
    """Round an obstacle and back between cones, coasting: ISO 3888-2.

    Lanes of 12, 11 and 12 m, 13.5 and 12.5 m between them, 61 m in all (k); 1.1 times the car's width and 0.25 m, the
    width and 1 m, and 1.3 times the width and 0.25 m but at most 3 m wide; 1 m aside between the first and the second
    (k). The third shares the outer border of the first (chosen). The accelerator is released 2 m into the first lane
    (k). 55 km/h is chosen as a speed that every car of this package manages on dry road, without control.

    Judged by: no cone hit, no gate missed. Reported: least distance to a cone, largest sideslip, speed lost.
    """

    speed: float = 55 * KMH
    start: float = 30.0  # way to the first lane [m]

    not_negative: ClassVar[tuple[str, ...]] = ("start",)

    @property
    def length(self) -> float:
        return self.start + sum(LENGTHS) + AFTER

    @property
    def room(self) -> float:
        return 3.5 + LEFT

    def path(self, vehicle: p.Vehicle) -> Line:
        return _line(vehicle.width, self.start, self.side)

    def course(self, vehicle: p.Vehicle) -> Course:
        return _course(vehicle.width, self.start, self.side)

    def script(self, times: Array) -> Script:
        return script_of(times, FOLLOW, speed=self.speed, lifts=self.start + LIFTS)
