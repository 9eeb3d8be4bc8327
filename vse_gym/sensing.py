"""What a sensor makes of the truth: late, noisy, clipped and rounded."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.physics import parameters as p
from vse_gym.types import U_BRAKE, U_DRIVE, U_STEER, Y_SIDESLIP, Y_SPEED, Y_WHEEL, Array

IN_STATE = (p.AX, p.AY, p.YAW_RATE)  # where the first channels lie in the plant's state
STANDING = 0.5  # below this speed an optical sensor gives no angle: there is none [m/s]


class NoiseRecord(NamedTuple):
    """What happens to the readings of one run."""

    added: Array  # (steps, 10)
    silent: NDArray[np.bool_]  # (steps, 10), true where a sensor says nothing
    steer: Array  # added to the road-wheel angle, (steps,) [rad]
    brake: Array  # relative error of each brake torque, (steps, 4) [-]
    limits: Array  # range of each channel, (10,)
    resolution: Array  # of each channel, (10,); 0: as fine as you like
    steer_resolution: float  # [rad]
    delay: int  # of what comes over the bus [steps]
    dt: float


@compiled
def _true_value(state, channel):
    """What a perfect sensor would read."""
    if channel < Y_WHEEL:
        return state[IN_STATE[channel]]
    if channel < Y_SPEED:
        return state[p.WHEEL + channel - Y_WHEEL]
    if channel == Y_SPEED:
        return math.sqrt(state[p.VX] ** 2 + state[p.VY] ** 2)
    return math.atan2(state[p.VY], state[p.VX]) if channel == Y_SIDESLIP else state[p.ROLL_RATE]


@compiled
def _rounded(value, step):
    return step * np.rint(value / step) if step > 0 else value


@compiled
def unread_sensors(delay, state):
    """Memory of sensors before their first reading, of a car that has been in this state for long.

    Returns:
        (1 + delay, 10): the last valid value of each channel, then the true values on their way, newest first.
    """
    memory = np.zeros((1 + delay, 10))
    for i in range(Y_WHEEL, Y_SPEED):
        memory[0, i] = _true_value(state, i)  # a sensor unheard of is no locked wheel
    for k in range(1, 1 + delay):
        for i in range(10):
            memory[k, i] = _true_value(state, i)
    return memory


@compiled
def read_sensors(record, step, state, inputs, memory):
    """The reading at a step, of the plant's state and of the inputs that were held until then.

    Args:
        record: Of the run.
        step: Counted from 0.
        state: Of the plant, (STATE_SIZE,).
        inputs: Steering angle and torques that acted.
        memory: (1 + delay, 10), from :func:`unread_sensors` or the last step.

    Returns:
        u (9,) and y (10,) as :class:`Reading` has them; the memory one step on, whose first row is the last valid
        value of each channel.
    """
    u, y, after = np.empty(9), np.empty(10), np.empty_like(memory)
    delay, speed = memory.shape[0] - 1, 0.0
    for i in range(10):
        value = _true_value(state, i)
        if delay > 0:
            for k in range(2, delay + 1):
                after[k, i] = memory[k - 1, i]
            after[1, i] = value
            if i < Y_WHEEL or i >= Y_SPEED:
                value = memory[delay, i]
        if i == Y_SPEED:
            speed = value
        silent = record.silent[step, i] or (i == Y_SIDESLIP and speed < STANDING)
        value = min(record.limits[i], max(-record.limits[i], value + record.added[step, i]))
        value = _rounded(value, record.resolution[i])
        y[i] = np.nan if silent else value
        after[0, i] = memory[0, i] if silent else value
    u[U_STEER] = _rounded(inputs.steer + record.steer[step], record.steer_resolution)
    for i in range(4):
        u[U_BRAKE + i] = inputs.brake[i] * (1 + record.brake[step, i])
        u[U_DRIVE + i] = inputs.drive[i]
    return u, y, after
