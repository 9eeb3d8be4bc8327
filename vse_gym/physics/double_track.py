"""The plant: a car with seven degrees of freedom, or eight if its body rolls, and nonlinear tyres.

Equations: Qin, Li, Li, Cao (2014), doi:10.6041/j.issn.1000-1298.2014.10.004, in ISO axes, with three additions: load
transfer follows the acceleration through a lag (the suspension's, and it breaks the algebraic loop), road slope and
bank, and Coulomb brakes that can lock a wheel and hold a standing car. Roll stands in :mod:`vse_gym.physics.roll`.

:func:`advance` is semi-implicit in each wheel's longitudinal slip velocity R w - vx, which is what makes wheels stiff
at low speed: it is stable at 1 ms down to standstill. A Runge-Kutta method and unsteady tyres stand in
:mod:`vse_gym.physics.reference`.
"""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.parameters import (
    AX,
    AY,
    BRAKE_WORK,
    DISTANCE,
    GRAVITY,
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
from vse_gym.physics.roll import accelerations, felt, overturning, roll_on
from vse_gym.physics.tyres import tyre_force

SPEED_FLOOR = 0.5  # slip is taken relative to at least this speed [m/s]

# Columns of the scratch table of one force evaluation, a row per wheel.
FX, FY, MZ, STIFFNESS, LOAD, SLIP = range(6)
ARM_X, ARM_Y, COS, SIN, RADIUS, REST, BY_AX, BY_MOMENT = range(6, 14)  # these stay through a control step
CONTACT = 14


@compiled
def wheel_position(vehicle, i):
    """Position (x, y) of wheel i relative to the centre of gravity [m]."""
    if i < 2:
        x, half = vehicle.lf, 0.5 * vehicle.track_front
    else:
        x, half = -vehicle.lr, 0.5 * vehicle.track_rear
    return x, (half if i % 2 == 0 else -half)


@compiled
def wheel_velocity(vehicle, i, vx, vy, yaw_rate, steer):
    """Velocity of wheel i's centre in its own axes, along and across [m/s]; only the front wheels steer."""
    x, y = wheel_position(vehicle, i)
    along, across = vx - yaw_rate * y, vy + yaw_rate * x
    if i >= 2:
        return along, across
    c, s = math.cos(steer), math.sin(steer)
    return along * c + across * s, across * c - along * s


@compiled
def load_shares(vehicle, i):
    """Vertical load of wheel i for each m/s2 of gravity [kg], for each m/s2 along the car [kg], and for each newton
    metre of the moment about its long axis [1/m].
    """
    wheelbase = vehicle.lf + vehicle.lr
    by_ax = vehicle.mass * vehicle.height / (2 * wheelbase)
    if i < 2:
        rest, by_ax = vehicle.mass * vehicle.lr / (2 * wheelbase), -by_ax
        by_moment = vehicle.front_transfer / vehicle.track_front
    else:
        rest = vehicle.mass * vehicle.lf / (2 * wheelbase)
        by_moment = (1 - vehicle.front_transfer) / vehicle.track_rear
    return rest, by_ax, (-by_moment if i % 2 == 0 else by_moment)


@compiled
def wheel_load(vehicle, i, ax, ay, gravity):
    """Vertical load of wheel i under specific forces ax, ay [m/s2], quasi-static, never negative [N]."""
    rest, by_ax, by_moment = load_shares(vehicle, i)
    return max(0.0, rest * gravity + by_ax * ax + by_moment * vehicle.mass * ay * vehicle.height)


@compiled
def segment(road, distance):
    """Index of the road's segment at a distance [m]."""
    k = 0
    while k + 1 < road.start.size and road.start[k + 1] <= distance:
        k += 1
    return k


@compiled
def place_wheels(vehicle, steer, wheels):
    """Fill the columns of ``wheels`` (4, CONTACT) that stay the same while the steering angle does."""
    for i in range(4):
        wheels[i, ARM_X], wheels[i, ARM_Y] = wheel_position(vehicle, i)
        wheels[i, COS], wheels[i, SIN] = (math.cos(steer), math.sin(steer)) if i < 2 else (1.0, 0.0)
        wheels[i, RADIUS] = vehicle.wheel_radius * (1 + vehicle.radius_error[i])
        wheels[i, REST], wheels[i, BY_AX], wheels[i, BY_MOMENT] = load_shares(vehicle, i)


@compiled
def tyre_forces(vehicle, road, x, gravity, wheels):
    """Evaluate the four tyres at state x; fill the other columns of ``wheels``, with forces in wheel axes.

    STIFFNESS is the derivative of FX with respect to the slip velocity R w - v [N s/m]. ``gravity`` is that across
    the road, see :func:`gravity_on` [m/s2].
    """
    leaning = overturning(vehicle.body, vehicle, x)
    for i in range(4):
        px, py, c, s = wheels[i, ARM_X], wheels[i, ARM_Y], wheels[i, COS], wheels[i, SIN]
        along, across = x[VX] - x[YAW_RATE] * py, x[VY] + x[YAW_RATE] * px
        v = along * c + across * s
        base = 1.0 / max(abs(v), SPEED_FLOOR)
        slip = wheels[i, RADIUS] * x[WHEEL + i] - v
        kappa, tan_alpha = slip * base, (along * s - across * c) * base
        load = max(0.0, wheels[i, REST] * gravity + wheels[i, BY_AX] * x[LOAD_AX] + wheels[i, BY_MOMENT] * leaning)
        under = segment(road, x[DISTANCE] + px)
        friction = road.friction_left[under] if i % 2 == 0 else road.friction_right[under]
        if i < 2:
            fx, fy, mz, slope = tyre_force(vehicle.front_tyre, kappa, tan_alpha, load, friction)
        else:
            fx, fy, mz, slope = tyre_force(vehicle.rear_tyre, kappa, tan_alpha, load, friction)
        wheels[i, FX], wheels[i, FY], wheels[i, MZ], wheels[i, STIFFNESS] = fx, fy, mz, slope * base
        wheels[i, LOAD], wheels[i, SLIP] = load, slip


@compiled
def contact(vehicle, road, x, steer, wheels):
    """Fill all of ``wheels`` (4, CONTACT): where the wheels are, and what their tyres do at state x."""
    place_wheels(vehicle, steer, wheels)
    gravity, _, _ = gravity_on(road, segment(road, x[DISTANCE]))
    tyre_forces(vehicle, road, x, gravity, wheels)


@compiled
def road_friction(vehicle, road, distance):
    """Friction coefficient under the car, mean of its four wheels [-]."""
    total = 0.0
    for x in (vehicle.lf, -vehicle.lr):
        k = segment(road, distance + x)
        total += 0.25 * (road.friction_left[k] + road.friction_right[k])
    return total


@compiled
def specific_forces(vehicle, wheels):
    """Sum of the tyres' forces over the mass, ax and ay [m/s2], and the yaw acceleration [rad/s2]."""
    fx, fy, mz = 0.0, 0.0, 0.0
    for i in range(4):
        along = wheels[i, FX] * wheels[i, COS] - wheels[i, FY] * wheels[i, SIN]
        across = wheels[i, FX] * wheels[i, SIN] + wheels[i, FY] * wheels[i, COS]
        fx += along
        fy += across
        mz += wheels[i, ARM_X] * across - wheels[i, ARM_Y] * along + wheels[i, MZ]
    by_mass = 1 / vehicle.mass
    return fx * by_mass, fy * by_mass, mz * (1 / vehicle.yaw_inertia)


@compiled
def gravity_on(road, k):
    """Gravity on segment k: what presses the car onto it, and what pulls it along and across [m/s2]."""
    slope, bank = road.slope[k], road.bank[k]
    return GRAVITY * math.cos(slope) * math.cos(bank), -GRAVITY * math.sin(slope), -GRAVITY * math.sin(bank)


@compiled
def brake_direction(speed, net, brake):
    """Sign of the brake's torque on a wheel: against its turning; of a standing wheel, against ``net``, the torque of
    the rest [N m], or 0 if the brake holds it.
    """
    if speed > 0:
        return 1.0
    if speed < 0:
        return -1.0
    if abs(net) <= brake:
        return 0.0
    return math.copysign(1.0, net)


@compiled
def _end_force(force, stiffness, slip, push, compliance):
    """Force at the end of a step in which the slip velocity, left to itself, would change by push.

    The tangent, unless it carries the slip velocity through zero: a sliding tyre has no tangent, and friction alone
    would turn slip round for ever. Then the secant, which never lets friction overshoot.
    """
    change = push / (1 + compliance * stiffness)
    if slip * (slip + change) < 0 and force / slip > stiffness:
        stiffness = force / slip
        change = push / (1 + compliance * stiffness)
    return force + stiffness * change


@compiled
def _settle_wheels(vehicle, x, inputs, h, ax, ay, yaw_acceleration, wheels):
    """Turn the wheels on by h, and replace each FX by its value at the end of the step.

    FX is linearised in the slip velocity s = R w - v: FX' = FX + C ds with ds implicit, ds = h (R dw/dt - dv/dt) at
    FX'. A wheel's own reaction on the car's speed counts four times, as if all wheels did alike. Wheel and car feel
    the same FX', so momentum is kept exactly.
    """
    gain, share = h / vehicle.wheel_inertia, 4 * h / vehicle.mass
    dvx, dvy = ax + x[VY] * x[YAW_RATE], ay - x[VX] * x[YAW_RATE]
    for i in range(4):
        c, s, radius = wheels[i, COS], wheels[i, SIN], wheels[i, RADIUS]
        dv = (dvx - yaw_acceleration * wheels[i, ARM_Y]) * c + (dvy + yaw_acceleration * wheels[i, ARM_X]) * s
        force, stiffness, speed = wheels[i, FX], wheels[i, STIFFNESS], x[WHEEL + i]
        drive, brake = inputs.drive[i], inputs.brake[i]
        direction = 1.0
        if brake > 0:
            held = _end_force(force, stiffness, wheels[i, SLIP], -h * dv, share)  # FX' if the wheel stands still
            direction = brake_direction(speed, drive - radius * held, brake)
            if direction == 0.0:
                wheels[i, FX] = held
                continue
        torque = drive - direction * brake
        push = radius * gain * (torque - radius * force) - h * dv
        force = _end_force(force, stiffness, wheels[i, SLIP], push, share + gain * radius * radius)
        after = speed + gain * (torque - radius * force)
        if brake > 0 and speed * after < 0:
            after = 0.0
        wheels[i, FX] = force
        x[WHEEL + i] = after
        x[BRAKE_WORK] += h * brake * 0.5 * abs(speed + after)


@compiled
def advance(vehicle, road, state, inputs, steps, h):
    """The state after ``steps`` semi-implicit steps of ``h`` seconds: (STATE_SIZE,) to (STATE_SIZE,).

    First order; stable at 1 ms from standstill to any speed, with wheels that spin, lock or stand.
    """
    x = state.copy()
    wheels, here = np.empty((4, CONTACT)), segment(road, x[DISTANCE])
    place_wheels(vehicle, inputs.steer, wheels)
    gravity, gx, gy = gravity_on(road, here)
    for _ in range(steps):
        if segment(road, x[DISTANCE]) != here:
            here = segment(road, x[DISTANCE])
            gravity, gx, gy = gravity_on(road, here)
        tyre_forces(vehicle, road, x, gravity, wheels)
        fx, fy, mz = specific_forces(vehicle, wheels)
        ax, ay, yaw_acceleration, _ = accelerations(vehicle.body, vehicle, x, fx, fy, mz, h)
        _settle_wheels(vehicle, x, inputs, h, ax + gx, ay + gy, yaw_acceleration, wheels)
        fx, fy, mz = specific_forces(vehicle, wheels)
        ax, ay, yaw_acceleration, roll_acceleration = accelerations(vehicle.body, vehicle, x, fx, fy, mz, h)
        x[VX] += h * (ax + gx + x[VY] * x[YAW_RATE])
        x[VY] += h * (ay + gy - x[VX] * x[YAW_RATE])  # with the new vx: the turning of the axes keeps the speed
        x[YAW_RATE] += h * yaw_acceleration
        roll_on(vehicle.body, x, roll_acceleration, h)
        yaw = x[YAW] + 0.5 * h * x[YAW_RATE]
        x[YAW] += h * x[YAW_RATE]
        cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
        x[X] += h * (x[VX] * cos_yaw - x[VY] * sin_yaw)
        x[Y] += h * (x[VX] * sin_yaw + x[VY] * cos_yaw)
        x[DISTANCE] += h * math.sqrt(x[VX] ** 2 + x[VY] ** 2)
        follow = h / (vehicle.load_lag + h)
        x[LOAD_AX] += follow * (fx - x[LOAD_AX])
        x[LOAD_AY] += follow * (fy - x[LOAD_AY])
        x[AX], x[AY] = ax, felt(vehicle.body, x, ay, gy)
    return x


def rolling_start(vehicle, speed: float):
    """The state of a car that rolls straight ahead at a speed [m/s] from the origin, (STATE_SIZE,)."""
    x = np.zeros(STATE_SIZE)
    x[VX] = speed
    for i in range(4):
        x[WHEEL + i] = speed / (vehicle.wheel_radius * (1 + vehicle.radius_error[i]))
    return x
