"""What the models share about channels: what rolling wheels and optical sensors read, and which wheels to believe."""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import U_BRAKE, U_DRIVE, Y_AX, Y_SIDESLIP, Y_SPEED, Y_WHEEL, Y_YAW_RATE

BRAKING = 20.0  # a wheel with more brake torque than this is braking, with more drive torque driven [N m]


@compiled
def read_motion(car, cos_steer, sin_steer, vx, vy, r, out, j):
    """Fill column j of ``out`` with what follows from the motion alone: yaw rate and rolling wheels."""
    per_radius, half_front, half_rear = 1 / car.wheel_radius, 0.5 * car.track_front, 0.5 * car.track_rear
    across = (vy + car.lf * r) * sin_steer
    out[Y_YAW_RATE, j] = r
    out[Y_WHEEL, j] = ((vx - half_front * r) * cos_steer + across) * per_radius
    out[Y_WHEEL + 1, j] = ((vx + half_front * r) * cos_steer + across) * per_radius
    out[Y_WHEEL + 2, j] = (vx - half_rear * r) * per_radius
    out[Y_WHEEL + 3, j] = (vx + half_rear * r) * per_radius


@compiled
def read_extras(variances, states, out):
    """Fill the rows of ``out`` of what no production car has: what an optical sensor would read, if it is on board.

    A loop of its own: asking in the one before would cost a particle filter 15 % where there is no such sensor.
    """
    out[Y_SPEED:] = 0.0
    if not (math.isnan(variances[Y_SPEED]) and math.isnan(variances[Y_SIDESLIP])):
        for j in range(states.shape[1]):
            vx, vy = states[0, j], states[1, j]
            out[Y_SPEED, j], out[Y_SIDESLIP, j] = math.sqrt(vx * vx + vy * vy), math.atan2(vy, vx)


@compiled
def attend_wheels(model, memory, u, y):
    """``attend`` for models that predict the readings of rolling wheels."""
    # A driven wheel slips: it is left out while one that rolls freely is heard. So does a braking one, which is slow to
    # spin up again. While all brake, the fastest stays, with a standard deviation of some slip, but only if it keeps up
    # with a reference speed that falls no faster than the accelerometer says: else it is locking, and would draw the
    # estimate, and the slip limiter, down with it.
    variances, after = np.empty(10), np.empty(5)
    for i in range(10):
        variances[i] = np.nan if math.isnan(y[i]) else model.variances[i]
    fastest, rolling, total = -1, 0, 0.0
    free, free_total = 0, 0.0
    for i in range(4):
        after[i] = 0.0 if u[U_BRAKE + i] > BRAKING else memory[i] + model.dt
        speed = y[Y_WHEEL + i]
        if math.isnan(speed):
            continue
        if fastest < 0 or speed > y[Y_WHEEL + fastest]:
            fastest = i
        if after[i] < model.brake_hold:
            variances[Y_WHEEL + i] = np.nan
        else:
            rolling += 1
            total += speed
            variances[Y_WHEEL + i] += (model.slip * speed) ** 2
            if abs(u[U_DRIVE + i]) <= BRAKING:
                free += 1
                free_total += speed
    if 0 < free < rolling:
        for i in range(4):
            if abs(u[U_DRIVE + i]) > BRAKING:
                variances[Y_WHEEL + i] = np.nan
        rolling, total = free, free_total
    if rolling > 0:
        after[4] = model.wheel_radius * total / rolling
        return variances, after
    felt = -model.friction * GRAVITY if math.isnan(y[Y_AX]) else min(0.0, y[Y_AX])
    after[4] = memory[4] + model.dt * (felt - model.brake_margin)
    if fastest >= 0 and model.wheel_radius * y[Y_WHEEL + fastest] >= after[4]:
        k = Y_WHEEL + fastest
        after[4] = model.wheel_radius * y[k]
        variances[k] = model.variances[k] + (model.brake_slip * y[k]) ** 2
    return variances, after
