"""Electronic stability control: a reference yaw rate, a yaw moment from the errors, brakes on one side."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, hold
from vse_gym.controllers.allocation import allocate
from vse_gym.controllers.base import Controller
from vse_gym.models import Nominal
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import NO_TORQUE, Array, BrakeDemand, Estimate, Reading

DEG = math.pi / 180


class Reference(NamedTuple):
    """What the driver is taken to want: the yaw rate of a mildly understeering car, within what the road bears."""

    wheelbase: float  # [m]
    understeer: float  # K of the wanted car, not of the real one, which may oversteer [rad s2/m]
    friction: float  # nominal [-]
    lag: float  # [s]
    release: float  # time in which the envelope of |ay| forgets [s]
    dt: float  # [s]


@compiled
def follow_reference(reference, wanted, envelope, vx, ay, steer):
    """Reference yaw rate [rad/s] and envelope of |ay| [m/s2] one step on, from those before.

    |r| <= min(0.85 mu g, 1.2 envelope + 2.5)/v: the second limit learns the road's friction from what the car does.
    """
    speed = max(vx, 1.0)
    envelope = max(abs(ay), envelope * math.exp(-reference.dt / reference.release))
    steady = speed * steer / (reference.wheelbase + reference.understeer * speed * speed)
    limit = min(0.85 * reference.friction * GRAVITY, 1.2 * envelope + 2.5) / speed
    steady = max(-limit, min(limit, steady))
    return wanted + (1 - math.exp(-reference.dt / reference.lag)) * (steady - wanted), envelope


class Law(NamedTuple):
    """Gains from errors to yaw moment."""

    yaw_gain: float  # [N m s/rad]
    yaw_band: float  # yaw rate error that is let be [rad/s]
    sideslip_gain: float  # on what exceeds the band [N m/rad]
    sideslip_band: float  # [rad]
    sideslip_rate_gain: float  # only while sideslip exceeds its band [N m s/rad]
    sideslip_rate_lag: float  # [s]


class EscState(NamedTuple):
    """Constants, and what the law remembers."""

    constants: Any  # reference, law and geometry, held by compiled code
    memory: Array  # reference yaw rate, envelope of |ay|, filtered sideslip rate, yaw moment, (4,)


@compiled
def stability_control(constants, memory, vx, vy, yaw_rate, ay, steer):
    """One step of the law: brake torques to add (4,) [N m], and the memory after."""
    reference, law, g = constants.value
    out = np.empty(4)
    out[0], out[1] = follow_reference(reference, memory[0], memory[1], vx, ay, steer)
    speed = max(vx, 1.0)
    sideslip = math.atan2(vy, speed)
    blend = 1 - math.exp(-reference.dt / law.sideslip_rate_lag)
    out[2] = memory[2] + blend * (ay / speed - yaw_rate - memory[2])
    error = yaw_rate - out[0]
    moment = -law.yaw_gain * math.copysign(max(0.0, abs(error) - law.yaw_band), error)
    excess = abs(sideslip) - law.sideslip_band
    if excess > 0:
        moment += law.sideslip_gain * math.copysign(excess, sideslip) + law.sideslip_rate_gain * out[2]
    out[3] = moment
    return allocate(g, moment, vx, yaw_rate, steer), out


@dataclass(frozen=True)
class StabilityControl(Controller):
    """C1, as in production: yaw rate first, sideslip where it grows beyond a band."""

    yaw_gain: float = 45e3  # [N m s/rad]
    yaw_band: float = 2.5 * DEG  # [rad/s]
    sideslip_gain: float = 120e3  # [N m/rad]
    sideslip_band: float = 3 * DEG  # [rad]
    sideslip_rate_gain: float = 15e3  # [N m s/rad]
    sideslip_rate_lag: float = 0.03  # [s]
    understeer: float = 0.0020  # of the reference [rad s2/m]
    reference_lag: float = 0.06  # [s]
    envelope_release: float = 1.0  # [s]

    def reference(self, nominal: Nominal) -> Reference:
        """What the law takes the driver to want."""
        lags = (self.understeer, nominal.friction, self.reference_lag, self.envelope_release, nominal.dt)
        return Reference(nominal.vehicle.wheelbase, *map(float, lags))

    def init(self, nominal: Nominal) -> EscState:
        gains = (self.yaw_gain, self.yaw_band, self.sideslip_gain, self.sideslip_band)
        law = Law(*map(float, (*gains, self.sideslip_rate_gain, self.sideslip_rate_lag)))
        return EscState(hold((self.reference(nominal), law, nominal.vehicle.geometry)), np.zeros(4))

    def act(self, state: EscState, estimate: Estimate, reading: Reading) -> tuple[BrakeDemand, EscState]:
        constants, memory = state
        seen = (estimate.vx, estimate.vy, estimate.yaw_rate, estimate.ay, reading.steer)
        added, memory = stability_control(constants, memory, *seen)
        return BrakeDemand(added, NO_TORQUE), EscState(constants, memory)


@dataclass(frozen=True)
class SideslipStabilityControl(StabilityControl):
    """C2, sideslip first: no yaw-rate term at all, so that the sideslip estimate decides."""

    yaw_gain: float = 0.0
    sideslip_gain: float = 200e3
    sideslip_band: float = 1.5 * DEG
    sideslip_rate_gain: float = 30e3
