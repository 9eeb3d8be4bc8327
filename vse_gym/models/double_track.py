"""The double track: four wheels with the car's own tyres, each with its own load and slip."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models.channels import BRAKING, attend_wheels, read_extras, read_motion
from vse_gym.models.nominal import Nominal
from vse_gym.models.single_track import SLOWEST, SingleTrackTuning
from vse_gym.models.tuning import Settings, tunable
from vse_gym.physics.double_track import wheel_load, wheel_position
from vse_gym.physics.parameters import GRAVITY, Vehicle
from vse_gym.physics.tyres import tyre_force
from vse_gym.types import U_BRAKE, U_DRIVE, U_STEER, Y_AX, Y_AY, Y_WHEEL, Array

# What ``heed`` puts behind the inputs of a reading: wheel speeds, NaN where a wheel is free or not heard [rad/s], and
# the force that brakes may make in all, by the accelerometer [N]
U_WHEEL, U_FELT = 9, 13


class DoubleTrack(NamedTuple):
    """Four wheels, load transfer and combined slip. State: vx, vy [m/s], yaw rate [rad/s].

    Wheel speeds are inputs, not states: a wheel's own motion is faster than a step of 10 ms can follow (its pole lies
    at -490 1/s at 80 km/h). It explains all channels but the roll rate.
    """

    vehicle: Vehicle
    friction: float  # [-]
    wheel_radius: float  # [m]
    slip: float  # standard deviation of the slip of a rolling wheel, relative [-]
    brake_slip: float  # the same of the fastest wheel while all four brake [-]
    brake_hold: float  # a wheel is no speedometer for this long after it braked [s]
    brake_margin: float  # by so much may the accelerometer miss how fast the car slows down [m/s2]
    slowest: float  # speed to which slips are taken at least [m/s]
    dt: float  # [s]
    prior_mean: Array  # (3,)
    prior_cov: Array  # (3, 3)
    process_cov: Array  # (3, 3), of one step
    variances: Array  # of the channels, without wheel slip; NaN: not used; (10,)
    memory: Array  # as of the single track, (5,)


@dataclass(frozen=True)
class DoubleTrackTuning(Settings):
    """How far a filter trusts the double track: fields and defaults are those of :class:`SingleTrackTuning`.

    So what differs between the two models' rows is the model alone; the defaults were searched for the single track.
    """

    vx_noise: float = tunable(1.2, 0.03, 3.0)  # process noise density [m/s per sqrt(s)]
    vy_noise: float = tunable(0.8, 0.03, 5.0)  # [m/s per sqrt(s)]
    yaw_noise: float = tunable(0.8, 0.01, 2.0)  # [rad/s per sqrt(s)]
    ax_error: float = tunable(1.0, 0.1, 3.0)  # error of the model's ax, added to the sensor's noise [m/s2]
    ay_error: float = tunable(6.0, 0.3, 8.0)  # [m/s2]
    yaw_rate_error: float = tunable(0.0, 0.0, 0.1)  # added to the gyro's noise [rad/s]
    wheel_error: float = tunable(0.0, 0.0, 1.0)  # added to the wheel speeds' noise [rad/s]
    slip: float = 0.005  # slip of a rolling wheel [-]
    brake_slip: float = 0.05  # slip of the fastest wheel while all brake [-]
    brake_hold: float = 0.1  # time for which a wheel is no speedometer after it braked [s]
    brake_margin: float = 0.3  # by so much may the accelerometer miss how fast the car slows down [m/s2]
    vx_prior: float = 1.0  # standard deviation at the start [m/s]
    vy_prior: float = 0.2  # [m/s]
    yaw_prior: float = 0.02  # [rad/s]

    def build(self, nominal: Nominal) -> DoubleTrack:
        """The model of a nominal car with this trust."""
        car, like = nominal.vehicle, SingleTrackTuning(**vars(self)).build(nominal)
        front, rear = car.front_tyre, car.rear_tyre
        stiffest = max(
            2 * (front.slip_stiffness + rear.slip_stiffness),
            2 * (front.cornering_stiffness + rear.cornering_stiffness),
        )
        return DoubleTrack(
            vehicle=car,
            friction=like.friction,
            wheel_radius=car.wheel_radius,
            slip=like.slip,
            brake_slip=like.brake_slip,
            brake_hold=like.brake_hold,
            brake_margin=like.brake_margin,
            slowest=max(SLOWEST, nominal.dt * stiffest / car.mass),  # half of what Heun's method would bear
            dt=like.dt,
            prior_mean=like.prior_mean,
            prior_cov=like.prior_cov,
            process_cov=like.process_cov,
            variances=like.variances,
            memory=like.memory,
        )


# What the inputs alone determine of a wheel: columns of a table with a row each
X, Y, COS, SIN, LOAD, TRANSFER, SPEED, SLIP, LAG_X, LAG_Y, GAIN_X, GAIN_Y = range(12)


@compiled
def wheel_table(model, u):
    """The table (4, 12): position, direction, load without and per lateral acceleration, circumference speed, NaN
    where it is not known, and the slip that the torque would need then [m, -, N, N s2/m, m/s, -]; slips that a tyre has
    come from, and how far it has come from there to its steady ones: all the way.
    """
    car, table = model.vehicle, np.empty((4, 12))
    weight = model.friction * car.mass * GRAVITY
    total = 0.0
    for i in range(4):
        total += (u[U_DRIVE + i] - u[U_BRAKE + i]) / car.wheel_radius
    ax = max(-weight, u[U_FELT], min(weight, total)) / car.mass
    cos_steer, sin_steer = math.cos(u[U_STEER]), math.sin(u[U_STEER])
    for i in range(4):
        table[i, X], table[i, Y] = wheel_position(car, i)
        table[i, COS], table[i, SIN] = (cos_steer, sin_steer) if i < 2 else (1.0, 0.0)
        load = wheel_load(car, i, ax, 0.0, GRAVITY)
        share = car.front_transfer / car.track_front if i < 2 else (1 - car.front_transfer) / car.track_rear
        across = car.mass * car.height * share
        table[i, LOAD], table[i, TRANSFER] = load, -across if i % 2 == 0 else across
        table[i, SPEED] = car.wheel_radius * u[U_WHEEL + i]
        limit = model.friction * load
        force = max(-limit, min(limit, (u[U_DRIVE + i] - u[U_BRAKE + i]) / car.wheel_radius))
        table[i, SLIP] = force / (car.front_tyre.slip_stiffness if i < 2 else car.rear_tyre.slip_stiffness)
        table[i, LAG_X], table[i, LAG_Y], table[i, GAIN_X], table[i, GAIN_Y] = 0.0, 0.0, 1.0, 1.0
    return table


@compiled
def steady_slips(model, table, i, vx, vy, yaw_rate):
    """Slip ratio and tangent of the slip angle of wheel i [-]."""
    c, s, px, py = table[i, COS], table[i, SIN], table[i, X], table[i, Y]
    ux, uy = vx - yaw_rate * py, vy + yaw_rate * px
    v = ux * c + uy * s
    per_speed = 1 / max(abs(v), model.slowest)
    kappa = table[i, SLIP] if math.isnan(table[i, SPEED]) else (table[i, SPEED] - v) * per_speed
    return kappa, (ux * s - uy * c) * per_speed


@compiled
def turning(model, vx, yaw_rate):
    """The lateral acceleration that moves load [m/s2]: the body leans with the turn, its lag is about the tyres'."""
    limit = model.friction * GRAVITY
    return max(-limit, min(limit, vx * yaw_rate))


@compiled
def tyre_forces(model, table, felt, vx, vy, yaw_rate, across):
    """Sums of the tyres' forces over the mass, ax and ay [m/s2], and of their moments over the yaw inertia [rad/s2].

    Args:
        model: With vehicle, friction and slowest.
        table: As of :func:`wheel_table`.
        felt: Force that brakes may make in all [N].
        vx, vy, yaw_rate: Of the car.
        across: Lateral acceleration of which the load transfer is what the table says [m/s2].
    """
    car = model.vehicle
    along, along_x, along_y, along_turn = 0.0, 0.0, 0.0, 0.0  # of forces along the wheels
    side_x, side_y, side_turn = 0.0, 0.0, 0.0  # of forces across them
    for i in range(4):
        c, s, px, py = table[i, COS], table[i, SIN], table[i, X], table[i, Y]
        kappa, tan_alpha = steady_slips(model, table, i, vx, vy, yaw_rate)
        kappa = table[i, LAG_X] + table[i, GAIN_X] * (kappa - table[i, LAG_X])
        tan_alpha = table[i, LAG_Y] + table[i, GAIN_Y] * (tan_alpha - table[i, LAG_Y])
        load = max(0.0, table[i, LOAD] + table[i, TRANSFER] * across)
        if i < 2:
            fx, fy, mz, _ = tyre_force(car.front_tyre, kappa, tan_alpha, load, model.friction)
        else:
            fx, fy, mz, _ = tyre_force(car.rear_tyre, kappa, tan_alpha, load, model.friction)
        along += fx
        along_x += fx * c
        along_y += fx * s
        along_turn += fx * (px * s - py * c)
        side_x -= fy * s
        side_y += fy * c
        side_turn += fy * (px * c + py * s) + mz
    share = felt / along if along < felt else 1.0  # slip on a road of less friction than told: no more than is felt
    ax, ay = (share * along_x + side_x) / car.mass, (share * along_y + side_y) / car.mass
    return ax, ay, (share * along_turn + side_turn) / car.yaw_inertia


@compiled
def _forces(model, table, felt, vx, vy, yaw_rate):
    """Specific forces ax, ay [m/s2] and yaw acceleration [rad/s2] of the double track."""
    return tyre_forces(model, table, felt, vx, vy, yaw_rate, turning(model, vx, yaw_rate))


@advance.register(DoubleTrack)
@compiled
def _(model, states, u):
    # Heun's method, as for the single track
    table, h = wheel_table(model, u), model.dt
    out = np.empty_like(states)
    for j in range(states.shape[1]):
        vx, vy, r = states[0, j], states[1, j], states[2, j]
        x, y, q = vx, vy, r
        for stage in range(2):
            ax, ay, dr = _forces(model, table, u[U_FELT], x, y, q)
            dvx, dvy = ax + y * q, ay - x * q
            if stage == 0:
                out[0, j], out[1, j], out[2, j] = dvx, dvy, dr
                x, y, q = vx + h * dvx, vy + h * dvy, r + h * dr
            else:
                out[0, j] = vx + 0.5 * h * (out[0, j] + dvx)
                out[1, j] = vy + 0.5 * h * (out[1, j] + dvy)
                out[2, j] = r + 0.5 * h * (out[2, j] + dr)
    return out


@compiled
def read_wheels(car, table, u, vx, vy, r, out, j):
    """As ``read_motion``, but a driven wheel turns faster than it rolls, by the slip that its force comes from."""
    read_motion(car, table[0, COS], table[0, SIN], vx, vy, r, out, j)
    for i in range(4):
        if u[U_DRIVE + i] > BRAKING:
            out[Y_WHEEL + i, j] *= 1 + table[i, SLIP]


@observe.register(DoubleTrack)
@compiled
def _(model, states, u):
    table = wheel_table(model, u)
    out = np.empty((10, states.shape[1]))
    for j in range(states.shape[1]):
        vx, vy, r = states[0, j], states[1, j], states[2, j]
        out[Y_AX, j], out[Y_AY, j], _ = _forces(model, table, u[U_FELT], vx, vy, r)
        read_wheels(model.vehicle, table, u, vx, vy, r, out, j)
    read_extras(model.variances, states, out)
    return out


@heed.register(DoubleTrack)
@compiled
def heed_wheels(model, u, y):
    """``heed`` for models that take wheel speeds for inputs: (14,)."""
    # A wheel under torque is known by its slip. Of a free one, and of one whose sensor is silent, the torque says
    # more than the small difference of two large speeds would.
    out = np.empty(U_FELT + 1)
    for i in range(U_WHEEL):
        out[i] = u[i]
    for i in range(4):
        free = u[U_BRAKE + i] <= BRAKING and abs(u[U_DRIVE + i]) <= BRAKING
        out[U_WHEEL + i] = np.nan if free else y[Y_WHEEL + i]
    felt = -math.inf if math.isnan(y[Y_AX]) else min(0.0, y[Y_AX] - model.brake_margin)
    out[U_FELT] = model.vehicle.mass * felt
    return out


attend.register(DoubleTrack)(attend_wheels)


@report.register(DoubleTrack)
@compiled
def _(model, state, u):
    ax, ay, _ = _forces(model, wheel_table(model, u), u[U_FELT], state[0], state[1], state[2])
    return np.array([state[0], state[1], state[2], ax, ay])
