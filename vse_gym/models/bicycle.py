"""The linear bicycle: two axles, tyres in proportion to their slip angles, a speed that is known."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.linear import matrices, report_linear
from vse_gym.inference.model import attend, heed
from vse_gym.models.channels import BRAKING
from vse_gym.models.nominal import Nominal
from vse_gym.models.single_track import SLOWEST, SingleTrack, SingleTrackTuning, commanded
from vse_gym.models.tuning import Settings, tunable
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import CHANNELS, U_BRAKE, U_DRIVE, U_STEER, Y_AX, Y_AY, Y_SIDESLIP, Y_WHEEL, Y_YAW_RATE, Array


class LinearBicycle(NamedTuple):
    """State: vy [m/s], yaw rate [rad/s]. Hears ay, the yaw rate and, if on board, the optical sideslip.

    The speed that schedules its matrices is what the wheels say; it is remembered, not estimated.
    """

    car: SingleTrack  # the same car with tyres that saturate: its constants, and forces from torques
    prior_mean: Array  # (2,)
    prior_cov: Array  # (2, 2)
    process_cov: Array  # (2, 2), of one step
    variances: Array  # of the channels; NaN: not used; (10,)
    memory: Array  # time since each wheel braked (4) [s], and speed [m/s]; (5,)


@dataclass(frozen=True)
class LinearBicycleTuning(Settings):
    """How far the Kalman filter trusts the linear bicycle; defaults as of :class:`SingleTrackTuning`, not searched."""

    vy_noise: float = tunable(0.8, 0.03, 5.0)  # process noise density [m/s per sqrt(s)]
    yaw_noise: float = tunable(0.8, 0.01, 2.0)  # [rad/s per sqrt(s)]
    ay_error: float = tunable(6.0, 0.3, 8.0)  # error of the model's ay, added to the sensor's noise [m/s2]
    brake_hold: float = 0.1  # time for which a wheel is no speedometer after it braked [s]
    brake_margin: float = 0.3  # by so much may the accelerometer miss how fast the car slows down [m/s2]
    vy_prior: float = 0.2  # standard deviation at the start [m/s]
    yaw_prior: float = 0.02  # [rad/s]
    brake_moment: bool = True  # whether the model knows that braking one side turns the car

    def build(self, nominal: Nominal) -> LinearBicycle:
        """The model of a nominal car with this trust."""
        like = SingleTrackTuning(
            vy_noise=self.vy_noise,
            yaw_noise=self.yaw_noise,
            ay_error=self.ay_error,
            brake_hold=self.brake_hold,
            brake_margin=self.brake_margin,
            vy_prior=self.vy_prior,
            yaw_prior=self.yaw_prior,
            brake_moment=self.brake_moment,
        )
        car = like.build(nominal)
        channels = np.full(len(CHANNELS), np.nan)
        for i in (Y_AY, Y_YAW_RATE, Y_SIDESLIP):
            channels[i] = car.variances[i]
        return LinearBicycle(
            car=car,
            prior_mean=car.prior_mean[1:].copy(),
            prior_cov=car.prior_cov[1:, 1:].copy(),
            process_cov=car.process_cov[1:, 1:].copy(),
            variances=channels,
            memory=car.memory,
        )


@compiled
def held_gain(a, h):
    """The integral of exp(A t) over 0 <= t <= h for A (2, 2): what inputs held for h do to the state.

    By its power series, to rounding; exp(A h) is I + A times this. A car's A h is below 2 in size, where the terms
    fall without having grown much before.
    """
    out, term = np.zeros((2, 2)), np.zeros((2, 2))
    term[0, 0] = term[1, 1] = h
    k = 1.0
    while True:
        size = 0.0
        for i in range(2):
            for j in range(2):
                out[i, j] += term[i, j]
                size = max(size, abs(term[i, j]))
        if not size > 1e-17 * h or k > 60:
            return out
        k += 1.0
        for i in range(2):
            x, y = term[i, 0], term[i, 1]
            term[i, 0] = (x * a[0, 0] + y * a[1, 0]) * h / k
            term[i, 1] = (x * a[0, 1] + y * a[1, 1]) * h / k


@matrices.register(LinearBicycle)
@compiled
def _(model, memory, u):
    # Exact for inputs and speed that are held over the step.
    car = model.car
    v = max(memory[4], SLOWEST)
    cf, cr = car.stiffness_front, car.stiffness_rear
    side = -(cf + cr) / (car.mass * v)
    turn = (car.lr * cr - car.lf * cf) / v
    a = np.empty((2, 2))
    a[0, 0], a[0, 1] = side, turn / car.mass - v
    a[1, 0], a[1, 1] = turn / car.yaw_inertia, -(car.lf * car.lf * cf + car.lr * car.lr * cr) / (car.yaw_inertia * v)
    push = cf * u[U_STEER] / car.mass
    twist = (car.lf * cf * u[U_STEER] + commanded(car, u).moment) / car.yaw_inertia
    held = held_gain(a, car.dt)
    F, g = np.empty((2, 2)), np.empty(2)
    for i in range(2):
        for j in range(2):
            F[i, j] = a[i, 0] * held[0, j] + a[i, 1] * held[1, j]
        F[i, i] += 1.0
        g[i] = held[i, 0] * push + held[i, 1] * twist
    H, d = np.zeros((10, 2)), np.zeros(10)
    H[Y_AY, 0], H[Y_AY, 1], d[Y_AY] = side, turn / car.mass, push
    H[Y_YAW_RATE, 1] = 1.0
    H[Y_SIDESLIP, 0] = 1 / v
    return F, g, H, d


@heed.register(LinearBicycle)
@compiled
def _(model, u, y):
    return heed(model.car, u, y)


@attend.register(LinearBicycle)
@compiled
def _(model, memory, u, y):
    # The speed is the mean of the wheels that roll freely, else of the driven ones. While all brake it is the fastest
    # one's, but falls no faster than the accelerometer says: a locking wheel is no speedometer. While none is heard it
    # stays.
    car = model.car
    variances, after = np.empty(10), np.empty(5)
    for i in range(10):
        variances[i] = np.nan if math.isnan(y[i]) else model.variances[i]
    r = 0.0 if math.isnan(y[Y_YAW_RATE]) else y[Y_YAW_RATE]
    cos_steer, sin_steer = math.cos(u[U_STEER]), math.sin(u[U_STEER])
    total, rolling, fastest, free, free_total = 0.0, 0, -1.0, 0, 0.0
    for i in range(4):
        after[i] = 0.0 if u[U_BRAKE + i] > BRAKING else memory[i] + car.dt
        if math.isnan(y[Y_WHEEL + i]):
            continue
        speed = car.wheel_radius * y[Y_WHEEL + i]
        if i < 2:
            speed = (speed - car.lf * r * sin_steer) / cos_steer
        half = 0.5 * (car.track_front if i < 2 else car.track_rear)
        speed += half * r if i % 2 == 0 else -half * r
        fastest = max(fastest, speed)
        if after[i] >= car.brake_hold:
            total += speed
            rolling += 1
            if abs(u[U_DRIVE + i]) <= BRAKING:
                free += 1
                free_total += speed
    after[4] = memory[4]
    if free > 0:
        after[4] = free_total / free
    elif rolling > 0:
        after[4] = total / rolling
    elif fastest >= 0.0:
        felt = -car.friction * GRAVITY if math.isnan(y[Y_AX]) else min(0.0, y[Y_AX])
        after[4] = max(memory[4] + car.dt * (felt - car.brake_margin), fastest)
    return variances, after


@report_linear.register(LinearBicycle)
@compiled
def _(model, mean, memory, expected):
    return np.array([memory[4], mean[0], mean[1], np.nan, expected[Y_AY]])
