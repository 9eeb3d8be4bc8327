"""What every manoeuvre is."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vse_gym.manoeuvres.course import Course
from vse_gym.manoeuvres.driver import Steering
from vse_gym.models import Nominal
from vse_gym.physics.parameters import AY, GRAVITY, ROLL, Road, RollingBody, Vehicle, road
from vse_gym.types import Array, Car, Driver, Log

__all__ = ["DEG", "GRAVITY", "KMH", "Course", "Criterion", "Manoeuvre", "Verdict", "si"]

DEG = math.pi / 180
KMH = 1 / 3.6


_UNITS = {"_deg": DEG, "_kmh": KMH}  # a setting may be written in the unit of its suffix


def si(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with ``speed_kmh`` and ``amplitude_deg`` turned into ``speed`` [m/s] and ``amplitude`` [rad]."""
    out: dict[str, Any] = {}
    for key, value in settings.items():
        unit = next((u for u in _UNITS if key.endswith(u)), "")
        out[key.removesuffix(unit)] = value * _UNITS[unit] if unit else value
    return out


class Criterion(NamedTuple):
    """One figure against its limit."""

    name: str
    figure: float
    limit: float
    unit: str
    at_least: bool = False  # True: the figure must reach the limit; False: it must not exceed it
    judged: bool = True  # False: reported, but not part of the verdict

    @property
    def passed(self) -> bool:
        """Whether the figure keeps its limit; a figure that is not a number does not."""
        return self.figure >= self.limit if self.at_least else self.figure <= self.limit


class Verdict(NamedTuple):
    """All criteria of a manoeuvre."""

    criteria: tuple[Criterion, ...]

    @property
    def passed(self) -> bool:
        """Whether every judged criterion is kept."""
        return all(c.passed for c in self.criteria if c.judged)


@dataclass(frozen=True)
class Manoeuvre(ABC):
    """The driver and the course. The driver sees the road, so that the ``car`` he sees is the true one.

    Raises:
        ValueError: If a number is not finite, speed or duration not positive, a friction not in (0, 2], or a side
            neither 1 nor -1.
    """

    speed: float = 80 * KMH  # at the start [m/s]
    friction: float = 0.9  # of the road at the start [-]
    duration: float = 6.0  # [s]
    slope: float = 0.0  # of the whole road, beside what road() says; positive uphill [rad]
    bank: float = 0.0  # the same; positive: the left side is higher [rad]

    # of a member's settings: those that must be positive, and those that must not be negative
    positive: ClassVar[tuple[str, ...]] = ()
    not_negative: ClassVar[tuple[str, ...]] = ("begin",)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or isinstance(value, Steering):
                continue
            if isinstance(value, bool | str) or not math.isfinite(value):
                raise ValueError(f"{field.name} must be a finite number, not {value!r}")
            if field.name in ("slope", "bank") and not abs(value) < 0.5:
                raise ValueError(f"{field.name} must lie within 0.5 rad, not {value}")
            if field.name in ("speed", "duration", *self.positive) and not value > 0:
                raise ValueError(f"{field.name} must be positive, not {value}")
            if field.name in self.not_negative and value < 0:
                raise ValueError(f"{field.name} must not be negative, not {value}")
            if field.name.startswith("friction") and not 0 < value <= 2:
                raise ValueError(f"{field.name} must lie in (0, 2], not {value}")
            if field.name == "side" and abs(value) != 1:
                raise ValueError(f"side must be 1, to the left, or -1, not {value}")

    def init(self, nominal: Nominal) -> Any:
        """The driver's state at the start; a driver of an open-loop test has none.

        ``nominal.vehicle`` is the true car here, which its driver knows; whatever estimators are told of it.
        """
        return None

    @abstractmethod
    def drive(self, state: Any, time: float, car: Car) -> tuple[Driver, Any]:
        """What the driver does from now until the next instant, and his state after."""

    def road(self) -> Road:
        """The road; uniform unless a manoeuvre says otherwise. ``slope`` and ``bank`` tilt it afterwards."""
        return road((0.0, self.friction))

    def course(self, vehicle: Vehicle) -> Course | None:
        """Gates and cones as they are set out for a car, which must be the true one; None for an open-loop test."""
        return None

    def off_course(self, car: Car, vehicle: Vehicle) -> bool:
        """Whether the car, a true ``vehicle``, has left where it may be."""
        return False

    @abstractmethod
    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The standard's criteria, each with its figure and limit, of a drive that has begun."""

    def judge(self, log: Log, nominal: Nominal) -> Verdict:
        """The verdict of any drive: one that ended early fails, whatever its figures."""
        criteria = self.verdict(log, nominal).criteria if len(log.time) else ()
        if log.ended:
            when = float(log.time[-1]) if len(log.time) else 0.0
            criteria += (Criterion(f"driven to the end ({log.ended})", when, self.duration, "s", at_least=True),)
        return Verdict(criteria)


def across(vehicle: Vehicle | None, truth: Array) -> Array:
    """Lateral acceleration of states (T, STATE_SIZE) in the plane of the road, as the standards have it, (T,) [m/s2].

    An accelerometer on a body that rolls feels its lean too; without a body that rolls, what it feels is returned.
    """
    felt: Array = truth[:, AY]
    rolls = vehicle is not None and isinstance(vehicle.body, RollingBody)
    return felt - GRAVITY * np.sin(truth[:, ROLL]) if rolls else felt


def lateral_acceleration(log: Log) -> Array:
    """Of a drive, in the plane of the road, (T,) [m/s2]: see :func:`across`."""
    return across(log.vehicle, log.truth)


def held_together(log: Log) -> Criterion:
    """Where a standard has no limits (chosen): the car still points where it goes, to within 15 deg."""
    return Criterion("largest sideslip", math.degrees(log.peak_sideslip), 15.0, "deg")
