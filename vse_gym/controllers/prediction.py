"""What a predictive controller believes: a nonlinear single track under a delayed yaw moment, and its linearisation.

The state is sideslip beta, yaw rate r and acting moment m, each in units of ``UNITS``; the input is the moment asked
for, in units of the last. The speed stays as it is.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.models import Nominal
from vse_gym.physics.parameters import GRAVITY
from vse_gym.physics.tyres import tyre_force

UNITS = (0.05, 0.2, 8e3)  # of sideslip [rad], yaw rate [rad/s] and moment [N m]: a strong intervention is of order one
REACH = 1e-3  # of the difference quotients, in units


class Bicycle(NamedTuple):
    """The single track; tyres in pairs, at their static load."""

    mass: float  # [kg]
    yaw_inertia: float  # [kg m2]
    lf: float  # [m]
    lr: float  # [m]
    load_front: float  # of one wheel [N]
    load_rear: float  # [N]
    front_tyre: Any
    rear_tyre: Any
    step: float  # [s]
    keep: float  # what is left of a change of moment after a step, because of the brakes' lag [-]


def bicycle(nominal: Nominal, step: float, lag: float) -> Bicycle:
    """The nominal car's, with a time step and the brakes' lag [s]."""
    car = nominal.vehicle
    per_length = 0.5 * car.mass * GRAVITY / car.wheelbase
    sizes = (car.mass, car.yaw_inertia, car.lf, car.lr, per_length * car.lr, per_length * car.lf)
    return Bicycle(*sizes, car.front_tyre, car.rear_tyre, float(step), math.exp(-step / lag))


@compiled
def _rates(model, speed, steer, friction, sideslip, yaw_rate, moment):
    """Time derivatives of sideslip and yaw rate, in SI."""
    vy = speed * sideslip
    c, s = math.cos(steer), math.sin(steer)
    across = vy + model.lf * yaw_rate
    slip_front = (speed * s - across * c) / max(1.0, speed * c + across * s)
    slip_rear = (model.lr * yaw_rate - vy) / speed
    _, front, _, _ = tyre_force(model.front_tyre, 0.0, slip_front, model.load_front, friction)
    _, rear, _, _ = tyre_force(model.rear_tyre, 0.0, slip_rear, model.load_rear, friction)
    across_front, across_rear = 2 * front * c, 2 * rear
    turn = model.lf * across_front - model.lr * across_rear + moment
    return (across_front + across_rear) / (model.mass * speed) - yaw_rate, turn / model.yaw_inertia


@compiled
def predict(model, speed, steer, friction, beta, r, m, u):
    """State one step on, by Heun's method; all in units. Odd: mirrored state, steer and input, mirrored result."""
    h = model.step
    sideslip, yaw_rate = beta * UNITS[0], r * UNITS[1]
    after = model.keep * m + (1 - model.keep) * u
    db, dr = _rates(model, speed, steer, friction, sideslip, yaw_rate, m * UNITS[2])
    eb, er = _rates(model, speed, steer, friction, sideslip + h * db, yaw_rate + h * dr, after * UNITS[2])
    return beta + 0.5 * h * (db + eb) / UNITS[0], r + 0.5 * h * (dr + er) / UNITS[1], after


@compiled
def linearise(model, speed, steer, friction, start, plan):
    """The plan's trajectory, and the affine model about it: x[k+1] = A[k] x[k] + B[k] u[k] + c[k].

    Args:
        model: Bicycle.
        speed: Positive [m/s].
        steer: Road-wheel angle, held [rad].
        friction: [-].
        start: State (3,).
        plan: Inputs (N,).

    Returns:
        x (N + 1, 3), A (N, 3, 3), B (N, 3), c (N, 3), by central differences.
    """
    steps = plan.size
    x, a = np.empty((steps + 1, 3)), np.empty((steps, 3, 3))
    b, c = np.empty((steps, 3)), np.empty((steps, 3))
    x[0] = start
    high, low = np.empty(4), np.empty(4)
    for k in range(steps):
        at = (x[k, 0], x[k, 1], x[k, 2], plan[k])
        x[k + 1, 0], x[k + 1, 1], x[k + 1, 2] = predict(model, speed, steer, friction, at[0], at[1], at[2], at[3])
        for j in range(4):
            for i in range(4):
                high[i] = at[i] + (REACH if i == j else 0.0)
                low[i] = at[i] - (REACH if i == j else 0.0)
            up = predict(model, speed, steer, friction, high[0], high[1], high[2], high[3])
            down = predict(model, speed, steer, friction, low[0], low[1], low[2], low[3])
            for i in range(3):
                slope = (up[i] - down[i]) / (2 * REACH)
                if j < 3:
                    a[k, i, j] = slope
                else:
                    b[k, i] = slope
        for i in range(3):
            c[k, i] = x[k + 1, i] - (a[k, i, 0] * at[0] + a[k, i, 1] * at[1] + a[k, i, 2] * at[2] + b[k, i] * at[3])
    return x, a, b, c
