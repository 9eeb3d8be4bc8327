"""The heavy-tailed rule: Kalman's where noise is Gaussian, Bayes' mean and variance of a channel where it is not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from vse_gym.inference.gaussian import HeavyTailed, cauchy_rungs, correct, filter_drive
from vse_gym.inference.gaussian.heavy_tailed import score

WEIGHTS, VARIANCES = cauchy_rungs()


def mixture(share, channels=1):
    """The rule of a Cauchy share whose scale is the core's sigma over sqrt 2, alike for every channel."""
    parts = np.concatenate(([1 - share], share * WEIGHTS))
    return HeavyTailed(np.tile(parts, (channels, 1)), np.concatenate(([1.0], 0.5 * VARIANCES)))


def test_the_rungs_are_nearly_the_cauchy_law():
    assert WEIGHTS.sum() == pytest.approx(1, rel=1e-12) and WEIGHTS.min() > 0
    z = np.concatenate(([0.0], np.logspace(-2, 3, 200)))
    density = stats.norm.pdf(z[:, None], scale=np.sqrt(VARIANCES)) @ WEIGHTS
    np.testing.assert_allclose(density, stats.cauchy.pdf(z), rtol=0.04)


def test_without_a_cauchy_share_it_is_kalman_s_filter(linear, linear_drive):
    prior = linear.prior_mean, linear.prior_cov, linear.memory
    means, covs = filter_drive(mixture(0.0, 3), linear, *prior, linear_drive.inputs, linear_drive.readings)
    # Central differences of a line err by rounding alone.
    np.testing.assert_allclose(means, linear_drive.means, atol=1e-8)
    np.testing.assert_allclose(covs, linear_drive.covs, atol=1e-8)


def exact(innovation, believed, share):
    """Mean and variance of the state's error given the reading, by summing over a fine grid; noise of core sigma 1."""
    x = np.sqrt(believed) * np.linspace(-8, 8, 4001)
    v = innovation - x
    noise = (1 - share) * stats.norm.pdf(v) + share * stats.cauchy.pdf(v, scale=np.sqrt(0.5))
    weight = stats.norm.pdf(x, scale=np.sqrt(believed)) * noise
    weight /= weight.sum()
    mean = weight @ x
    return mean, weight @ (x - mean) ** 2


@given(st.floats(-30, 30), st.floats(0.05, 5.0), st.floats(0.02, 1.0))
def test_one_channel_s_mean_and_variance_are_bayes(innovation, believed, share):
    rule = mixture(share)
    g, curvature = score(innovation, believed, 1.0, rule.weights[0], rule.scales)
    mean, variance = exact(innovation, believed, share)
    # Relative to the prior: the rungs' 4 % of density move either by less than 3 % of it.
    assert believed * g * innovation == pytest.approx(mean, abs=0.03 * np.sqrt(believed))
    assert believed - believed**2 * curvature == pytest.approx(variance, abs=0.03 * believed)
    assert believed - believed**2 * curvature > 0


@pytest.mark.parametrize("far", [1e3, 1e5, 1e8, 1e150])
def test_a_reading_far_away_is_as_good_as_none(linear, far):
    u, y = np.zeros(1), np.array([far, 0.0, 0.0])
    silent = np.array([linear.R[0], np.nan, np.nan])
    mean, cov, nis, dof = correct(mixture(0.1, 3), linear, linear.prior_mean, linear.prior_cov, u, y, silent)
    if far < 1e5:  # beyond its widest rung the law is Gaussian
        assert np.abs(mean - linear.prior_mean).max() < 0.02 and dof == 1
        np.testing.assert_allclose(cov, linear.prior_cov, rtol=0.02)
    assert np.isfinite(nis) and np.linalg.eigvalsh(cov).min() > 0


@pytest.mark.parametrize(("share", "believed"), [(0.05, 0.1), (0.3, 1.0), (1.0, 5.0)])
def test_the_mean_of_its_nis_is_one_as_a_gaussian_s_is(share, believed):
    rule = mixture(share)
    spread = np.sqrt(believed + rule.scales)
    # The innovation's law is the very mixture; integrated part by part, on each part's own scale.
    z = np.linspace(-9, 9, 721)
    density = stats.norm.pdf(z) * (z[1] - z[0])
    total = 0.0
    for weight, width in zip(rule.weights[0], spread, strict=True):
        square = [(width * x) ** 2 * score(width * x, believed, 1.0, rule.weights[0], rule.scales)[0] for x in z]
        total += weight * (density @ square)
    assert total == pytest.approx(1.0, abs=1e-3)
