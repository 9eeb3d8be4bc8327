"""Lines to follow: where a lane's middle lies ahead of a car, and how far a car has strayed from it."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vse_gym.types import Array

FAR = 1e6  # a car farther out than this is looked at as if it were here [m]
STEP = 0.25  # of the table of a line [m]


class Path(Protocol):
    """A line that a driver can follow and a drive be measured against."""

    def look(self, x: float, y: float, yaw: float, ahead: Array) -> Array:
        """How far to the left of the car's axis the line lies, at distances ahead, (n,) to (n,) [m]."""

    def stray(self, x: Array, y: Array) -> Array:
        """How far to the left of the line each point lies, (T,) [m]."""

    def stray_of(self, x: float, y: float) -> float:
        """The same of one point [m]."""

    def heading(self, x: Array, y: Array) -> Array:
        """Heading of the line beside each point, (T,) [rad]."""


@dataclass(frozen=True)
class Line:
    """A line along x: straight stretches at given offsets, joined by swings in the shape of half a cosine.

    It is kept as a table too, so that a look costs the same however many swings there are.
    """

    swings: tuple[tuple[float, float, float], ...] = ()  # each from x to x, and the offset y from there on [m]
    _x: Array = field(init=False, repr=False, compare=False)  # the table
    _y: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        end = max((end for _, end, _ in self.swings), default=0.0)
        x = np.linspace(0.0, STEP * (math.ceil(end / STEP) + 1), math.ceil(end / STEP) + 2)
        object.__setattr__(self, "_x", x)
        object.__setattr__(self, "_y", self.at(x))

    def at(self, x: Array) -> Array:
        """Offsets y at positions x, (n,) to (n,) [m]."""
        y, before = np.zeros_like(x), 0.0
        for begin, end, after in self.swings:
            share = np.clip((x - begin) / (end - begin), 0.0, 1.0)
            y = y + (after - before) * 0.5 * (1 - np.cos(math.pi * share))
            before = after
        return y

    def look(self, x: float, y: float, yaw: float, ahead: Array) -> Array:
        x, y = min(max(x, -FAR), FAR), min(max(y, -FAR), FAR)
        there = np.interp(x + ahead, self._x, self._y)
        return math.cos(yaw) * (there - y) - math.sin(yaw) * ahead

    def stray(self, x: Array, y: Array) -> Array:
        return y - self.at(x)

    def stray_of(self, x: float, y: float) -> float:
        return y - float(np.interp(x, self._x, self._y))

    def heading(self, x: Array, y: Array) -> Array:
        slope = (self.at(x + STEP) - self.at(x - STEP)) / (2 * STEP)
        out: Array = np.arctan(slope)
        return out


STRAIGHT = Line()


@dataclass(frozen=True)
class Circle:
    """A circle that is entered along x at the origin, or at the end of a straight that leads there."""

    radius: float  # positive: to the left [m]
    straight: float = 0.0  # length before the circle; without one the car may go round and round [m]

    def look(self, x: float, y: float, yaw: float, ahead: Array) -> Array:
        x, y = min(max(x, -FAR), FAR) - self.straight, min(max(y, -FAR), FAR)
        at = self._along(x, y) + ahead
        angle = at / self.radius
        to_x, to_y = self.radius * np.sin(angle) - x, self.radius * (1 - np.cos(angle)) - y
        if self.straight > 0.0 and at[0] < 0.0:
            to_x, to_y = np.where(at < 0.0, at - x, to_x), np.where(at < 0.0, -y, to_y)
        return math.cos(yaw) * to_y - math.sin(yaw) * to_x

    def _along(self, x: float, y: float) -> float:
        """Way along the line to beside a point, from where the circle begins [m]."""
        if x < 0.0 and self.straight > 0.0:
            return x
        side = math.copysign(1.0, self.radius)
        return abs(self.radius) * math.atan2(x, abs(self.radius) - side * y)

    def stray(self, x: Array, y: Array) -> Array:
        x = x - self.straight
        side = math.copysign(1.0, self.radius)
        bent = side * (abs(self.radius) - np.hypot(x, y - self.radius))
        return np.where((x < 0.0) & (self.straight > 0.0), y, bent)

    def stray_of(self, x: float, y: float) -> float:
        x -= self.straight
        if x < 0.0 and self.straight > 0.0:
            return y
        return math.copysign(1.0, self.radius) * (abs(self.radius) - math.hypot(x, y - self.radius))

    def heading(self, x: Array, y: Array) -> Array:
        x = x - self.straight
        side = math.copysign(1.0, self.radius)
        bent = side * np.arctan2(x, abs(self.radius) - side * y)
        return np.where((x < 0.0) & (self.straight > 0.0), 0.0, bent)
