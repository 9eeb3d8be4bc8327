"""From a yaw moment to wheel brakes."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.models import Nominal


class Geometry(NamedTuple):
    """What turns a yaw moment into brake torques."""

    lf: float  # [m]
    lr: float  # [m]
    track_front: float  # [m]
    track_rear: float  # [m]
    wheel_radius: float  # [m]
    cap_front: float  # [N m]
    cap_rear: float  # [N m]
    slowest: float = 4.0  # no stability control below this speed [m/s]
    smallest: float = 50.0  # nor for a moment below this [N m]


def geometry(nominal: Nominal) -> Geometry:
    """The nominal car's."""
    car = nominal.vehicle
    return Geometry(
        car.lf, car.lr, car.track_front, car.track_rear, car.wheel_radius, car.brake_cap_front, car.brake_cap_rear
    )


@compiled
def largest_moment(g):
    """The yaw moment of one side's brakes at their caps, straight ahead [N m]."""
    return 0.5 * (g.track_front * g.cap_front + g.track_rear * g.cap_rear) / g.wheel_radius


@compiled
def allocate(g, moment, vx, yaw_rate, steer):
    """Brake torques (4,) [N m] for a yaw moment, positive left.

    The moment's side brakes. Against oversteer (moment against the yaw rate) that is the outer side: its front wheel
    first, the remainder at its rear wheel. Against understeer it is the inner rear wheel alone.
    """
    torques = np.zeros(4)
    if vx < g.slowest or abs(moment) < g.smallest:
        return torques
    left = moment > 0
    front, rear = (0, 2) if left else (1, 3)
    demand = abs(moment)
    rear_arm = 0.5 * g.track_rear
    if moment * yaw_rate < 0:
        lean = g.lf * math.sin(steer)
        arm = 0.5 * g.track_front * math.cos(steer) + (-lean if left else lean)
        if arm > 0.1:
            torques[front] = min(g.cap_front, demand / arm * g.wheel_radius)
            demand -= torques[front] * arm / g.wheel_radius
    torques[rear] = min(g.cap_rear, demand / rear_arm * g.wheel_radius)
    return torques
