"""Slalom round cones that stand in a row."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import KMH
from vse_gym.manoeuvres.course import CONE, Course
from vse_gym.manoeuvres.followed import LEFT, Coned
from vse_gym.manoeuvres.path import Line
from vse_gym.physics import parameters as p

ROOM = 0.45  # that the driver leaves between the car's side and a cone (chosen) [m]
GATE = 4.0  # a cone counts as passed on its side if the car was so near (chosen) [m]


@lru_cache(maxsize=64)
def _line(width: float, start: float, spacing: float, cones: int, side: float) -> Line:
    aside = side * (0.5 * width + CONE + ROOM)
    at = [(start + spacing * (k - 0.5), aside * (-1) ** k) for k in range(cones)]
    first = (start - spacing, start, aside)
    swings = [(x - 0.5 * spacing, x + 0.5 * spacing, y) for x, y in at[1:]]
    last = start + spacing * (cones - 1)
    return Line((first, *swings, (last, last + spacing, 0.0)))


@lru_cache(maxsize=64)
def _course(width: float, start: float, spacing: float, cones: int, side: float) -> Course:
    stands = [start + spacing * k for k in range(cones)]
    gates = []
    for k, x in enumerate(stands):
        ends = [(x, 0.0), (x, side * (-1) ** k * GATE)]
        gates.append(sorted(ends, key=lambda end: -end[1]))
    way = np.arange(0.0, stands[-1] + 1.5 * spacing)
    row = np.column_stack((stands, np.zeros(cones)))
    line = np.column_stack((way, _line(width, start, spacing, cones, side).at(way)))
    return Course(row, CONE, np.array(gates), line)


@dataclass(frozen=True)
class Slalom(Coned):
    """Round cones that stand in a row, the first of them passed on its left.

    18 m between the cones (k), as many as a drive of about 10 s passes; 45 km/h is chosen, within the 30 to 50 km/h of
    the drives of Qin et al. (2014), doi:10.6041/j.issn.1000-1298.2014.10.004, and clean with every car on dry road.

    Judged by: no cone hit, each passed on its side. Reported: least distance to a cone, largest sideslip, speed lost.

    Raises:
        ValueError: If there is no cone, or a part of one.
    """

    speed: float = 45 * KMH
    spacing: float = 18.0  # [m]
    cones: float = 4.0  # how many
    start: float = 30.0  # way to the first cone [m]

    positive: ClassVar[tuple[str, ...]] = ("cones", "spacing", "start")
    not_negative: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cones != round(self.cones):
            raise ValueError(f"cones must be a whole number, at least 1, not {self.cones}")

    @property
    def length(self) -> float:
        return self.start + self.spacing * self.cones

    @property
    def room(self) -> float:
        return GATE + LEFT

    def path(self, vehicle: p.Vehicle) -> Line:
        return _line(vehicle.width, self.start, self.spacing, round(self.cones), self.side)

    def course(self, vehicle: p.Vehicle) -> Course:
        return _course(vehicle.width, self.start, self.spacing, round(self.cones), self.side)
