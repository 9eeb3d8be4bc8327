"""Lines to follow: where a lane's middle lies ahead of a car, and how far a car has strayed from it."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.types import Array

FAR = 1e6  # a car farther out than this is looked at as if it were here [m]
STEP = 0.25  # of the table of a line [m]


class Guide(NamedTuple):
    """A line as compiled code reads it, of one type whatever its shape: a table of offsets along x, or a circle."""

    offsets: Array  # y at x = 0, STEP, 2 STEP, ...; what is first and last goes on for ever; (n,) [m]
    radius: float  # of the circle, positive: to the left; infinite: there is none, but a table [m]
    straight: float  # along x to where the circle begins [m]


@compiled
def offset_at(offsets, x):
    """Offset y of a table at x, by straight lines [m]."""
    at, last = x / STEP, offsets.size - 1
    if at >= last:
        return offsets[last]
    if at > 0.0:
        k = int(at)
        return offsets[k] + (at - k) * (offsets[k + 1] - offsets[k])
    return offsets[0]


@compiled
def look(guide, x, y, yaw, ahead):
    """How far to the left of the axis of a car at x, y, yaw the line lies, at distances ahead, (n,) to (n,) [m]."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = min(max(x, -FAR), FAR), min(max(y, -FAR), FAR)
    seen = np.empty_like(ahead)
    if not math.isfinite(guide.radius):
        for i in range(ahead.size):
            seen[i] = cos * (offset_at(guide.offsets, x + ahead[i]) - y) - sin * ahead[i]
        return seen
    x -= guide.straight
    begin = along_circle(guide, x, y)
    for i in range(ahead.size):
        at = begin + ahead[i]
        if at < 0.0 and guide.straight > 0.0:
            to_x, to_y = at - x, -y
        else:
            angle = at / guide.radius
            to_x, to_y = guide.radius * math.sin(angle) - x, guide.radius * (1 - math.cos(angle)) - y
        seen[i] = cos * to_y - sin * to_x
    return seen


@compiled
def along_circle(guide, x, y):
    """Way along the line to beside a point, x and the way counted from where the circle begins [m]."""
    if x < 0.0 and guide.straight > 0.0:
        return x
    size, side = abs(guide.radius), math.copysign(1.0, guide.radius)
    return size * math.atan2(x, size - side * y)


@compiled
def stray(guide, x, y):
    """How far to the left of the line a point lies [m]."""
    if not math.isfinite(guide.radius):
        return y - offset_at(guide.offsets, x)
    x -= guide.straight
    if x < 0.0 and guide.straight > 0.0:
        return y
    return math.copysign(1.0, guide.radius) * (abs(guide.radius) - math.hypot(x, y - guide.radius))


@compiled
def strayed_beyond(guide, room, x, y):
    """Whether a point lies farther than this from the line."""
    return abs(stray(guide, x, y)) > room


class Path(Protocol):
    """A line that a driver can follow and a drive be measured against."""

    @property
    def guide(self) -> Guide:
        """The line for compiled code."""

    def stray(self, x: Array, y: Array) -> Array:
        """How far to the left of the line each point lies, (T,) [m]."""

    def heading(self, x: Array, y: Array) -> Array:
        """Heading of the line beside each point, (T,) [rad]."""


@dataclass(frozen=True)
class Line:
    """A line along x: straight stretches at given offsets, joined by swings in the shape of half a cosine.

    Compiled code reads it off a table, so that a look costs the same however many swings there are.
    """

    swings: tuple[tuple[float, float, float], ...] = ()  # each from x to x, and the offset y from there on [m]
    guide: Guide = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        end = max((end for _, end, _ in self.swings), default=0.0)
        table = self.at(np.arange(math.ceil(end / STEP) + 2.0) * STEP)
        object.__setattr__(self, "guide", Guide(table, math.inf, 0.0))

    def at(self, x: Array) -> Array:
        """Offsets y at positions x, (n,) to (n,) [m]."""
        y, before = np.zeros_like(x), 0.0
        for begin, end, after in self.swings:
            share = np.clip((x - begin) / (end - begin), 0.0, 1.0)
            y = y + (after - before) * 0.5 * (1 - np.cos(math.pi * share))
            before = after
        return y

    def stray(self, x: Array, y: Array) -> Array:
        return y - self.at(x)

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

    @property
    def guide(self) -> Guide:
        return Guide(STRAIGHT.guide.offsets, float(self.radius), float(self.straight))

    def stray(self, x: Array, y: Array) -> Array:
        x = x - self.straight
        side = math.copysign(1.0, self.radius)
        bent = side * (abs(self.radius) - np.hypot(x, y - self.radius))
        return np.where((x < 0.0) & (self.straight > 0.0), y, bent)

    def heading(self, x: Array, y: Array) -> Array:
        x = x - self.straight
        side = math.copysign(1.0, self.radius)
        bent = side * np.arctan2(x, abs(self.radius) - side * y)
        return np.where((x < 0.0) & (self.straight > 0.0), 0.0, bent)
