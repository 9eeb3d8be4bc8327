"""Stability control by a yaw moment: reference yaw rate, errors, a law from errors to a moment, brakes on one side.

The recursion is written once; what differs between controllers is the law, chosen by the type of its gains.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, generic, hold
from vse_gym.controllers.allocation import allocate, let_go
from vse_gym.controllers.base import Controller
from vse_gym.controllers.reference import Reference, follow_reference
from vse_gym.models import Nominal
from vse_gym.types import Array, BrakeDemand, Estimate, Reading

DEG = math.pi / 180


@generic
def yaw_moment(law, error, sideslip, sideslip_rate, speed, friction):
    """The yaw moment that a law asks for, positive left [N m]. It must be odd: mirrored errors, mirrored moment.

    Args:
        law: The gains, a NamedTuple of its own type.
        error: Yaw rate minus its reference [rad/s].
        sideslip: [rad].
        sideslip_rate: ay/v - r, through a lag [rad/s].
        speed: At least 1 m/s.
        friction: As estimated, else as nominal [-].
    """


@compiled
def beyond(value, band):
    """What exceeds a dead band about zero, with its sign."""
    return math.copysign(max(0.0, abs(value) - band), value)


class MomentState(NamedTuple):
    """Constants, and what the recursion remembers."""

    constants: Any  # reference, lag of the sideslip rate [s], moment of a whole release, law, geometry; held
    memory: Array  # reference yaw rate, envelope of |ay|, filtered sideslip rate, yaw moment, (4,)


@compiled
def stability_control(constants, memory, vx, vy, yaw_rate, ay, steer, friction):
    """One step: torques to add (4,) [N m], shares to release (4,), and the memory after.

    A friction of NaN is not estimated.
    """
    reference, lag, whole, law, g = constants.value
    out = np.empty(4)
    out[0], out[1] = follow_reference(reference, memory[0], memory[1], vx, ay, steer)
    speed = max(vx, 1.0)
    sideslip = math.atan2(vy, speed)
    blend = 1 - math.exp(-reference.dt / lag)
    out[2] = memory[2] + blend * (ay / speed - yaw_rate - memory[2])
    known = reference.friction if math.isnan(friction) else friction
    out[3] = yaw_moment(law, yaw_rate - out[0], sideslip, out[2], speed, known)
    return allocate(g, out[3], vx, yaw_rate, steer), let_go(out[3], vx, whole), out


@dataclass(frozen=True)
class MomentControl(Controller):
    """A law from the errors of yaw rate and sideslip to a yaw moment; members say which law."""

    understeer: float = 0.0020  # of the reference [rad s2/m]
    reference_lag: float = 0.06  # [s]
    envelope_release: float = 1.0  # [s]
    sideslip_rate_lag: float = 0.03  # [s]
    whole_release: float = 4e3  # moment from which the other side's driver torque is let go; infinite: never [N m]

    @abstractmethod
    def law(self, nominal: Nominal) -> Any:
        """The gains, of a type that :func:`yaw_moment` is registered for."""

    def reference(self, nominal: Nominal) -> Reference:
        """What the law takes the driver to want."""
        lags = (self.understeer, nominal.friction, self.reference_lag, self.envelope_release, nominal.dt)
        return Reference(nominal.vehicle.wheelbase, *map(float, lags))

    def init(self, nominal: Nominal) -> MomentState:
        law, geometry = self.law(nominal), nominal.vehicle.geometry
        lag, whole = float(self.sideslip_rate_lag), float(self.whole_release)
        return MomentState(hold((self.reference(nominal), lag, whole, law, geometry)), np.zeros(4))

    def act(self, state: MomentState, estimate: Estimate, reading: Reading) -> tuple[BrakeDemand, MomentState]:
        constants, memory = state
        seen = (estimate.vx, estimate.vy, estimate.yaw_rate, estimate.ay, reading.steer, estimate.friction)
        added, release, memory = stability_control(constants, memory, *seen)
        return BrakeDemand(added, release), MomentState(constants, memory)
