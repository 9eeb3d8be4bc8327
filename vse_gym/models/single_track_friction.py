"""The single track that carries the friction of the road in its state."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models.channels import read_extras
from vse_gym.models.single_track import Commanded, SingleTrack, accelerations, commanded, read_column
from vse_gym.types import CHANNELS, Array

LOWEST, HIGHEST = 0.05, 1.2  # a friction outside is taken as the nearer of them [-]


class FrictionSingleTrack(NamedTuple):
    """The single track, each column on a road of its own. State: vx, vy [m/s], yaw rate [rad/s], friction [-].

    Friction is what tyres bear across. What they bear along goes by the friction that was told: torques are heeded by
    what the accelerometer feels of them, and a road that bears less than they promise could not be told from a mass
    that is greater than the nominal one.

    Friction walks at random, and what it departs from the friction that was told decays: on the straight no reading
    tells one friction from another, and the doubt would grow without end. The decay does at every instant what a
    pseudo-measurement of the told friction would do now and then: Ornstein, Uhlenbeck (1930).
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
def on_road(c, told, friction):
    """What the inputs determine on the told friction, for tyres that bear across what this friction lets them."""
    ratio = within(friction) / told
    return Commanded(
        c.cos_steer,
        c.sin_steer,
        c.front,
        c.rear,
        c.moment,
        c.slope_front / ratio,
        c.slope_rear / ratio,
        c.peak_front * ratio,
        c.peak_rear * ratio,
        c.per_mass,
        c.per_inertia,
    )


@advance.register(FrictionSingleTrack)
@compiled
def _(model, states, u):
    # Heun's method, as of the single track
    car, h, told = model.car, model.car.dt, model.car.friction
    c = commanded(car, u)
    out = np.empty_like(states)
    for j in range(states.shape[1]):
        vx, vy, r = states[0, j], states[1, j], states[2, j]
        road = on_road(c, told, states[3, j])
        ax, ay, dr = accelerations(car, road, vx, vy, r)
        dvx, dvy = ax + vy * r, ay - vx * r
        wx, wy, q = vx + h * dvx, vy + h * dvy, r + h * dr
        ax, ay, dq = accelerations(car, road, wx, wy, q)
        out[0, j] = vx + 0.5 * h * (dvx + ax + wy * q)
        out[1, j] = vy + 0.5 * h * (dvy + ay - wx * q)
        out[2, j] = r + 0.5 * h * (dr + dq)
        out[3, j] = within(told) + model.remaining * (within(states[3, j]) - within(told))
    return out


@observe.register(FrictionSingleTrack)
@compiled
def _(model, states, u):
    car = model.car
    c = commanded(car, u)
    out = np.empty((len(CHANNELS), states.shape[1]))
    for j in range(states.shape[1]):
        read_column(car, on_road(c, car.friction, states[3, j]), states, out, j)
    read_extras(model.variances, states, out)
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
    road = on_road(commanded(model.car, u), model.car.friction, state[3])
    ax, ay, _ = accelerations(model.car, road, state[0], state[1], state[2])
    return np.array([state[0], state[1], state[2], ax, ay])
