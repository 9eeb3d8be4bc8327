"""Three double lane changes in a row, each on a road of less friction."""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import ClassVar

from vse_gym.manoeuvres.base import KMH, Criterion, Verdict, lateral_acceleration
from vse_gym.manoeuvres.followed import LEFT, Followed, largest, strayed
from vse_gym.manoeuvres.path import STRAIGHT, Line
from vse_gym.manoeuvres.scripted import Bounds
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Log

LANES = (40.0, 35.0)  # straight before the way over, and beside it before the way back (chosen) [m]


@lru_cache(maxsize=64)
def _line(offset: float, swing: float, every: float) -> Line:
    swings = []
    for k in range(3):
        over, there, back, home = accumulate((k * every + LANES[0], swing, LANES[1], swing))
        swings += [(over, there, offset), (back, home, 0.0)]
    return Line(tuple(swings))


@dataclass(frozen=True)
class TripleLaneChange(Followed):
    """Over into the neighbouring lane and back, three times at 120 km/h, on friction 0.85, 0.5 and 0.35.

    Of Chen, Wu, Ge, Zhao (2024), Automotive Engineering 46(2), doi:10.19562/j.chinasae.qcgc.2024.02.017, who give the
    speed, the frictions and that they change at about 9 and 18 s of 30. How long a lane change takes is chosen: that of
    ISO 3888-1, 3.5 m within 30 m, would need 27 m/s2 at this speed.

    Judged by (limits chosen): sideslip, and the distance from the line. Reported: largest lateral acceleration.
    """

    speed: float = 120 * KMH
    duration: float = 30.0
    friction: float = 0.85  # [-]
    friction_second: float = 0.5  # [-]
    friction_third: float = 0.35  # [-]
    every: float = 9.0  # time of a double lane change at the start speed [s]
    offset: float = 3.5  # between the lanes' middles [m]
    swing: float = 95.0  # way from one lane into the other (chosen) [m]
    side: float = 1.0  # to which the way goes first: 1 left, -1 right

    positive: ClassVar[tuple[str, ...]] = ("every", "offset", "swing")
    not_negative: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if sum(LANES) + 2 * self.swing > self.every * self.speed:
            raise ValueError(
                f"a double lane change of {sum(LANES) + 2 * self.swing:g} m needs more than {self.every:g} s "
                f"at {self.speed:g} m/s"
            )

    def road(self) -> p.Road:
        way = self.every * self.speed
        return p.road((0.0, self.friction), (way, self.friction_second), (2 * way, self.friction_third))

    def path(self, vehicle: p.Vehicle) -> Line:
        return _line(self.side * self.offset, self.swing, self.every * self.speed)

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(STRAIGHT, self.offset + LEFT)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """Sideslip and distance from the line."""
        away = largest(strayed(self.path(nominal.vehicle), log))
        aside = largest(lateral_acceleration(log))
        return Verdict(
            (
                Criterion("largest sideslip", math.degrees(log.peak_sideslip), 10, "deg"),
                Criterion("largest distance from the line", away, 1.0, "m"),
                Criterion("largest lateral acceleration", aside, 9.81, "m/s2", judged=False),
            )
        )
