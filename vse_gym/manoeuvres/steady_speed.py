"""What open-loop steering at a steady speed shares: the accelerator, and the criterion that no standard gives."""

import math
from abc import abstractmethod
from dataclasses import dataclass

from vse_gym.manoeuvres.base import Criterion, Manoeuvre
from vse_gym.manoeuvres.driver import Pedals, pedals
from vse_gym.models import Nominal
from vse_gym.types import Car, Driver, Log


@dataclass(frozen=True)
class SteadySpeed(Manoeuvre):
    """The hand wheel as a function of time, and the accelerator so that the speed stays."""

    @abstractmethod
    def hand_wheel(self, time: float) -> float:
        """Angle of the hand wheel [rad]."""

    def init(self, nominal: Nominal) -> Pedals:
        return pedals(nominal.vehicle, nominal.dt)

    def drive(self, state: Pedals, time: float, car: Car) -> tuple[Driver, Pedals]:
        feet = state.hold(self.speed, car)
        return Driver(self.hand_wheel(time), feet.torque), feet


def held_together(log: Log) -> Criterion:
    """Where a standard has no limits (chosen): the car still points where it goes, to within 15 deg."""
    return Criterion("largest sideslip", math.degrees(log.peak_sideslip), 15.0, "deg")
