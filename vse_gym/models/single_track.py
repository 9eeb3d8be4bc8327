"""The single track: two axles with saturating tyres, and the brakes' yaw moment."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models.channels import BRAKING, attend_wheels, read_extras, read_motion
from vse_gym.models.nominal import Nominal
from vse_gym.models.tuning import Settings, tunable
from vse_gym.physics.parameters import GRAVITY
from vse_gym.physics.tyres import KNOT
from vse_gym.types import (
    CHANNELS,
    U_BRAKE,
    U_DRIVE,
    U_STEER,
    Y_AX,
    Y_AY,
    Y_ROLL_RATE,
    Y_SIDESLIP,
    Y_SPEED,
    Y_YAW_RATE,
    Array,
)


class SingleTrack(NamedTuple):
    """Two axles with saturating tyres and the brakes' yaw moment. State: vx, vy [m/s], yaw rate [rad/s].

    Inputs are those of :class:`Reading`; it explains all channels but the roll rate.
    """

    mass: float  # [kg]
    yaw_inertia: float  # [kg m2]
    lf: float  # [m]
    lr: float  # [m]
    height: float  # [m]
    track_front: float  # [m]
    track_rear: float  # [m]
    wheel_radius: float  # [m]
    stiffness_front: float  # cornering stiffness of the axle [N/rad]
    stiffness_rear: float  # [N/rad]
    friction: float  # [-]
    brake_moment: float  # 1; 0 leaves the brakes' yaw moment out, to show what that costs
    slip: float  # standard deviation of the slip of a rolling wheel, relative [-]
    brake_slip: float  # the same of the fastest wheel while all four brake [-]
    brake_hold: float  # a wheel is not believed for this long after it braked [s]
    brake_margin: float  # by so much may the accelerometer miss what brake torques promise [m/s2]
    dt: float  # [s]
    prior_mean: Array  # (3,)
    prior_cov: Array  # (3, 3)
    process_cov: Array  # (3, 3), of one step
    variances: Array  # of the channels, without wheel slip; NaN: not used; (10,)
    memory: Array  # at the start: time since each wheel braked, (4) [s], and the reference speed [m/s]; (5,)


@dataclass(frozen=True)
class SingleTrackTuning(Settings):
    """How far a filter trusts the single track: everything that is not on a data sheet.

    The defaults suit a Kalman filter. They come from a random search, made before `vse-gym tune` was, on an earlier
    training study. The ranges are those of `vse-gym tune`.
    """

    vx_noise: float = tunable(1.2, 0.03, 3.0)  # process noise density [m/s per sqrt(s)]
    vy_noise: float = tunable(0.8, 0.03, 5.0)  # [m/s per sqrt(s)]
    yaw_noise: float = tunable(0.8, 0.01, 2.0)  # [rad/s per sqrt(s)]
    ax_error: float = tunable(1.0, 0.1, 3.0)  # error of the model's ax, added to the sensor's noise [m/s2]
    ay_error: float = tunable(6.0, 0.3, 8.0)  # [m/s2]
    # Added to the noise of gyro and wheel speeds: a bootstrap filter dies of a likelihood too narrow.
    yaw_rate_error: float = tunable(0.0, 0.0, 0.1)  # [rad/s]
    wheel_error: float = tunable(0.0, 0.0, 1.0)  # [rad/s]
    slip: float = 0.005  # slip of a rolling wheel [-]
    brake_slip: float = 0.05  # slip of the fastest wheel while all brake [-]
    brake_hold: float = 0.1  # time for which a wheel is not believed after it braked [s]
    brake_margin: float = 0.3  # by so much may the accelerometer miss what brake torques promise [m/s2]
    vx_prior: float = 1.0  # standard deviation at the start [m/s]
    vy_prior: float = 0.2  # [m/s]
    yaw_prior: float = 0.02  # [rad/s]
    brake_moment: bool = True  # whether the model knows that braking one side turns the car

    def build(self, nominal: Nominal) -> SingleTrack:
        """The model of a nominal car with this trust."""
        car, sheet = nominal.vehicle, nominal.sheet
        step = math.sqrt(nominal.dt)
        channels = np.full(len(CHANNELS), sheet.wheel_speed**2 + self.wheel_error**2)
        channels[Y_AX] = sheet.acceleration**2 + self.ax_error**2
        channels[Y_AY] = sheet.acceleration**2 + self.ay_error**2
        channels[Y_YAW_RATE] = sheet.yaw_rate**2 + self.yaw_rate_error**2
        channels[Y_SPEED], channels[Y_SIDESLIP], channels[Y_ROLL_RATE] = sheet.speed**2, sheet.sideslip**2, math.nan
        return SingleTrack(
            mass=car.mass,
            yaw_inertia=car.yaw_inertia,
            lf=car.lf,
            lr=car.lr,
            height=car.height,
            track_front=car.track_front,
            track_rear=car.track_rear,
            wheel_radius=car.wheel_radius,
            stiffness_front=2 * car.front_tyre.cornering_stiffness,
            stiffness_rear=2 * car.rear_tyre.cornering_stiffness,
            friction=float(nominal.friction),
            brake_moment=float(self.brake_moment),
            slip=float(self.slip),
            brake_slip=float(self.brake_slip),
            brake_hold=float(self.brake_hold),
            brake_margin=float(self.brake_margin),
            dt=float(nominal.dt),
            prior_mean=np.array([nominal.speed, 0.0, 0.0]),
            prior_cov=np.diag([self.vx_prior**2, self.vy_prior**2, self.yaw_prior**2]),
            process_cov=np.diag([(s * step) ** 2 for s in (self.vx_noise, self.vy_noise, self.yaw_noise)]),
            variances=channels,
            memory=np.array(4 * [10 * float(self.brake_hold)] + [float(nominal.speed)]),
        )


SLOWEST = 2.0  # speed to which slip angles are taken at least: below, a step of 10 ms would be unstable [m/s]


def slowest_linear(car: SingleTrack) -> float:
    """The same for linear tyres and Euler's method: a step times the faster pole is at most one [m/s]."""
    cf, cr = car.stiffness_front, car.stiffness_rear
    pole = max((cf + cr) / car.mass, (car.lf**2 * cf + car.lr**2 * cr) / car.yaw_inertia)  # times the speed
    return max(SLOWEST, car.dt * pole)


class Commanded(NamedTuple):
    """What the inputs alone determine, once for all states of a batch."""

    cos_steer: float
    sin_steer: float
    front: float  # longitudinal force of the front axle, along its wheels [N]
    rear: float  # [N]
    moment: float  # yaw moment of unequal longitudinal forces [N m]
    slope_front: float  # cornering stiffness over the friction limit [1/rad]
    slope_rear: float  # [1/rad]
    peak_front: float  # lateral force that the friction ellipse leaves the axle [N]
    peak_rear: float  # [N]
    per_mass: float  # 1/mass: a batch multiplies where it would divide [1/kg]
    per_inertia: float  # 1/yaw inertia [1/(kg m2)]


@compiled
def commanded(model, u):
    """Forces from torques: torque over radius, held to the friction at the wheel's static load plus the load transfer
    of the braking itself.
    """
    wheelbase = model.lf + model.lr
    total = 0.0
    for i in range(4):
        total += (u[U_DRIVE + i] - u[U_BRAKE + i]) / model.wheel_radius
    weight = model.mass * GRAVITY
    total = max(-model.friction * weight, min(model.friction * weight, total))
    load_front = max(0.0, (weight * model.lr - total * model.height) / wheelbase)
    load_rear = weight - load_front
    front, rear, moment = 0.0, 0.0, 0.0
    cos_steer, sin_steer = math.cos(u[U_STEER]), math.sin(u[U_STEER])
    for i in range(4):
        limit = model.friction * 0.5 * (load_front if i < 2 else load_rear)
        force = max(-limit, min(limit, (u[U_DRIVE + i] - u[U_BRAKE + i]) / model.wheel_radius))
        half = 0.5 * (model.track_front if i < 2 else model.track_rear) * (1.0 if i % 2 == 0 else -1.0)
        if i < 2:
            front += force
            moment -= half * force * cos_steer
        else:
            rear += force
            moment -= half * force
    limit_front, limit_rear = model.friction * load_front + 1e-9, model.friction * load_rear + 1e-9
    left_front = math.sqrt(max(0.01, 1 - (front / limit_front) ** 2))
    left_rear = math.sqrt(max(0.01, 1 - (rear / limit_rear) ** 2))
    return Commanded(
        cos_steer,
        sin_steer,
        front,
        rear,
        moment * model.brake_moment,
        model.stiffness_front / limit_front,
        model.stiffness_rear / limit_rear,
        limit_front * left_front,
        limit_rear * left_rear,
        1 / model.mass,
        1 / model.yaw_inertia,
    )


@compiled
def _lateral(theta, peak):
    """Lateral force of an axle: the Fiala polynomial of theta = stiffness tan(alpha)/limit; free of branches [N]."""
    t = min(abs(theta), KNOT)
    return math.copysign(peak * t * (1 - t * (0.0668 + 0.1032 * t)), theta)


@compiled
def accelerations(model, c, vx, vy, yaw_rate):
    """Specific forces ax, ay [m/s2] and yaw acceleration [rad/s2] of the single track."""
    speed = max(vx, SLOWEST)
    vy_front = vy + model.lf * yaw_rate
    rolling = max(speed * c.cos_steer + vy_front * c.sin_steer, SLOWEST)
    side_front = _lateral(c.slope_front * (speed * c.sin_steer - vy_front * c.cos_steer) / rolling, c.peak_front)
    side_rear = _lateral(c.slope_rear * (model.lr * yaw_rate - vy) / speed, c.peak_rear)
    across_front = side_front * c.cos_steer + c.front * c.sin_steer
    ax = (c.front * c.cos_steer - side_front * c.sin_steer + c.rear) * c.per_mass
    ay = (across_front + side_rear) * c.per_mass
    return ax, ay, (model.lf * across_front - model.lr * side_rear + c.moment) * c.per_inertia


@advance.register(SingleTrack)
@compiled
def _(model, states, u):
    # Heun's method: Euler's damping error at 10 ms would be as large as the tyre's uncertainty.
    c = commanded(model, u)
    h = model.dt
    out = np.empty_like(states)
    for j in range(states.shape[1]):
        vx, vy, r = states[0, j], states[1, j], states[2, j]
        ax, ay, dr = accelerations(model, c, vx, vy, r)
        dvx, dvy = ax + vy * r, ay - vx * r
        wx, wy, q = vx + h * dvx, vy + h * dvy, r + h * dr
        ax, ay, dq = accelerations(model, c, wx, wy, q)
        out[0, j] = vx + 0.5 * h * (dvx + ax + wy * q)
        out[1, j] = vy + 0.5 * h * (dvy + ay - wx * q)
        out[2, j] = r + 0.5 * h * (dr + dq)
    return out


@compiled
def read_column(model, c, states, out, j):
    """Fill column j of ``out`` with what the production car's sensors read of that column of states."""
    vx, vy, r = states[0, j], states[1, j], states[2, j]
    out[Y_AX, j], out[Y_AY, j], _ = accelerations(model, c, vx, vy, r)
    read_motion(model, c.cos_steer, c.sin_steer, vx, vy, r, out, j)


@observe.register(SingleTrack)
@compiled
def _(model, states, u):
    c = commanded(model, u)
    out = np.empty((10, states.shape[1]))
    for j in range(states.shape[1]):
        read_column(model, c, states, out, j)
    read_extras(model.variances, states, out)
    return out


@heed.register(SingleTrack)
@compiled
def _(model, u, y):
    # A torque says how hard a wheel is braked, not how hard the road lets it: where the wheels are near locking, force
    # from torque is wrong by several times, and the speed with it. What the accelerometer misses is taken off.
    total, braking = 0.0, 0.0
    for i in range(4):
        total += (u[U_DRIVE + i] - u[U_BRAKE + i]) / model.wheel_radius
        braking = max(braking, u[U_BRAKE + i])
    felt = model.mass * (y[Y_AX] - model.brake_margin)
    if braking <= BRAKING or total >= 0.0 or not felt > total:
        return u
    out = u.copy()
    for i in range(4):
        out[U_BRAKE + i] *= max(0.0, felt / total)
    return out


attend.register(SingleTrack)(attend_wheels)


@report.register(SingleTrack)
@compiled
def _(model, state, u):
    ax, ay, _ = accelerations(model, commanded(model, u), state[0], state[1], state[2])
    return np.array([state[0], state[1], state[2], ax, ay])
