"""The brake unit: what the driver and the stability control ask for, limited by slip, delayed by the hydraulics.

The unit sees the *estimated* speeds only. It is the car's ABS too, so it works without any stability control.
"""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.double_track import wheel_velocity


class BrakeUnit(NamedTuple):
    """Tunings of the slip limiter and the actuator."""

    slip_full: float = 0.08  # braking slip up to which the whole demand passes [-]
    slip_none: float = 0.20  # braking slip from which nothing passes [-]
    slowest: float = 2.0  # estimated speed below which the limiter is off [m/s]
    dead_time: float = 0.020  # [s]
    lag: float = 0.050  # [s]
    rise: float = 12e3  # fastest build-up [N m/s]
    fall: float = 30e3  # fastest release [N m/s]


@compiled
def limiter(unit, slip):
    """Share of the demanded torque that a wheel may have at a braking slip (positive when braking), in [0, 1]."""
    return min(1.0, max(0.0, (unit.slip_none - slip) / (unit.slip_none - unit.slip_full)))


def released_brakes(unit: BrakeUnit, dt: float):
    """Memory of an idle unit, (1 + delay steps, 4) [N m]: the torque now, then the demands on their way."""
    return np.zeros((1 + round(unit.dead_time / dt), 4))


@compiled
def brake_torques(unit, geometry, memory, driver, added, release, heard, velocity, steer, dt):
    """The brakes' torques during the next dt: the unit's memory one step on; its first row is the torques.

    Args:
        unit: Tunings.
        geometry: Of the car as the unit knows it.
        memory: (1 + delay steps, 4) [N m], from :func:`released_brakes` or the last step.
        driver: Brake torques that the driver asks for, (4,) [N m].
        added: What the stability control adds, (4,) [N m]; taken between 0 and the caps.
        release: Share of the driver's torque to let go, (4,), taken between 0 and 1.
        heard: Readings as last heard, (10,); from the fourth on the wheel speeds [rad/s].
        velocity: Estimated vx, vy, yaw rate [m/s, m/s, rad/s].
        steer: Road-wheel angle [rad].
        dt: Control step [s].
    """
    after = np.empty_like(memory)
    depth = memory.shape[0]
    vx, vy, yaw_rate = velocity
    for i in range(4):
        cap = geometry.brake_cap_front if i < 2 else geometry.brake_cap_rear
        demand = (1 - min(1.0, max(0.0, release[i]))) * driver[i] + min(cap, max(0.0, added[i]))
        if vx > unit.slowest and demand > 0:
            along, _ = wheel_velocity(geometry, i, vx, vy, yaw_rate, steer)
            if along > unit.slowest:
                demand *= limiter(unit, 1 - geometry.wheel_radius * heard[3 + i] / along)
        for k in range(1, depth - 1):
            after[k, i] = memory[k + 1, i]
        if depth > 1:
            after[depth - 1, i] = demand
            demand = memory[1, i]
        change = (1 - math.exp(-dt / unit.lag)) * (demand - memory[0, i])
        after[0, i] = memory[0, i] + min(unit.rise * dt, max(-unit.fall * dt, change))
    return after
