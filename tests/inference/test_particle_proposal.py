"""Particle filters with proposals that look ahead: exact where the answer is known, and fair where tails are heavy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from vse_gym.compiled import hold
from vse_gym.inference.gaussian import Cubature, SageHusa, Unscented, untaught
from vse_gym.inference.particle import draw
from vse_gym.inference.particle_proposal import (
    correct_all,
    draw_all,
    log_transition,
    predict_all,
    proposal_step,
    reweigh,
    weighted_moments,
)

RULES = {"unscented": Unscented(), "cubature": Cubature(), "adaptive": SageHusa(Cubature())}
GAUSSIAN = np.zeros(3)


def begin(rule, model, size, rng, carried=1.0):
    factors = np.tile(carried * np.linalg.cholesky(model.prior_cov), (size, 1, 1))
    memory = np.concatenate((model.memory, untaught(rule, model.R.size, 50.0))) if isinstance(rule, SageHusa) else None
    states = draw(model.prior_mean, model.prior_cov, size, rng)
    return states, factors, np.full(size, 1 / size), model.memory if memory is None else memory


def filtered(rule, model, drive, size, carried=1.0, resample_below=0.5, seed=1):
    """Means, covariances and effective sizes after every reading of a drive."""
    rng, held = np.random.default_rng(seed), hold((rule, model))
    states, factors, weights, memory = begin(rule, model, size, rng, carried)
    means, covs, sizes = [], [], []
    for u, y in zip(drive.inputs, drive.readings, strict=True):
        states, factors, weights, memory, mean, cov, output = proposal_step(
            held, states, factors, weights, memory, u, y, GAUSSIAN, 1.0, carried, resample_below, rng
        )
        means.append(mean)
        covs.append(cov)
        sizes.append(output[5])
    return np.array(means), np.array(covs), np.array(sizes)


# -- the parts --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", [Unscented(), Cubature()], ids=["unscented", "cubature"])
def test_every_particle_s_filter_is_kalman_s(linear, rule):
    rng = np.random.default_rng(1)
    states, u, y = rng.normal(size=(2, 7)), np.array([0.3]), np.array([1.0, np.nan, -0.5])
    variances = np.where(np.isnan(y), np.nan, linear.R)
    roots = np.array([np.linalg.cholesky(scale * linear.prior_cov) for scale in np.linspace(0.1, 3, 7)])
    means, factors, centres = predict_all(rule, linear, states, roots, u)
    np.testing.assert_allclose(centres, linear.F @ states + linear.G @ u[:, None], rtol=1e-12)
    correct_all(rule, linear, means, factors, u, y, variances)
    H, R = linear.H[[0, 2]], np.diag(linear.R[[0, 2]])
    for j in range(7):
        P = linear.F @ roots[j] @ roots[j].T @ linear.F.T + linear.process_cov
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        m = centres[:, j] + K @ (y[[0, 2]] - H @ centres[:, j])
        np.testing.assert_allclose(means[:, j], m, rtol=0, atol=1e-12)
        np.testing.assert_allclose(factors[j] @ factors[j].T, P - K @ H @ P, rtol=0, atol=1e-12)


def test_densities_are_scipys_up_to_a_constant():
    rng = np.random.default_rng(1)
    means, roots = rng.normal(size=(3, 5)), np.tril(rng.normal(size=(5, 3, 3))) + 3 * np.eye(3)
    states, logs = draw_all(means, roots, 1.3, rng)
    theirs = [
        stats.multivariate_normal.logpdf(states[:, j], means[:, j], 1.69 * roots[j] @ roots[j].T) for j in range(5)
    ]
    np.testing.assert_allclose(logs - logs[0], np.array(theirs) - theirs[0], rtol=0, atol=1e-9)
    logs = log_transition(states, means, roots[0])
    theirs = stats.multivariate_normal.logpdf((states - means).T, np.zeros(3), roots[0] @ roots[0].T)
    np.testing.assert_allclose(logs - logs[0], theirs - theirs[0], rtol=0, atol=1e-9)


@given(
    arrays(float, 6, elements=st.floats(0.0, 1.0)).filter(lambda w: w.sum() > 0.1),
    arrays(float, 6, elements=st.floats(-900.0, 900.0) | st.just(np.nan) | st.just(-np.inf)),
)
def test_weights_always_sum_to_one(weights, logs):
    weights = weights / weights.sum()
    after, left = reweigh(weights, logs), (weights > 0) & np.isfinite(logs)
    expected = weights.copy()
    if left.any():
        expected[:] = 0.0
        expected[left] = weights[left] * np.exp(logs[left] - logs[left].max())
        expected /= expected.sum()
    np.testing.assert_allclose(after, expected, rtol=1e-12, atol=1e-300)


def test_moments_are_numpys(linear):
    rng = np.random.default_rng(1)
    values, weights = rng.normal(size=(3, 9)), rng.dirichlet(np.ones(9))
    weights[2] = 0.0
    values[:, 2] = np.nan
    weights /= weights.sum()
    mean, cov = weighted_moments(values, weights)
    heard = weights > 0
    np.testing.assert_allclose(mean, values[:, heard] @ weights[heard], rtol=0, atol=1e-14)
    np.testing.assert_allclose(cov, np.cov(values[:, heard], aweights=weights[heard], ddof=0), rtol=0, atol=1e-14)


# -- a perfect proposal -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", [Unscented(), Cubature()], ids=["unscented", "cubature"])
def test_the_optimal_proposal_s_weights_depend_on_the_old_particle_alone(linear, rule):
    # From a particle that is certain of where it is, on a linear Gaussian model, its filter's answer is
    # p(x | x_old, y) itself, and the weight p(y | x_old), whatever was drawn. Doucet, Godsill, Andrieu (2000).
    size, y, u = 40, np.array([1.0, -1.0, 2.0]), np.zeros(1)
    states = np.random.default_rng(1).normal(size=(2, size))
    start = np.zeros((size, 2, 2)), np.full(size, 1 / size), linear.memory
    after = [
        proposal_step(hold((rule, linear)), states, *start, u, y, GAUSSIAN, 1.0, 0.0, 0.0, np.random.default_rng(seed))[
            2
        ]
        for seed in (1, 2)
    ]
    np.testing.assert_allclose(after[0], after[1], rtol=1e-9)
    spread = linear.H @ linear.process_cov @ linear.H.T + np.diag(linear.R)
    theirs = stats.multivariate_normal.pdf((y[:, None] - linear.H @ linear.F @ states).T, np.zeros(3), spread)
    np.testing.assert_allclose(after[0], theirs / theirs.sum(), rtol=1e-9)


@pytest.mark.parametrize("rule", [Unscented(), Cubature()], ids=["unscented", "cubature"])
def test_particles_that_predict_alike_need_no_resampling(linear, linear_drive, rule):
    # A motion that forgets where it came from is one predictive state shared by all: every p(y | x_old) is the same.
    forgetful = linear._replace(F=np.zeros((2, 2)))
    _, _, sizes = filtered(rule, forgetful, linear_drive, 50, carried=0.0, resample_below=0.0)
    np.testing.assert_allclose(sizes, 50, rtol=1e-9)


# -- Kalman's answer --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("carried", [0.0, 1.0])
@pytest.mark.parametrize("rule", [Unscented(), Cubature()], ids=["unscented", "cubature"])
def test_on_a_linear_model_it_agrees_with_the_kalman_filter(linear, linear_drive, rule, carried):
    means, covs, sizes = filtered(rule, linear, linear_drive, 20_000, carried)
    # As for the bootstrap filter: N independent draws have a mean of variance P/N, weighted ones count as many as the
    # smallest effective size since the model has forgotten. Bound: five standard deviations.
    lowest = np.array([min(sizes[max(0, k - 9) : k + 1]) for k in range(len(sizes))])
    assert lowest.min() > 100
    variance = np.diagonal(linear_drive.covs, axis1=1, axis2=2)
    assert np.all(np.abs(means - linear_drive.means) < 5 * np.sqrt(variance / lowest[:, None]))
    spread = np.sqrt(linear_drive.covs**2 + variance[:, :, None] * variance[:, None, :])
    assert np.all(np.abs(covs - linear_drive.covs) < 5 * spread / np.sqrt(lowest)[:, None, None])


def test_an_adaptive_one_that_may_not_adapt_is_kalman_s_too(linear, linear_drive):
    rule = SageHusa(Cubature(), floor=1.0, cap=1.0)
    adaptive, _, _ = filtered(rule, linear, linear_drive, 500)
    plain, _, _ = filtered(Cubature(), linear, linear_drive, 500)
    np.testing.assert_array_equal(adaptive, plain)


@pytest.mark.parametrize("carried", [0.0, 1.0])
@pytest.mark.parametrize("name", RULES)
def test_in_silence_the_motion_proposes_and_no_weight_changes(linear, name, carried):
    # A random walk of which nothing is heard for 60 steps. A proposal as wide as a particle's own growing doubt would
    # let hardly any draw near where it started: the sample would shrink to a few and look sure.
    rule, size, steps, rng = RULES[name], 2000, 60, np.random.default_rng(1)
    walk = linear._replace(F=np.eye(2))
    held, quiet = hold((rule, walk)), np.full(3, np.nan)
    states, factors, _, memory = begin(rule, walk, size, rng, carried)
    start = weights = rng.dirichlet(np.full(size, 5.0))
    for _ in range(steps):
        states, factors, weights, memory, _, cov, output = proposal_step(
            held, states, factors, weights, memory, np.zeros(1), quiet, GAUSSIAN, np.sqrt(1.5), carried, 0.5, rng
        )
    np.testing.assert_allclose(weights, start, rtol=1e-9)
    exact = walk.prior_cov + steps * walk.process_cov
    # A sample's variance scatters by sqrt(2/effective size), a covariance by no more than that of the larger variance.
    assert np.abs(cov - exact).max() < 5 * np.sqrt(2 / output[5]) * exact.max()


# -- heavy tails ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reading", [1.0, 6.0])
@pytest.mark.parametrize("rule", [Unscented(), Cubature()], ids=["unscented", "cubature"])
def test_weights_make_up_for_the_gaussian_proposal_under_a_heavy_tailed_likelihood(linear, rule, reading):
    # One step in one dimension, whose posterior a fine grid gives. Twice too wide a proposal, starting from particles'
    # own doubts, changes how sure the answer is but not the answer.
    one = np.eye(1)
    model = linear._replace(
        F=one, G=np.zeros((1, 1)), H=np.ones((1, 1)), R=np.ones(1), prior_mean=np.zeros(1), prior_cov=one,
        process_cov=0.5 * one,
    )  # fmt: skip
    size, share = 200_000, 0.3
    rng = np.random.default_rng(1)
    states, factors = rng.normal(size=(1, size)), np.full((size, 1, 1), 0.7)
    _, _, _, _, mean, cov, output = proposal_step(
        hold((rule, model)), states, factors, np.full(size, 1 / size), model.memory, np.zeros(1),
        np.array([reading]), np.array([share]), np.sqrt(2.0), 1.0, 0.5, rng,
    )  # fmt: skip
    x = np.linspace(-10, 15, 20_001)
    noise = (1 - share) * stats.norm.pdf(reading - x) + share * stats.cauchy.pdf(reading - x, scale=np.sqrt(0.5))
    density = stats.norm.pdf(x, scale=np.sqrt(1.5)) * noise
    density /= density.sum()
    exact = density @ x
    variance = density @ (x - exact) ** 2
    # Self-normalised weights have the error of as many draws as the effective size, nearly: five standard deviations.
    error = 5 / np.sqrt(output[5])
    assert (
        error < 0.15
    )  # of a standard deviation; the Gaussian proposal alone is off by more than one at the far reading
    assert mean[0] == pytest.approx(exact, abs=error * np.sqrt(variance))
    assert cov[0, 0] == pytest.approx(variance, rel=2 * error)


def test_the_noise_that_all_share_is_fed_by_their_weighted_mean(linear):
    rule, size, y = SageHusa(Cubature(), forgetting=0.9), 200, np.array([0.5, -0.4, np.nan])
    rng = np.random.default_rng(1)
    states, factors, weights, memory = begin(rule, linear, size, rng)
    memory[-3:] = 0.9**10
    drawn, _, after, memory, _, _, _ = proposal_step(
        hold((rule, linear)), states, factors, weights, memory, np.zeros(1), y, GAUSSIAN, 1.0, 1.0, 0.0, rng
    )  # fmt: skip
    readings = linear.H @ drawn
    expected = readings @ after
    left = (y - expected) ** 2 + (readings - expected[:, None]) ** 2 @ after
    d = 0.1 / (1 - 0.9**11)
    np.testing.assert_allclose(memory[:2], ((1 - d) + d * left / linear.R)[:2], rtol=1e-9)
    assert memory[2] == 1.0


@pytest.mark.parametrize("name", RULES)
def test_a_particle_that_is_no_number_is_left_behind(linear, name):
    rule, rng = RULES[name], np.random.default_rng(1)
    states, factors, weights, memory = begin(rule, linear, 50, rng)
    states[:, 3] = np.nan
    factors[7] = np.inf
    y = np.array([1.0, -1.0, 2.0])
    *after, output = proposal_step(
        hold((rule, linear)), states, factors, weights, memory, np.zeros(1), y, GAUSSIAN, 1.0, 1.0, 1.1, rng
    )
    for part in (*after, output[[0, 1, 5]]):  # the model reports no more
        assert np.all(np.isfinite(part))
