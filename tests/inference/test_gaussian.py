"""Gaussian filters on a linear model, which Kalman's equations solve; silence is left out."""

import numpy as np
import pytest

from vse_gym.compiled import hold
from vse_gym.inference.gaussian import (
    Cubature,
    Extended,
    SquareRootUnscented,
    Unscented,
    correct,
    covariance,
    filter_drive,
    filter_step,
    filter_update,
    foresee,
    keep,
    predict,
)
from vse_gym.inference.model import report

RULES = {
    "extended": Extended(),
    "unscented": Unscented(),
    "unscented with a negative weight": Unscented(alpha=0.5, beta=2.0, kappa=1.0),
    "cubature": Cubature(),
    "square-root unscented": SquareRootUnscented(),
    "square-root unscented with a negative weight": SquareRootUnscented(alpha=0.5, beta=2.0, kappa=1.0),
}
rules = pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
NOTHING = np.empty(0)


@rules
def test_on_a_linear_model_it_is_the_kalman_filter(rule, linear, linear_drive):
    means, covs = filter_drive(
        rule, linear, linear.prior_mean, linear.prior_cov, linear.memory, linear_drive.inputs, linear_drive.readings
    )
    # Central differences with a step of 6e-6 are wrong by rounding over the step, 1e-16 / 6e-6 times states of 10.
    np.testing.assert_allclose(means, linear_drive.means, atol=1e-6)
    np.testing.assert_allclose(covs, linear_drive.covs, atol=1e-6)


@rules
def test_the_innovation_is_weighed_with_its_covariance(rule, linear):
    y, variances = np.array([2.0, 0.5, -1.0]), linear.R
    _, _, nis, dof = correct(rule, linear, linear.prior_mean, keep(rule, linear.prior_cov), np.zeros(1), y, variances)
    innovation = y - linear.H @ linear.prior_mean
    S = linear.H @ linear.prior_cov @ linear.H.T + np.diag(variances)
    assert nis == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-8)  # Jacobian: about 1e-10
    assert dof == 3


@rules
@pytest.mark.parametrize("silent", [[0], [1], [2], [0, 1], [0, 2], [1, 2]])
def test_a_silent_channel_is_a_channel_that_is_not_there(rule, linear, silent):
    y = np.array([2.0, 0.5, -1.0])
    y[silent] = np.nan
    heard = np.isfinite(y)
    fewer = linear._replace(H=linear.H[heard], R=linear.R[heard])
    start = linear.prior_mean, keep(rule, linear.prior_cov), NOTHING, np.array([0.3])
    mean, cov, _, nis, dof = filter_step(rule, linear, *start, y)
    expected_mean, expected_cov, _, expected_nis, expected_dof = filter_step(rule, fewer, *start, y[heard])
    np.testing.assert_array_equal(mean, expected_mean)
    np.testing.assert_array_equal(cov, expected_cov)
    assert (nis, dof) == (expected_nis, expected_dof)
    assert dof == heard.sum()


@rules
def test_with_all_channels_silent_the_prediction_remains(rule, linear):
    u = np.array([0.3])
    mean, cov, _, nis, dof = filter_step(
        rule, linear, linear.prior_mean, keep(rule, linear.prior_cov), NOTHING, u, np.full(3, np.nan)
    )
    expected_mean, expected_cov = predict(rule, linear, linear.prior_mean, keep(rule, linear.prior_cov), u)
    np.testing.assert_array_equal(mean, expected_mean)
    np.testing.assert_array_equal(cov, expected_cov)
    assert (nis, dof) == (0.0, 0.0)


@rules
def test_a_drive_in_one_call_is_the_same_as_its_steps(rule, linear, linear_drive):
    start = linear.prior_mean, linear.prior_cov, linear.memory
    means, covs = filter_drive(rule, linear, *start, linear_drive.inputs, linear_drive.readings)
    belief = linear.prior_mean, keep(rule, linear.prior_cov), linear.memory
    for k, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        *belief, _, _ = filter_step(rule, linear, *belief, u, y)
        np.testing.assert_array_equal(means[k], belief[0])
        np.testing.assert_array_equal(covs[k], covariance(rule, belief[1]))


@rules
def test_a_flat_belief_is_updated_like_its_parts(rule, linear, linear_drive):
    constants = hold((rule, linear))
    parts = linear.prior_mean, keep(rule, linear.prior_cov), linear.memory
    belief = np.concatenate([*map(np.ravel, parts), np.zeros(7)])
    for u, y in zip(linear_drive.inputs, linear_drive.readings, strict=True):
        before = belief.copy()
        belief, old = filter_update(constants, belief, u, y), belief
        *parts, nis, dof = filter_step(rule, linear, *parts, u, y)
        output = [*report(linear, parts[0], u), nis, dof]
        np.testing.assert_array_equal(belief, np.concatenate([*map(np.ravel, parts), output]))
        np.testing.assert_array_equal(old, before)


@rules
def test_what_is_foreseen_has_the_mean_and_the_variance_of_the_innovation(rule, linear):
    expected, spread = foresee(rule, linear, linear.prior_mean, keep(rule, linear.prior_cov), np.zeros(1))
    np.testing.assert_allclose(expected, linear.H @ linear.prior_mean, rtol=1e-12)
    # Central differences are wrong by 1e-16 / 6e-6.
    np.testing.assert_allclose(spread, np.diag(linear.H @ linear.prior_cov @ linear.H.T), rtol=1e-9)


@rules
def test_a_rule_carries_the_covariance(rule, linear):
    np.testing.assert_allclose(covariance(rule, keep(rule, linear.prior_cov)), linear.prior_cov, rtol=1e-14)
