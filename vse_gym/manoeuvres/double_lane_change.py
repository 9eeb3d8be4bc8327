"""The severe double lane change of ISO 3888-1."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.course import Course, Lane, course_of
from vse_gym.manoeuvres.followed import LEFT, Coned
from vse_gym.manoeuvres.path import Line
from vse_gym.physics import parameters as p

LENGTHS = (15.0, 30.0, 25.0, 25.0, 15.0)  # lane, swing, lane, swing, lane (k) [m]
EXIT = 15.0  # straight after the last lane (k) [m]
# What the driver makes of it (chosen): he leaves a lane so long before its end and has reached the next so far in it
LEAVES, ARRIVES = (3.0, 4.0), (4.5, 5.0)  # [m]


@lru_cache(maxsize=64)
def _course(width: float, start: float, offset: float) -> Course:
    ends = list(accumulate((start, *LENGTHS)))
    lanes = (
        Lane(ends[0], ends[1], 0.0, 1.1 * width + 0.25),
        Lane(ends[2], ends[3], offset, 1.2 * width + 0.25),
        Lane(ends[4], ends[5], 0.0, 1.3 * width + 0.25),
    )
    x = np.arange(0.0, ends[5] + EXIT + 0.5)
    return course_of(lanes, np.column_stack((x, _line(start, offset).at(x))))


@lru_cache(maxsize=64)
def _line(start: float, offset: float) -> Line:
    ends = list(accumulate((start, *LENGTHS)))
    return Line(
        (
            (ends[1] - LEAVES[0], ends[2] + ARRIVES[0], offset),
            (ends[3] - LEAVES[1], ends[4] + ARRIVES[1], 0.0),
        )
    )


@dataclass(frozen=True)
class DoubleLaneChange(Coned):
    """Over into the neighbouring lane and back between cones, at a held speed: ISO 3888-1.

    Lanes of 15, 25 and 15 m, 30 and 25 m between them, and 15 m of exit (k); 1.1, 1.2 and 1.3 times the car's width,
    and 0.25 m, wide (k); the middles 3.5 m apart, the third in line with the first (chosen: editions differ). The
    cones' bases touch the lanes from outside and stand at most 5 m apart (chosen). 80 km/h is the standard's speed (k);
    there the driver clears it with every car of this package on dry road, without control.

    Judged by: no cone hit, no gate missed. Reported: least distance to a cone, largest sideslip, speed lost.
    """

    offset: float = 3.5  # between the middles of the lanes [m]
    start: float = 30.0  # way to the first lane [m]

    positive: ClassVar[tuple[str, ...]] = ("offset",)
    not_negative: ClassVar[tuple[str, ...]] = ("start",)

    @property
    def length(self) -> float:
        return self.start + sum(LENGTHS) + EXIT

    @property
    def room(self) -> float:
        return self.offset + LEFT

    def path(self, vehicle: p.Vehicle) -> Line:
        return _line(self.start, self.side * self.offset)

    def course(self, vehicle: p.Vehicle) -> Course:
        return _course(vehicle.width, self.start, self.side * self.offset)
