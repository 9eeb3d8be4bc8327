"""The particle filter: fair resampling, the likelihood that it says, and Kalman's answer on a linear model."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import quad
from scipy.stats import cauchy, kstest, norm
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import StateVectors
from stonesoup.types.state import ParticleState

from vse_gym.inference.particle import (
    bootstrap_step,
    cauchy_gaussian_density,
    diffuse,
    draw,
    log_likelihood,
    systematic,
)
from vse_gym.sensors import cauchy_gaussian, contamination

UNIT = st.floats(0.0, 1.0, exclude_max=True)
SHARES = st.floats(0.0, 1.0)
READINGS = arrays(float, 3, elements=st.floats(-30.0, 30.0))


def mixture(z, share):
    """Density of z sigmas of the core, from scipy's parts: both have the same scale, the core's sigma over sqrt 2."""
    return (1 - share) * norm.pdf(z) + share * cauchy.pdf(z, scale=np.sqrt(0.5))


# -- resampling -------------------------------------------------------------------------------------------------------


@given(arrays(float, 20, elements=st.floats(0.0, 1.0)).filter(lambda w: w.sum() > 1e-6), UNIT)
def test_systematic_resampling_gives_each_particle_its_share(weights, u):
    weights = weights / weights.sum()
    copies = np.bincount(systematic(weights, u), minlength=20)
    assert copies.sum() == 20
    assert np.all(np.abs(copies - 20 * weights) < 1 + 1e-9)


@given(arrays(float, 20, elements=st.floats(0.01, 1.0)), UNIT, st.floats(-1e-9, 1e-9))
def test_systematic_resampling_bears_weights_that_do_not_quite_sum_to_one(weights, u, surplus):
    weights = (1 + surplus) * weights / weights.sum()
    copies = np.bincount(systematic(weights, u), minlength=20)  # raises if an index is out of range
    assert copies.sum() == 20
    assert np.all(np.abs(copies - 20 * weights) < 1 + 1e-6)


@pytest.mark.parametrize("u", [0.0, 0.5, 0.999])
def test_equal_weights_keep_every_particle_once(u):
    np.testing.assert_array_equal(systematic(np.full(8, 0.125), u), np.arange(8))


@given(st.integers(1, 18), UNIT)
def test_a_particle_without_weight_is_not_copied(k, u):
    weights = np.full(20, 1 / 19)
    weights[k] = 0.0
    assert k not in systematic(weights, u)


@pytest.mark.parametrize("seed", range(20))
def test_systematic_resampling_is_stone_soups(seed, monkeypatch):
    # Which goes through the particles in the order of their weights.
    rng = np.random.default_rng(seed)
    weights, u = np.sort(rng.dirichlet(np.full(50, 0.2))), rng.random()
    particles = ParticleState(StateVectors(np.arange(50)[None]), weight=weights)
    monkeypatch.setattr(np.random, "uniform", lambda low, high: low + u * (high - low))
    theirs = SystematicResampler().resample(particles).state_vector[0]
    np.testing.assert_array_equal(systematic(weights, u), np.asarray(theirs, dtype=int))


def test_resampling_is_unbiased():
    # Each particle's expected number of copies is N w: here by integrating over u exactly, as copies are piecewise
    # constant; 1000 midpoints leave an error of at most one step of each of its two edges.
    weights = np.random.default_rng(1).dirichlet(np.ones(10))
    grid = (np.arange(1000) + 0.5) / 1000
    copies = np.mean([np.bincount(systematic(weights, u), minlength=10) for u in grid], axis=0)
    np.testing.assert_allclose(copies, 10 * weights, atol=2e-3)


# -- drawing ----------------------------------------------------------------------------------------------------------


def test_draws_have_the_mean_and_the_covariance_asked_for():
    mean, cov, size = np.array([1.0, -2.0, 3.0]), np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]]), 100_000
    states = draw(mean, cov, size, np.random.default_rng(1))
    # Five standard deviations of a sample mean and of a sample covariance.
    assert np.all(np.abs(states.mean(axis=1) - mean) < 5 * np.sqrt(cov.diagonal() / size))
    spread = np.sqrt((cov**2 + np.outer(cov.diagonal(), cov.diagonal())) / size)
    assert np.all(np.abs(np.cov(states) - cov) < 5 * spread)


def test_draws_come_from_the_generator_that_is_handed_in():
    rng, again = np.random.default_rng(7), np.random.default_rng(7)
    first = draw(np.zeros(2), np.eye(2), 5, rng)
    np.testing.assert_array_equal(first, draw(np.zeros(2), np.eye(2), 5, again))
    assert rng.random() == again.random()
    assert not np.array_equal(first, draw(np.zeros(2), np.eye(2), 5, rng))


def test_no_noise_moves_no_state():
    states = np.arange(6.0).reshape(2, 3)
    diffuse(states, np.zeros((2, 2)), np.random.default_rng(1))
    np.testing.assert_allclose(
        states, np.arange(6.0).reshape(2, 3), rtol=0, atol=1e-100
    )  # pivots are kept above 1e-300


# -- likelihood -------------------------------------------------------------------------------------------------------


@given(st.floats(-50.0, 50.0), SHARES)
def test_the_density_is_the_mixture_of_a_gaussian_and_a_cauchy(z, share):
    assert cauchy_gaussian_density(z, share) == pytest.approx(np.sqrt(2 * np.pi) * mixture(z, share), rel=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_the_density_integrates_to_one(share):
    total = 2 * quad(cauchy_gaussian_density, 0, np.inf, args=(share,))[0] / np.sqrt(2 * np.pi)
    assert total == pytest.approx(1.0, abs=1e-7)  # quad's own error bound is 1.5e-8


def test_the_filter_believes_in_the_noise_that_the_sensors_make():
    # The sensors scale by gamma, the filter by the core's sigma: a factor of sqrt 2 that is easily lost.
    alpha = 1.3
    share = contamination(alpha)
    z = cauchy_gaussian(alpha, np.sqrt(0.5), (20_000,), np.random.default_rng(1))
    believed = kstest(z, lambda x: (1 - share) * norm.cdf(x) + share * cauchy.cdf(x, scale=np.sqrt(0.5)))
    assert believed.pvalue > 0.01


@given(
    READINGS, arrays(float, (3, 4), elements=st.floats(-30.0, 30.0)), arrays(float, 3, elements=st.floats(0.1, 10.0))
)
def test_the_gaussian_likelihood_is_scipys_up_to_a_constant(y, expected, variances):
    logs = log_likelihood(expected, y, variances, 0.0)
    theirs = norm.logpdf(y[:, None], expected, np.sqrt(variances)[:, None]).sum(axis=0)
    np.testing.assert_allclose(logs - logs[0], theirs - theirs[0], rtol=1e-9, atol=1e-9)


@given(
    READINGS,
    arrays(float, (3, 4), elements=st.floats(-30.0, 30.0)),
    arrays(float, 3, elements=st.floats(0.1, 10.0)),
    st.floats(0.001, 1.0),
)
def test_the_heavy_tailed_likelihood_is_scipys_up_to_a_constant(y, expected, variances, share):
    logs = log_likelihood(expected, y, variances, share)
    theirs = np.log(mixture((y[:, None] - expected) / np.sqrt(variances)[:, None], share)).sum(axis=0)
    np.testing.assert_allclose(logs - logs[0], theirs - theirs[0], rtol=1e-9, atol=1e-9)


@given(arrays(float, 3, elements=st.floats(-4.0, 4.0)))
def test_a_share_of_zero_is_the_limit_of_small_shares(y):
    # Within 4 sigma the Gaussian is at least exp(-8) = 3e-4, so a share of 1e-12 moves its logarithm by 1e-8 at most.
    expected, variances = np.zeros((3, 1)), np.ones(3)
    limit = log_likelihood(expected, y, variances, 1e-12)
    np.testing.assert_allclose(log_likelihood(expected, y, variances, 0.0), limit, rtol=0, atol=1e-7)


@pytest.mark.parametrize("share", [0.0, 0.3])
@given(y=READINGS, silent=st.sets(st.integers(0, 2)))
def test_a_silent_channel_adds_nothing(share, y, silent):
    expected, variances = np.random.default_rng(1).normal(size=(3, 4)), np.array([0.5, 1.0, 2.0])
    heard = [i for i in range(3) if i not in silent]
    quiet_y, quiet_variances = y.copy(), variances.copy()
    quiet_y[list(silent)] = np.nan
    quiet_variances[list(silent)] = np.nan
    fewer = log_likelihood(np.ascontiguousarray(expected[heard]), y[heard], variances[heard], share)
    np.testing.assert_array_equal(log_likelihood(expected, quiet_y, quiet_variances, share), fewer)


@given(st.floats(1e3, 1e150), st.sampled_from([0.0, 0.3]))
def test_the_likelihood_of_what_cannot_be_is_still_a_number(far, share):
    logs = log_likelihood(np.array([[0.0, 1.0]]), np.array([far]), np.ones(1), share)
    assert np.all(np.isfinite(logs))


# -- the filter -------------------------------------------------------------------------------------------------------


def test_on_a_linear_model_it_agrees_with_the_kalman_filter(linear, linear_drive):
    size, rng = 100_000, np.random.default_rng(1)
    states, weights = draw(linear.prior_mean, linear.prior_cov, size, rng), np.full(size, 1 / size)
    memory, means, covs, sizes = linear.memory, [], [], []
    for u, y in zip(linear_drive.inputs, linear_drive.readings, strict=True):
        states, weights, memory, cov, output = bootstrap_step(linear, states, weights, memory, u, y, 0.0, 0.5, rng)
        means.append(output[:2])
        covs.append(cov)
        sizes.append(output[5])
    # N independent draws from the posterior have a mean with variance P/N and a covariance with variance
    # (P_ii P_jj + P_ij^2)/N. Weighted ones count as many as the effective size, the smallest of the last ten steps:
    # after that the model has forgotten (0.93^20 of a variance is 0.2). Bound: five standard deviations.
    lowest = np.array([min(sizes[max(0, k - 9) : k + 1]) for k in range(len(sizes))])
    assert lowest.min() > 100  # else the bound says nothing
    variance = np.diagonal(linear_drive.covs, axis1=1, axis2=2)
    assert np.all(np.abs(means - linear_drive.means) < 5 * np.sqrt(variance / lowest[:, None]))
    spread = np.sqrt(linear_drive.covs**2 + variance[:, :, None] * variance[:, None, :])
    assert np.all(np.abs(covs - linear_drive.covs) < 5 * spread / np.sqrt(lowest)[:, None, None])


def test_with_all_channels_silent_the_weights_stay(linear):
    rng = np.random.default_rng(1)
    states, weights = draw(linear.prior_mean, linear.prior_cov, 50, rng), rng.dirichlet(np.full(50, 20.0))
    _, after, _, _, output = bootstrap_step(
        linear, states, weights, linear.memory, np.zeros(1), np.full(3, np.nan), 0.0, 0.5, rng
    )
    np.testing.assert_allclose(after, weights, rtol=1e-12)  # divided by a sum of one, to rounding
    assert output[5] == pytest.approx(1 / np.sum(weights**2), rel=1e-12)


@pytest.mark.parametrize(("resample_below", "resampled"), [(0.0, False), (1.1, True)])
def test_it_resamples_when_the_effective_size_is_too_small(linear, resample_below, resampled):
    rng = np.random.default_rng(1)
    states, weights = draw(linear.prior_mean, linear.prior_cov, 50, rng), np.full(50, 0.02)
    _, after, _, _, output = bootstrap_step(
        linear, states, weights, linear.memory, np.zeros(1), np.array([1.0, -1.0, 2.0]), 0.0, resample_below, rng
    )
    assert np.all(after == 0.02) == resampled
    assert 1 <= output[5] < 50


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_particle_without_weight_beside_the_reading_does_no_harm(linear, share):
    # Its likelihood outweighs those of all others by more than a float can say, but nothing times anything is nothing.
    still = linear._replace(process_cov=1e-20 * np.eye(2))
    states = np.array([[0.0, 0.1, 1000.0], [0.0, 0.1, 0.0]])
    weights = np.array([0.5, 0.5, 0.0])
    y = np.array([950.0, -200.0, 1150.0])
    states, weights, _, cov, output = bootstrap_step(
        still, states, weights, still.memory, np.zeros(1), y, share, 0.5, np.random.default_rng(1)
    )
    assert np.all(np.isfinite(states))
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(np.isfinite(cov))
    assert np.all(np.isfinite(output[:2]))


def test_a_single_particle_with_all_the_weight_still_doubts(linear):
    # Its sample covariance is zero, and to rounding even indefinite.
    rng = np.random.default_rng(1)
    states, weights = draw(linear.prior_mean, linear.prior_cov, 50, rng), np.zeros(50)
    weights[7] = 1.0
    _, _, _, cov, output = bootstrap_step(
        linear, states, weights, linear.memory, np.zeros(1), np.full(3, np.nan), 0.0, 0.5, rng
    )
    assert output[5] == 1
    np.testing.assert_allclose(cov, linear.process_cov, atol=1e-12)
