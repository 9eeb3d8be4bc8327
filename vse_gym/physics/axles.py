"""What an axle's tyres do together: the reference for whoever estimates cornering stiffnesses."""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.double_track import CONTACT, FY, contact
from vse_gym.physics.parameters import STATE_SIZE, VX, VY, YAW_RATE, Road
from vse_gym.physics.reference import unsteady_contact


@compiled
def axle_stiffness(vehicle, states, steer, friction, smallest):
    """Lateral force over slip angle of both axles at states of the plant: the secant, not the slope at zero.

    The road is level and all wheels have the friction that is given.

    Args:
        vehicle: The true car.
        states: (T, STATE_SIZE).
        steer: Angle of the road wheels, (T,) [rad].
        friction: (T,).
        smallest: Slip angle of an axle below which there is no answer [rad].

    Returns:
        Front and rear, (T, 2) [N/rad]; NaN where the slip angle is too small.
    """
    out = np.full((len(states), 2), np.nan)
    wheels, unused = np.empty((4, CONTACT)), np.empty(STATE_SIZE)
    zero = np.zeros(1)
    for k in range(len(states)):
        x, here = states[k], np.full(1, friction[k])
        road = Road(zero, here, here, zero, zero)
        contact(vehicle, road, x, steer[k], wheels)
        if vehicle.relaxation_x > 0:
            unsteady_contact(vehicle, road, x, wheels, unused)
        front = steer[k] - math.atan2(x[VY] + vehicle.lf * x[YAW_RATE], x[VX])
        rear = -math.atan2(x[VY] - vehicle.lr * x[YAW_RATE], x[VX])
        if abs(front) >= smallest:
            out[k, 0] = (wheels[0, FY] + wheels[1, FY]) / front
        if abs(rear) >= smallest:
            out[k, 1] = (wheels[2, FY] + wheels[3, FY]) / rear
    return out
