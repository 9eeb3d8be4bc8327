"""The single track that carries the friction of the road in its state."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models.single_track import SingleTrack
from vse_gym.types import CHANNELS, Array

LOWEST, HIGHEST = 0.05, 1.2  # a friction outside is taken as the nearer of them [-]


class FrictionSingleTrack(NamedTuple):
    """The single track of every column's own friction. State: vx, vy [m/s], yaw rate [rad/s], friction [-].

    Friction walks at random, and what it departs from the friction that was told decays: on the straight no reading
    tells one friction from another, and the doubt would grow without end. The decay does for every instant what a
    pseudo-measurement would do for some: Ornstein, Uhlenbeck (1930).
    """

    car: SingleTrack  # with the friction that was told
    remaining: float  # share of the departure that is left after one step [-]
    prior_mean: Array  # (4,)
    prior_cov: Array  # (4, 4)
    process_cov: Array  # (4, 4), of one step
    variances: Array  # as of the single track, (10,)
    memory: Array  # as of the single track, (5,)


def with_friction(car: SingleTrack, noise: float, prior: float, decay: float) -> FrictionSingleTrack:
    """A single track whose friction is to be found.

    Args:
        car: With the friction that it is thought to have.
        noise: Density of the friction's random walk [1/sqrt(s)].
        prior: Its standard deviation at the start [-].
        decay: Time after which a third of a departure is left [s].
    """
    cov, process = np.zeros((4, 4)), np.zeros((4, 4))
    cov[:3, :3], process[:3, :3] = car.prior_cov, car.process_cov
    cov[3, 3], process[3, 3] = prior**2, noise**2 * car.dt
    mean = np.append(car.prior_mean, within(car.friction))
    return FrictionSingleTrack(car, math.exp(-car.dt / decay), mean, cov, process, car.variances, car.memory)


@compiled
def within(friction):
    """The friction, or the bound that it is beyond."""
    return min(max(friction, LOWEST), HIGHEST)


@compiled
def on_road(model, friction):
    """The single track on a road of this friction."""
    car = model.car
    return SingleTrack(
        car.mass,
        car.yaw_inertia,
        car.lf,
        car.lr,
        car.height,
        car.track_front,
        car.track_rear,
        car.wheel_radius,
        car.stiffness_front,
        car.stiffness_rear,
        within(friction),
        car.brake_moment,
        car.slip,
        car.brake_slip,
        car.brake_hold,
        car.brake_margin,
        car.dt,
        car.prior_mean,
        car.prior_cov,
        car.process_cov,
        car.variances,
        car.memory,
    )


@compiled
def column_of(states, j, out):
    """Motion of column j, into ``out`` (3, 1)."""
    for i in range(3):
        out[i, 0] = states[i, j]


@advance.register(FrictionSingleTrack)
@compiled
def _(model, states, u):
    out, motion = np.empty_like(states), np.empty((3, 1))
    told = within(model.car.friction)
    for j in range(states.shape[1]):
        column_of(states, j, motion)
        car = on_road(model, states[3, j])
        moved = advance(car, motion, u)
        for i in range(3):
            out[i, j] = moved[i, 0]
        out[3, j] = told + model.remaining * (within(states[3, j]) - told)
    return out


@observe.register(FrictionSingleTrack)
@compiled
def _(model, states, u):
    out, motion = np.empty((len(CHANNELS), states.shape[1])), np.empty((3, 1))
    for j in range(states.shape[1]):
        column_of(states, j, motion)
        car = on_road(model, states[3, j])
        read = observe(car, motion, u)
        for i in range(read.shape[0]):
            out[i, j] = read[i, 0]
    return out


@heed.register(FrictionSingleTrack)
@compiled
def _(model, u, y):
    return heed(model.car, u, y)


@attend.register(FrictionSingleTrack)
@compiled
def _(model, memory, u, y):
    return attend(model.car, memory, u, y)


@report.register(FrictionSingleTrack)
@compiled
def _(model, state, u):
    car = on_road(model, state[3])
    return report(car, state[:3], u)
