"""Manoeuvres that are a script and a line: what they share, and how compiled code drives them."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.manoeuvres.driver import DRIVER, pedals
from vse_gym.manoeuvres.path import STRAIGHT, Path, strayed_beyond
from vse_gym.manoeuvres.script import FOLLOW, Arms, Script, Task, drive_at, first_memory
from vse_gym.models import Nominal
from vse_gym.physics.parameters import Vehicle
from vse_gym.types import Array, Car, Driver


class AtWheel(NamedTuple):
    """The driver's state."""

    task: Any  # a Task, held
    memory: Array  # see vse_gym.manoeuvres.script.first_memory


class Bounds(NamedTuple):
    """Where a drive is over."""

    path: Path = STRAIGHT
    room: float = math.inf  # farther than this from the path [m]


EVERYWHERE = Bounds()
NO_ARMS = Arms(np.empty((0, 0)), np.empty(0), 0.0, 0.0, 0.0)  # of a driver who follows no line


@dataclass(frozen=True)
class Scripted(Manoeuvre):
    """What the driver does follows from the time, from a line and from the car's state, by one compiled law.

    Whoever overrides ``init``, ``drive`` or ``off_course`` all the same is driven through Python: see
    :func:`is_scripted`.
    """

    @abstractmethod
    def script(self, times: Array) -> Script:
        """What the driver does at times (steps,) that begin with 0 and are evenly spaced."""

    def path(self, vehicle: Vehicle) -> Path | None:
        """The line that a driver of this car follows, if he follows one."""
        return None

    def bounds(self, vehicle: Vehicle) -> Bounds:
        """Where a drive of this car is over."""
        return EVERYWHERE

    def arms(self, vehicle: Vehicle, dt: float) -> Arms:
        """How the driver steers along the line."""
        return DRIVER.arms(vehicle, dt)

    def task(self, vehicle: Vehicle, dt: float) -> Task:
        """All that stays the same in a drive of a car whose driver acts every dt seconds.

        Raises:
            ValueError: If the script says that the driver follows a line and there is none.
        """
        script = self.script(dt * np.arange(round(self.duration / dt) + 1.0))
        path, bounds = self.path(vehicle), self.bounds(vehicle)
        if path is None and np.any(script.hands == FOLLOW):
            raise ValueError(f"{type(self).__name__}: its script follows a line, but it has no path")
        guide, arms = (STRAIGHT.guide, NO_ARMS) if path is None else (path.guide, self.arms(vehicle, dt))
        return Task(script, guide, arms, pedals(vehicle, dt), bounds.path.guide, float(bounds.room), float(dt))

    def at_wheel(self, vehicle: Vehicle, dt: float) -> AtWheel:
        """The driver's state at the start, in a car that he knows and acts in every dt seconds."""
        task = self.task(vehicle, dt)
        return AtWheel(hold(task), first_memory(task))

    def init(self, nominal: Nominal) -> AtWheel:
        return self.at_wheel(nominal.vehicle, nominal.dt)

    def drive(self, state: AtWheel, time: float, car: Car) -> tuple[Driver, AtWheel]:
        task, memory = state
        hand_wheel, drive, brake, memory = drive_at(task, memory, time, car.state)
        return Driver(hand_wheel, drive, brake), AtWheel(task, memory)

    def off_course(self, car: Car, vehicle: Vehicle) -> bool:
        path, room = self.bounds(vehicle)
        return bool(room < math.inf and strayed_beyond(path.guide, room, car.x, car.y))


def is_scripted(manoeuvre: Manoeuvre) -> bool:
    """Whether compiled code may drive it: nobody has overridden what its script stands for."""
    kind = type(manoeuvre)
    return isinstance(manoeuvre, Scripted) and all(
        getattr(kind, name) is getattr(Scripted, name) for name in ("init", "at_wheel", "drive", "off_course")
    )
