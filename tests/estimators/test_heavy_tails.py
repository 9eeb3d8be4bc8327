"""Filters that expect heavy tails: in the channels that they are told of, and in no others."""

import numpy as np
import pytest
from scipy import stats

from vse_gym.catalogue import ESTIMATORS
from vse_gym.inference.particle import log_likelihood
from vse_gym.models import Nominal
from vse_gym.noise import contamination
from vse_gym.sensors import LOUD
from vse_gym.types import CHANNELS, Y_AY, Y_WHEEL, Y_YAW_RATE, Reading
from vse_gym.vehicles import load

NAMES = ["ekf_cauchy_gaussian", "pf_cauchy_gaussian"]
every_one = pytest.mark.parametrize("name", NAMES)


@every_one
def test_a_channel_that_does_not_exist_is_refused(name):
    with pytest.raises(ValueError, match=r"heavy names no such channel: \['az'\]; known: ax, ay"):
        ESTIMATORS.make(name, heavy=("ay", "az"))


@every_one
@pytest.mark.parametrize("alpha", [0.9, 2.1])
def test_an_alpha_outside_one_to_two_is_refused(name, alpha):
    with pytest.raises(ValueError, match="alpha"):
        ESTIMATORS.make(name, alpha=alpha)


def moved(name, channel, by, **settings):
    """How far the estimate of (vx, vy, yaw rate) moves when one channel of a straight drive's reading does."""
    nominal = Nominal(load("qin2014_understeer"), LOUD, 20.0)
    estimator, ends = ESTIMATORS.make(name, **settings), []
    for shift in (0.0, by):
        y = np.array([0.0, 0.0, 0.0, *4 * [20.0 / nominal.vehicle.wheel_radius], *3 * [np.nan]])
        state = estimator.init(nominal, np.random.default_rng(0))
        y[channel] += shift
        state = estimator.update(state, Reading(0.0, np.zeros(9), y), np.random.default_rng(0))
        ends.append(np.array(estimator.estimate(state)[:3]))
    return np.abs(ends[1] - ends[0])


def test_an_outlier_of_a_heavy_channel_hardly_moves_the_filter_and_one_of_another_does():
    gyro = {name: moved(name, Y_YAW_RATE, 3.0)[2] for name in ("ekf", "ekf_cauchy_gaussian")}
    assert gyro["ekf_cauchy_gaussian"] < 0.02 < 1 < gyro["ekf"]
    wheel = [moved(name, Y_WHEEL, 10.0)[0] for name in ("ekf", "ekf_cauchy_gaussian")]
    np.testing.assert_allclose(wheel[1], wheel[0], rtol=0.05)  # but for what ax, whose tails are heavy, says of it


def test_with_an_alpha_of_two_it_is_the_extended_filter():
    # Joseph's form or not: rounding.
    for channel in (Y_AY, Y_YAW_RATE, Y_WHEEL):
        np.testing.assert_allclose(
            moved("ekf_cauchy_gaussian", channel, 0.3, alpha=2.0), moved("ekf", channel, 0.3), rtol=1e-9, atol=1e-12
        )


def test_the_particles_likelihood_takes_each_channel_by_its_own_law():
    share = contamination(1.5)
    shares = np.array([share * (name in ("ax", "ay")) for name in CHANNELS])
    z = np.random.default_rng(0).normal(0, 3, (10, 5))
    parts = [
        (1 - s) * stats.norm.pdf(row) + s * stats.cauchy.pdf(row, scale=np.sqrt(0.5))
        for s, row in zip(shares, z, strict=True)
    ]
    found = log_likelihood(z, np.zeros(10), np.ones(10), shares)
    wanted = np.log(parts).sum(axis=0) + 5 * np.log(2 * np.pi)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
