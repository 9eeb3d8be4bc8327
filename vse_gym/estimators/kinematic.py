"""The kinematic observer: integrates the accelerometers, knows no tyre."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.models.tuning import tunable
from vse_gym.types import U_BRAKE, U_DRIVE, Y_AX, Y_AY, Y_WHEEL, Y_YAW_RATE, Array, Estimate, Reading


class Kinematics(NamedTuple):
    """Constants of the observer."""

    radius: float  # [m]
    track_front: float  # [m]
    track_rear: float  # [m]
    dt: float  # [s]
    speed_gain: float  # [1/s]
    turn_gain: float  # [-]
    leak: float  # [1/s]
    leak_yaw_rate: float  # [rad/s]
    brake_hold: float  # [s]
    braking: float  # [N m]


class KinematicState(NamedTuple):
    """Constants and what is believed: vx, vy, the last valid ax, ay, yaw rate, and times since each wheel braked."""

    kinematics: Kinematics
    values: Array  # (9,)


@compiled
def kinematic_step(k, values, u, y):
    """One step of the observer: (9,) to (9,)."""
    out = values.copy()
    vx, vy = values[0], values[1]
    for i, channel in ((2, Y_AX), (3, Y_AY), (4, Y_YAW_RATE)):
        if not np.isnan(y[channel]):
            out[i] = y[channel]
    ax, ay, r = out[2], out[3], out[4]
    total, count, fastest, free, free_total = 0.0, 0, -1.0, 0, 0.0
    for i in range(4):
        out[5 + i] = 0.0 if u[U_BRAKE + i] > k.braking else values[5 + i] + k.dt
        half = 0.5 * (k.track_front if i < 2 else k.track_rear) * (1.0 if i % 2 == 0 else -1.0)
        speed = k.radius * y[Y_WHEEL + i] + half * r
        if np.isnan(speed):
            continue
        fastest = max(fastest, speed)
        if out[5 + i] >= k.brake_hold:
            total += speed
            count += 1
            if abs(u[U_DRIVE + i]) <= k.braking:  # a driven wheel slips
                free_total += speed
                free += 1
    error = 0.0
    if free > 0:
        error = free_total / free - vx
    elif count > 0:
        error = total / count - vx
    elif fastest >= 0:
        error = max(0.0, fastest - vx)  # braking wheels turn too slowly, never too fast
    turning = abs(r)
    straight = max(0.0, 1 - turning / k.leak_yaw_rate)
    out[0] = vx + k.dt * (ax + r * vy + (k.speed_gain * straight + 2 * k.turn_gain * turning) * error)
    out[1] = vy + k.dt * (ay - r * vx + (k.turn_gain**2 - 1) * r * error - k.leak * straight * vy)
    return out


@dataclass(frozen=True)
class KinematicObserver(Estimator):
    """Integrate ax + r vy and ay - r vx, held to the wheels' speed while turning and to zero while not.

    While turning the gains on the speed error place both poles at -turn_gain |yaw rate|: Farrelly, Wellstead (1996).
    Going straight vy cannot be observed, so it leaks away there.
    """

    turn_gain: float = tunable(2.0, 0.5, 10.0)  # [-]
    speed_gain: float = tunable(5.0, 0.5, 30.0)  # added to the gain on vx, to hold speed going straight too [1/s]
    leak: float = tunable(2.0, 0.1, 20.0)  # rate at which vy is forgotten going straight [1/s]
    leak_yaw_rate: float = tunable(0.05, 0.005, 0.3)  # yaw rate at which the leak ends [rad/s]
    brake_hold: float = 0.1  # a wheel is not believed for this long after it braked [s]
    braking: float = 20.0  # a wheel with more brake torque than this is braking [N m]

    def init(self, nominal: Nominal, rng: np.random.Generator) -> KinematicState:
        car = nominal.vehicle
        floats = (self.speed_gain, self.turn_gain, self.leak, self.leak_yaw_rate, self.brake_hold, self.braking)
        kinematics = Kinematics(car.wheel_radius, car.track_front, car.track_rear, nominal.dt, *map(float, floats))
        values = np.zeros(9)
        values[0], values[5:] = nominal.speed, self.brake_hold
        return KinematicState(kinematics, values)

    def update(self, state: KinematicState, reading: Reading, rng: np.random.Generator) -> KinematicState:
        kinematics, values = state
        return KinematicState(kinematics, kinematic_step(kinematics, values, reading.inputs, reading.y))

    def estimate(self, state: KinematicState) -> Estimate:
        vx, vy, ax, ay, yaw_rate = state.values[:5].tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay)
