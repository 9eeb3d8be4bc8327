"""The ensemble Kalman filter: Kalman's filter as the ensemble grows."""

import numpy as np
import pytest

from vse_gym.compiled import hold
from vse_gym.inference.ensemble import ensemble_step
from vse_gym.inference.particle import draw


def drive(linear, linear_drive, size, seed, inflation=1.0):
    """Means (T, 2), covariances (T, 2, 2), NIS and its degrees of freedom over the linear drive."""
    rng = np.random.default_rng(seed)
    states, memory, held = draw(linear.prior_mean, linear.prior_cov, size, rng), linear.memory, hold(linear)
    means, covs, nis = [], [], []
    for u, y in zip(linear_drive.inputs, linear_drive.readings, strict=True):
        states, memory, cov, output = ensemble_step(held, states, memory, u, y, inflation, rng)
        means.append(states.mean(axis=1))
        covs.append(cov)
        nis.append(output[5:])
    return np.array(means), np.array(covs), np.array(nis)


def test_it_tends_to_the_kalman_filter_as_one_over_the_root_of_its_size(linear, linear_drive):
    sizes, seeds = np.array([50, 200, 800, 3200]), range(12)
    spread = np.sqrt(np.trace(linear_drive.covs, axis1=1, axis2=2))[:, None]
    errors = []
    for size in sizes:
        squares = [((drive(linear, linear_drive, size, seed)[0] - linear_drive.means) / spread) ** 2 for seed in seeds]
        errors.append(np.sqrt(np.mean(squares)))
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    # 12 drives of some 20 independent stretches each: each error is known to 5 %, the slope to 0.02.
    assert slope == pytest.approx(-0.5, abs=0.06)
    assert errors[-1] < 0.05  # of a standard deviation


def test_its_covariance_tends_to_kalmans(linear, linear_drive):
    _, covs, _ = drive(linear, linear_drive, 20_000, seed=1)
    np.testing.assert_allclose(covs, linear_drive.covs, atol=0.05)  # variances of 0.1 to 2, to 1 % or so


def test_the_covariance_is_that_of_its_members(linear):
    rng = np.random.default_rng(1)
    states = draw(linear.prior_mean, linear.prior_cov, 10, rng)
    before = states.copy()
    after, _, cov, output = ensemble_step(hold(linear), states, linear.memory, np.zeros(1), np.ones(3), 1.0, rng)
    np.testing.assert_allclose(cov, np.cov(after), rtol=1e-12)
    np.testing.assert_allclose(output[:2], after.mean(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(states, before)


def test_inflation_widens_the_prediction_by_its_square(linear):
    silent = np.full(3, np.nan)
    covs = []
    for inflation in (1.0, 1.3):
        rng = np.random.default_rng(1)
        states = draw(linear.prior_mean, linear.prior_cov, 100, rng)
        _, _, cov, output = ensemble_step(hold(linear), states, linear.memory, np.zeros(1), silent, inflation, rng)
        assert tuple(output[5:]) == (0.0, 0.0)
        covs.append(cov)
    np.testing.assert_allclose(covs[1], 1.3**2 * covs[0], rtol=1e-12)


def test_innovations_fit_their_covariance(linear, linear_drive):
    _, _, nis = drive(linear, linear_drive, 2000, seed=1)
    heard = np.isfinite(linear_drive.readings).sum(axis=1)
    np.testing.assert_array_equal(nis[:, 1], heard)
    # Chi-square of 200 to 250 degrees of freedom: a standard deviation of 9 %.
    assert nis[:, 0].sum() / heard.sum() == pytest.approx(1.0, abs=0.3)
