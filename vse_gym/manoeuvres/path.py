"""Lines to follow: where a lane's middle lies ahead of a car, and how far a car has strayed from it."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vse_gym.types import Array

FAR = 1e6  # a car farther out than this is looked at as if it were here [m]
STEP = 0.25  # of the table of a line [m]

Ahead = tuple[float, ...]


class Path(Protocol):
    """A line that a driver can follow and a drive be measured against."""

    def look(self, x: float, y: float, yaw: float, ahead: list[float]) -> list[float]:
        """How far to the left of the car's axis the line lies, at these distances ahead [m]."""

    def stray(self, x: Array, y: Array) -> Array:
        """How far to the left of the line each point lies, (T,) [m]."""

    def stray_of(self, x: float, y: float) -> float:
        """The same of one point [m]."""

    def heading(self, x: Array, y: Array) -> Array:
        """Heading of the line beside each point, (T,) [rad]."""


@dataclass(frozen=True)
class Line:
    """A line along x: straight stretches at given offsets, joined by swings in the shape of half a cosine.

    It is kept as a table, so that a look costs the same however many swings there are.
    """

    swings: tuple[tuple[float, float, float], ...] = ()  # each from x to x, and the offset y from there on [m]
    _table: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        end = max((end for _, end, _ in self.swings), default=0.0)
        x = np.linspace(0.0, STEP * (math.ceil(end / STEP) + 1), math.ceil(end / STEP) + 2)
        object.__setattr__(self, "_table", tuple(self.at(x).tolist()))

    def at(self, x: Array) -> Array:
        """Offsets y at positions x, (n,) to (n,) [m]."""
        y, before = np.zeros_like(x), 0.0
        for begin, end, after in self.swings:
            share = np.clip((x - begin) / (end - begin), 0.0, 1.0)
            y = y + (after - before) * 0.5 * (1 - np.cos(math.pi * share))
            before = after
        return y

    def look(self, x: float, y: float, yaw: float, ahead: list[float]) -> list[float]:
        cos, sin = math.cos(yaw), math.sin(yaw)
        table = self._table
        last = len(table) - 1
        x, y = min(max(x, -FAR), FAR), min(max(y, -FAR), FAR)
        out = []
        for distance in ahead:
            at = (x + distance) / STEP
            if at <= 0.0:
                there = table[0]
            elif at >= last:
                there = table[last]
            else:
                k = int(at)
                there = table[k] + (at - k) * (table[k + 1] - table[k])
            out.append(cos * (there - y) - sin * distance)
        return out

    def stray(self, x: Array, y: Array) -> Array:
        return y - self.at(x)

    def stray_of(self, x: float, y: float) -> float:
        return -self.look(x, y, 0.0, [0.0])[0]

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

    def look(self, x: float, y: float, yaw: float, ahead: list[float]) -> list[float]:
        cos, sin = math.cos(yaw), math.sin(yaw)
        x, y = min(max(x, -FAR), FAR) - self.straight, min(max(y, -FAR), FAR)
        radius, along = self.radius, self._along(x, y)
        out = []
        for distance in ahead:
            at = along + distance
            if at < 0.0 and self.straight > 0.0:
                to_x, to_y = at - x, -y
            else:
                to_x, to_y = radius * math.sin(at / radius) - x, radius * (1 - math.cos(at / radius)) - y
            out.append(cos * to_y - sin * to_x)
        return out

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
        return math.copysign(abs(self.radius) - math.hypot(x, y - self.radius), self.radius)

    def heading(self, x: Array, y: Array) -> Array:
        x = x - self.straight
        side = math.copysign(1.0, self.radius)
        bent = side * np.arctan2(x, abs(self.radius) - side * y)
        return np.where((x < 0.0) & (self.straight > 0.0), 0.0, bent)
