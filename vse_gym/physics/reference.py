"""The reference integrator of the plant, and the unsteady tyre that it alone knows.

With steady tyres the classical Runge-Kutta method of order four is for use above 5 m/s. Unsteady tyres have slips that
follow the wheel with a relaxation length, Pacejka (2012), chapter 8, single contact point:
sigma dkappa'/dt = (R w - v) - |v| kappa', the lateral slip likewise. At rest such a tyre is a spring, so that a car can
truly stand; below LOW_SPEED it is damped, and its deflection is kept at what friction can hold.
"""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.double_track import (
    ARM_X,
    ARM_Y,
    CONTACT,
    COS,
    FX,
    FY,
    LOAD,
    MZ,
    RADIUS,
    SIN,
    SLIP,
    brake_direction,
    contact,
    gravity_on,
    segment,
    specific_forces,
)
from vse_gym.physics.parameters import (
    AX,
    AY,
    BRAKE_WORK,
    DISTANCE,
    LAG_X,
    LAG_Y,
    LOAD_AX,
    LOAD_AY,
    STATE_SIZE,
    VX,
    VY,
    WHEEL,
    YAW,
    YAW_RATE,
    X,
    Y,
)
from vse_gym.physics.roll import accelerations, added_derivatives, differentiate, felt
from vse_gym.physics.tyres import tyre_force

DERIVATIVES = 22  # how many states of a rigid car have a derivative: all but the outputs
LOW_SPEED = 2.5  # below it an unsteady tyre is damped and its deflection bounded [m/s]
DAMPING = 0.1  # slip that counts beside the deflection, per slip velocity, at rest; a third of critical [s/m]
DEFLECTION = 2.0  # normalised slip, stiffness times slip over friction times load, up to which a standing tyre deflects


@compiled
def low_speed(v):
    """Weight of what is only done at low speed: 1 at rest, 0 from LOW_SPEED on, smooth."""
    return 0.5 * (1 + math.cos(math.pi * v / LOW_SPEED)) if abs(v) < LOW_SPEED else 0.0


@compiled
def relax(tyre, x, i, v, across, load, friction, wheels):
    """Replace the force of wheel i, steady so far, by that of the slips in the state.

    Returns:
        slip_y: Slip velocity across the wheel, positive pushes left [m/s].
        passing: Speed at which new tread takes the deflected one's place [m/s]: that of rolling or, near standstill,
            of sliding. Else a tyre that slides at rest would be wound up for ever, and then push the car back.
    """
    slip_x, slip_y, near = wheels[i, SLIP], -across, low_speed(v)
    kappa, tan_alpha = x[LAG_X + i] + DAMPING * near * slip_x, x[LAG_Y + i] + DAMPING * near * slip_y
    wheels[i, FX], wheels[i, FY], wheels[i, MZ], _ = tyre_force(tyre, kappa, tan_alpha, load, friction)
    if near == 0.0:
        return slip_y, abs(v)
    along = tyre_force(tyre, 0.0, 0.0, load, friction)[3]
    aside = along * tyre.cornering_stiffness / tyre.slip_stiffness
    sliding = math.sqrt((along * slip_x) ** 2 + (aside * slip_y) ** 2) / (friction * load + 1e-6)
    return slip_y, max(abs(v), near * sliding / DEFLECTION)


@compiled
def unsteady_contact(vehicle, road, x, wheels, dx):
    """Forces of unsteady tyres, into ``wheels`` as ``contact`` left it, and their slips' derivatives, into ``dx``."""
    for i in range(4):
        px, py, c, s = wheels[i, ARM_X], wheels[i, ARM_Y], wheels[i, COS], wheels[i, SIN]
        vx, vy = x[VX] - x[YAW_RATE] * py, x[VY] + x[YAW_RATE] * px
        v, across = vx * c + vy * s, vy * c - vx * s
        under = segment(road, x[DISTANCE] + px)
        friction = road.friction_left[under] if i % 2 == 0 else road.friction_right[under]
        if i < 2:
            slip_y, passing = relax(vehicle.front_tyre, x, i, v, across, wheels[i, LOAD], friction, wheels)
        else:
            slip_y, passing = relax(vehicle.rear_tyre, x, i, v, across, wheels[i, LOAD], friction, wheels)
        dx[LAG_X + i] = (wheels[i, SLIP] - passing * x[LAG_X + i]) / vehicle.relaxation_x
        dx[LAG_Y + i] = (slip_y - passing * x[LAG_Y + i]) / vehicle.relaxation_y


@compiled
def derivative(vehicle, road, x, inputs, direction, wheels, dx):
    """Time derivative of the state, into ``dx``; ``direction`` (4,) is the frozen sign of the brakes' torques.

    A standing wheel whose direction is 0 is held by its brake and stays.
    """
    contact(vehicle, road, x, inputs.steer, wheels)
    for i in range(8):
        dx[LAG_X + i] = 0.0
    if vehicle.relaxation_x > 0:
        unsteady_contact(vehicle, road, x, wheels, dx)
    fx, fy, mz = specific_forces(vehicle, wheels)
    ax, ay, yaw_acceleration, roll_acceleration = accelerations(vehicle.body, vehicle, x, fx, fy, mz, 0.0)
    _, gx, gy = gravity_on(road, segment(road, x[DISTANCE]))
    cos_yaw, sin_yaw = math.cos(x[YAW]), math.sin(x[YAW])
    dx[X] = x[VX] * cos_yaw - x[VY] * sin_yaw
    dx[Y] = x[VX] * sin_yaw + x[VY] * cos_yaw
    dx[YAW] = x[YAW_RATE]
    dx[VX] = ax + gx + x[VY] * x[YAW_RATE]
    dx[VY] = ay + gy - x[VX] * x[YAW_RATE]
    dx[YAW_RATE] = yaw_acceleration
    dx[LOAD_AX] = (fx - x[LOAD_AX]) / vehicle.load_lag
    dx[LOAD_AY] = (fy - x[LOAD_AY]) / vehicle.load_lag
    differentiate(vehicle.body, x, roll_acceleration, dx)
    dx[DISTANCE] = math.sqrt(x[VX] ** 2 + x[VY] ** 2)
    dx[BRAKE_WORK] = 0.0
    for i in range(4):
        torque = inputs.drive[i] - direction[i] * inputs.brake[i] - wheels[i, RADIUS] * wheels[i, FX]
        held = direction[i] == 0.0 and inputs.brake[i] > 0
        dx[WHEEL + i] = 0.0 if held else torque / vehicle.wheel_inertia
        dx[BRAKE_WORK] += inputs.brake[i] * direction[i] * x[WHEEL + i]


@compiled
def advance_reference(vehicle, road, state, inputs, steps, h):
    """The state after ``steps`` Runge-Kutta steps of ``h`` seconds: (STATE_SIZE,) to (STATE_SIZE,).

    With steady tyres above 5 m/s, with unsteady ones at every speed.
    """
    x = state.copy()
    start = np.empty(STATE_SIZE)
    size = DERIVATIVES + added_derivatives(vehicle.body)
    total = np.empty(size)
    dx = np.empty(size)
    wheels = np.empty((4, CONTACT))
    direction = np.empty(4)
    for _ in range(steps):
        contact(vehicle, road, x, inputs.steer, wheels)
        if vehicle.relaxation_x > 0:
            unsteady_contact(vehicle, road, x, wheels, dx)
        for i in range(4):
            net = inputs.drive[i] - wheels[i, RADIUS] * wheels[i, FX]
            direction[i] = brake_direction(x[WHEEL + i], net, inputs.brake[i])
        start[:] = x
        total[:] = 0.0
        for stage in range(4):
            derivative(vehicle, road, x, inputs, direction, wheels, dx)
            weight = h / 3 if stage == 1 or stage == 2 else h / 6
            reach = h if stage == 2 else h / 2
            for j in range(size):
                total[j] += weight * dx[j]
                x[j] = start[j] + (reach * dx[j] if stage < 3 else total[j])
        for i in range(4):
            if inputs.brake[i] > 0 and start[WHEEL + i] * x[WHEEL + i] < 0:
                x[WHEEL + i] = 0.0
    contact(vehicle, road, x, inputs.steer, wheels)
    if vehicle.relaxation_x > 0:
        unsteady_contact(vehicle, road, x, wheels, dx)
    fx, fy, mz = specific_forces(vehicle, wheels)
    ax, ay, _, _ = accelerations(vehicle.body, vehicle, x, fx, fy, mz, 0.0)
    _, _, gy = gravity_on(road, segment(road, x[DISTANCE]))
    x[AX], x[AY] = ax, felt(vehicle.body, x, ay, gy)
    return x
