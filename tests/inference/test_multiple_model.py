"""The interacting multiple model filter: laws of probability, filterpy's, and the single filter if modes are equal."""

from functools import reduce

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from vse_gym.compiled import hold
from vse_gym.inference.gaussian import (
    Extended,
    Gated,
    SquareRootUnscented,
    Unscented,
    covariance,
    filter_drive,
    filter_step,
    keep,
)
from vse_gym.inference.multiple_model import (
    Interacting,
    expect,
    interact,
    moments,
    multiple_model_step,
    multiple_model_update,
    reweigh,
)

JUMPS = np.array([[0.95, 0.05], [0.1, 0.9]])
SHARES = np.array([0.7, 0.3])
RULES = {"extended": Extended(), "unscented": Unscented(), "square root": SquareRootUnscented()}


def start(models):
    """Means, covariances and memory, with refusals of three channels, of modes that all begin with the prior."""
    model = models[0]
    return np.tile(model.prior_mean, (len(models), 1)), np.tile(model.prior_cov, (len(models), 1, 1)), np.zeros(3)


def follow(rule, models, transition, probabilities, drive, *gate):
    """Probabilities (T, M), and mean and covariance of all modes together, after each reading of a drive."""
    means, covs, memory = start(models)
    found = []
    for u, y in zip(drive.inputs, drive.readings, strict=True):
        probabilities, means, covs, memory, _, _ = multiple_model_step(
            Interacting(rule, transition, *gate), models, probabilities, means, covs, memory, u, y
        )
        found.append((probabilities, *moments(probabilities, means, covs)))
    return [np.array(what) for what in zip(*found, strict=True)]


def beliefs(seed, modes, n):
    """Probabilities, means and covariances of a random mixture."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(modes, n, n))
    return rng.dirichlet(np.ones(modes)), rng.normal(0, 5, (modes, n)), roots @ roots.transpose(0, 2, 1)


@pytest.fixture(scope="module")
def jumping(linear):
    """The linear model, and another that is damped more, pushed the other way and a bit quieter to the sensors."""
    return linear, linear._replace(F=0.7 * linear.F, G=-linear.G)


@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 4))
def test_moments_are_those_of_the_mixture(seed, modes, n):
    weights, means, covs = beliefs(seed, modes, n)
    mean, cov = moments(weights, means, covs)
    second = np.einsum("k,kij->ij", weights, covs + np.einsum("ki,kj->kij", means, means))
    np.testing.assert_allclose(mean, weights @ means, atol=1e-12)
    np.testing.assert_allclose(cov, second - np.outer(mean, mean), atol=1e-10)  # of numbers up to 200
    np.testing.assert_array_equal(cov, cov.T)


@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 4))
def test_mixing_changes_neither_the_mean_nor_the_covariance_of_all(seed, modes, n):
    # The law of total variance: what moves between modes is not lost.
    weights, means, covs = beliefs(seed, modes, n)
    transition = np.random.default_rng([seed, 1]).dirichlet(np.ones(modes), size=modes)
    predicted, *mixed = interact(transition, weights, means, covs)
    assert predicted.sum() == pytest.approx(1, abs=1e-12)
    for after, before in zip(moments(predicted, *mixed), moments(weights, means, covs), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-10)


def test_without_jumps_nothing_is_mixed_and_an_impossible_mode_stays_as_it_was():
    _, means, covs = beliefs(1, 3, 2)
    weights = np.array([0.4, 0.6, 0.0])
    for after, before in zip(interact(np.eye(3), weights, means, covs), (weights, means, covs), strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-15)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=4), st.floats(-1e6, 1e6))
def test_a_constant_in_the_log_likelihoods_is_of_no_account(logs, constant):
    shares = np.full(len(logs), 1 / len(logs))
    logs = np.array(logs)
    found = reweigh(shares, logs)
    assert found.sum() == pytest.approx(1, abs=1e-12) and found[np.argmax(logs)] == found.max()
    np.testing.assert_allclose(reweigh(shares, logs + constant), found, atol=1e-8)  # rounding of 1e6


def test_likelihoods_that_are_no_numbers_say_nothing():
    for logs in ([np.nan, np.nan], [-np.inf, -np.inf]):
        np.testing.assert_array_equal(reweigh(SHARES, np.array(logs)), SHARES)
    np.testing.assert_array_equal(reweigh(np.array([1.0, 0.0]), np.array([-1e5, 0.0])), [1.0, 0.0])


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_with_equal_modes_it_is_the_single_filter(rule, linear, linear_drive):
    probabilities, means, covs = follow(rule, (linear, linear), JUMPS, SHARES, linear_drive)
    mean, kept, memory = linear.prior_mean, keep(rule, linear.prior_cov), linear.memory
    ahead = SHARES
    for k, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        mean, kept, memory, _, _ = filter_step(rule, linear, mean, kept, memory, u, y)
        ahead = ahead @ JUMPS  # readings tell nothing
        # Rounding, which the central differences of the extended rule enlarge by one over their step.
        np.testing.assert_allclose(means[k], mean, atol=1e-8)
        np.testing.assert_allclose(covs[k], covariance(rule, kept), atol=1e-8)
        np.testing.assert_allclose(probabilities[k], ahead, atol=1e-8)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_with_equal_modes_its_gate_is_that_of_the_single_filter(rule, linear, linear_drive):
    wild = linear_drive._replace(readings=linear_drive.readings.copy())
    wild.readings[20, 0], wild.readings[30:45, 1] = 30.0, 25.0  # a spike, and a burst longer than the patience
    gate = 9.0, 10.0
    _, means, covs = follow(rule, (linear, linear), JUMPS, SHARES, wild, *gate)
    model = linear._replace(memory=np.zeros(3))
    single = filter_drive(
        Gated(rule, *gate), model, model.prior_mean, model.prior_cov, model.memory, wild.inputs, wild.readings
    )
    ungated = follow(rule, (linear, linear), JUMPS, SHARES, wild)[1]
    for found, wanted in zip((means, covs), single, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-7)  # as without a gate, in numbers ten times as large
    assert np.abs(ungated - means)[[20, 30]].max() > 1.0


@given(st.integers(0, 10_000), st.integers(1, 3))
def test_what_it_expects_to_read_is_the_mixture_of_what_its_modes_do(linear, seed, modes):
    weights, means, covs = beliefs(seed, modes, 2)
    each = np.tile(linear.H, (modes, 1, 1))
    wanted = moments(weights, np.einsum("kij,kj->ki", each, means), each @ covs @ each.transpose(0, 2, 1))
    expected, spread = expect(Interacting(Unscented(), JUMPS), (linear,) * modes, weights, means, covs, np.zeros(1))
    np.testing.assert_allclose(expected, wanted[0], atol=1e-9)
    np.testing.assert_allclose(spread, np.diag(wanted[1]), atol=1e-9)  # of numbers up to 400


def bayes(models, probabilities, drive):
    """Probabilities (T, M) of models that never change, by Bayes' rule and Kalman's equations in plain NumPy."""
    beliefs, found = [(m.prior_mean, m.prior_cov) for m in models], []
    for u, y in zip(drive.inputs, drive.readings, strict=True):
        heard = np.isfinite(y)
        likelihoods, after = [], []
        for model, (m, P) in zip(models, beliefs, strict=True):
            m, P = model.F @ m + model.G @ u, model.F @ P @ model.F.T + model.process_cov
            H = model.H[heard]
            S = H @ P @ H.T + np.diag(model.R[heard])
            likelihoods.append(multivariate_normal.pdf(y[heard], H @ m, S) if heard.any() else 1.0)
            K = P @ H.T @ np.linalg.inv(S)
            after.append((m + K @ (y[heard] - H @ m), P - K @ H @ P))
        beliefs = after
        probabilities = probabilities * likelihoods
        probabilities = probabilities / probabilities.sum()
        found.append(probabilities)
    return np.array(found)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_a_mode_that_never_changes_is_found_as_bayes_rule_says(rule, jumping, linear_drive):
    found, _, _ = follow(rule, jumping, np.eye(2), SHARES, linear_drive)
    # The model is linear, so the determinant that sigma points give is exact too; central differences: 1e-8 a step.
    np.testing.assert_allclose(found, bayes(jumping, SHARES, linear_drive), rtol=1e-5, atol=1e-9)
    assert found[-1, 0] > 0.999  # the drive was drawn from the first


def test_it_is_filterpys_on_a_linear_system_that_jumps(jumping, linear_drive):
    # filterpy mixes at the end of an update what it begins the next one with, so it stands with its first mixture
    # before the first reading, as here.
    filters = []
    for model in jumping:
        other = KalmanFilter(2, 3, 1)
        other.x, other.P = model.prior_mean.copy(), model.prior_cov.copy()
        other.F, other.B, other.H = model.F, model.G, model.H
        other.Q, other.R = model.process_cov, np.diag(model.R)
        filters.append(other)
    theirs = IMMEstimator(filters, SHARES, JUMPS)
    means, covs, memory = start(jumping)
    probabilities = SHARES
    rng = np.random.default_rng(3)
    for k, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        y = np.where(np.isnan(y), rng.normal(size=3), y)  # filterpy knows no silence of single channels
        probabilities, means, covs, memory, _, _ = multiple_model_step(
            Interacting(Unscented(), JUMPS), jumping, probabilities, means, covs, memory, u, y
        )
        theirs.predict(u)
        theirs.update(y)
        mean, cov = moments(probabilities, means, covs)
        np.testing.assert_allclose(probabilities, theirs.mu, atol=1e-9, err_msg=str(k))
        np.testing.assert_allclose(mean, theirs.x, atol=1e-9)
        np.testing.assert_allclose(cov, theirs.P, atol=1e-9)


def test_silence_leaves_the_probabilities_to_the_jumps(jumping):
    filter, quiet = Interacting(Extended(), JUMPS), np.full(3, np.nan)
    probabilities, _, covs, _, nis, dof = multiple_model_step(
        filter, jumping, SHARES, *start(jumping), np.zeros(1), quiet
    )
    np.testing.assert_allclose(probabilities, SHARES @ JUMPS, rtol=1e-12)
    assert (nis, dof) == (0.0, 0.0) and np.linalg.eigvalsh(covs).min() > 0


def test_its_nis_is_the_modes_weighed(jumping):
    u, y, rule = np.zeros(1), np.array([2.0, 0.5, -1.0]), Extended()
    constants = hold((Interacting(rule, np.eye(2)), jumping))
    means, covs, memory = start(jumping)
    kept_means = means.copy()
    probabilities, _, _, _, output = multiple_model_update(constants, SHARES, means, covs, memory, u, y)
    each = [filter_step(rule, m, m.prior_mean, m.prior_cov, memory, u, y)[3:] for m in jumping]
    nis, dof = reduce(np.add, [p * np.array(e) for p, e in zip(probabilities, each, strict=True)])
    assert output[5:] == pytest.approx([nis, dof], rel=1e-9)
    np.testing.assert_array_equal(means, kept_means)  # what was given is left alone
