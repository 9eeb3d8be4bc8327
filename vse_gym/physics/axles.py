"""What an axle's tyres do together: the reference for whoever estimates cornering stiffnesses."""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.double_track import CONTACT, FY, contact
from vse_gym.physics.parameters import STATE_SIZE, VX, VY, YAW_RATE, Road
from vse_gym.physics.reference import unsteady_contact


@compiled
def axle_slips(vehicle, states, steer, friction):
    """Slip angles and lateral forces of both axles at states of the plant.

    The road is level and all wheels have the friction that is given.

    Args:
        vehicle: The true car.
        states: (T, STATE_SIZE).
        steer: Road-wheel angle that the driver set, (T,) [rad]; the car's own offset comes on top.
        friction: (T,).

    Returns:
        angles: Front and rear, (T, 2) [rad]; NaN where the car does not move forwards.
        forces: Of both tyres, in wheel axes, (T, 2) [N]; NaN alike.
    """
    angles, forces = np.full((len(states), 2), np.nan), np.full((len(states), 2), np.nan)
    wheels, unused = np.empty((4, CONTACT)), np.empty(STATE_SIZE)
    zero = np.zeros(1)
    for k in range(len(states)):
        x, turned = states[k], steer[k] + vehicle.steering_offset
        if not x[VX] > 0.0:
            continue
        here = np.full(1, friction[k])
        road = Road(zero, here, here, zero, zero)
        contact(vehicle, road, x, turned, wheels)
        if vehicle.relaxation_x > 0:
            unsteady_contact(vehicle, road, x, wheels, unused)
        angles[k, 0] = turned - math.atan2(x[VY] + vehicle.lf * x[YAW_RATE], x[VX])
        angles[k, 1] = -math.atan2(x[VY] - vehicle.lr * x[YAW_RATE], x[VX])
        forces[k, 0] = wheels[0, FY] + wheels[1, FY]
        forces[k, 1] = wheels[2, FY] + wheels[3, FY]
    return angles, forces


def axle_stiffness(vehicle, states, steer, friction, smallest):
    """Lateral force over slip angle of both axles: the secant, not the slope at zero.

    Args:
        vehicle, states, steer, friction: As of :func:`axle_slips`.
        smallest: Slip angle of an axle below which there is no answer [rad].

    Returns:
        Front and rear, (T, 2) [N/rad]; NaN where the slip angle is too small or not known.
    """
    angles, forces = axle_slips(vehicle, states, steer, friction)
    return np.divide(forces, angles, out=np.full_like(angles, np.nan), where=np.abs(angles) >= smallest)
