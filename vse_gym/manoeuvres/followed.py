"""What manoeuvres with a driver who follows a line share: his hands, and how the drive is measured."""

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from vse_gym.manoeuvres.base import Criterion, Verdict
from vse_gym.manoeuvres.course import Course, clearances, gates_missed
from vse_gym.manoeuvres.driver import DRIVER, Steering
from vse_gym.manoeuvres.path import STRAIGHT, Path
from vse_gym.manoeuvres.script import FOLLOW, Arms, Script, script_of
from vse_gym.manoeuvres.scripted import Bounds, Scripted
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log

STANDS = 0.5  # the car has stopped below this speed [m/s]
LEFT = 5.0  # metres beside the course at which a drive is over (chosen)


@dataclass(frozen=True)
class Followed(Scripted):
    """A driver follows a line; unless a manoeuvre says otherwise he holds his speed with the accelerator."""

    driver: Steering = DRIVER

    @abstractmethod
    def path(self, vehicle: p.Vehicle) -> Path:
        """The line for a car."""

    def arms(self, vehicle: p.Vehicle, dt: float) -> Arms:
        return self.driver.arms(vehicle, dt)

    def script(self, times: Array) -> Script:
        return script_of(times, FOLLOW, speed=self.speed)


def strayed(path: Path, log: Log) -> Array:
    """How far to the left of the line the centre of gravity was, (T,) [m]."""
    return path.stray(log.truth[:, p.X], log.truth[:, p.Y])


def turned_away(path: Path, log: Log) -> Array:
    """Heading of the car beside that of the line, (T,) [rad]."""
    apart = log.truth[:, p.YAW] - path.heading(log.truth[:, p.X], log.truth[:, p.Y])
    out: Array = (apart + math.pi) % (2 * math.pi) - math.pi
    return out


def largest(values: Array) -> float:
    """Largest magnitude; NaN if there is none or it is not a number."""
    return float(np.max(np.abs(values))) if values.size else math.nan


def stopping_distance(log: Log, begin: float) -> float:
    """Way from a time on until the car stands; NaN if it does not [m]."""
    speed = np.hypot(log.truth[:, p.VX], log.truth[:, p.VY])
    stands = np.nonzero((log.time > begin) & (speed < STANDS))[0]
    if not stands.size:
        return math.nan
    way = log.truth[:, p.DISTANCE]
    return float(way[stands[0]] - np.interp(begin, log.time, way))


def true_vehicle(log: Log, nominal: Nominal) -> p.Vehicle:
    """The car that was driven."""
    return nominal.vehicle if log.vehicle is None else log.vehicle


@dataclass(frozen=True)
class Coned(Followed):
    """A course of cones. The verdict: none hit by the car's true outline, and no gate missed."""

    # None: as long as the course takes at the start speed, and a quarter more [s]
    duration: float = None  # type: ignore[assignment]
    side: float = 1.0  # to which the course goes first: 1 left, -1 right

    def __post_init__(self) -> None:
        if self.duration is None and 0 < self.speed < math.inf:
            object.__setattr__(self, "duration", math.ceil(12.5 * self.length / self.speed) / 10)
        super().__post_init__()

    @property
    @abstractmethod
    def length(self) -> float:
        """From the start to the end of the course [m]."""

    @abstractmethod
    def course(self, vehicle: p.Vehicle) -> Course: ...

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(STRAIGHT, self.room)

    @property
    @abstractmethod
    def room(self) -> float:
        """Offset of the centre of gravity beyond which the drive is over [m]."""

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """No cone may be hit and no gate missed; the rest is reported."""
        vehicle = true_vehicle(log, nominal)
        course = self.course(vehicle)
        room = clearances(course, vehicle, log.truth)
        speed = np.hypot(log.truth[:, p.VX], log.truth[:, p.VY])
        return Verdict(
            (
                Criterion("cones hit", float(np.sum(~(room > 0))), 0, ""),
                Criterion("gates missed", float(gates_missed(course, log.truth)), 0, ""),
                Criterion("least distance to a cone", float(room.min()), 0, "m", at_least=True, judged=False),
                Criterion("largest sideslip", math.degrees(log.peak_sideslip), 15, "deg", judged=False),
                Criterion("speed lost", 3.6 * float(speed[0] - speed[-1]), 10, "km/h", judged=False),
            )
        )
