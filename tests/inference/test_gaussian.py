"""Gaussian filters: Kalman's equations on a linear model, another library's code on the car, silence left out."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from vse_gym.compiled import hold
from vse_gym.inference.gaussian import Extended, Unscented, correct, filter_drive, filter_step, filter_update, predict
from vse_gym.inference.model import advance, attend, observe, report
from vse_gym.models import SingleTrackTuning
from vse_gym.sensors import FITTED
from vse_gym.simulation import rollout, scenario

RULES = [Extended(), Unscented(), Unscented(alpha=0.5, beta=2.0, kappa=1.0)]
RULE_NAMES = ["extended", "unscented", "unscented with a negative weight"]
rules = pytest.mark.parametrize("rule", RULES, ids=RULE_NAMES)
NOTHING = np.empty(0)


# -- the linear model, which Kalman's equations solve -----------------------------------------------------------------


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
    _, _, nis, dof = correct(rule, linear, linear.prior_mean, linear.prior_cov, np.zeros(1), y, variances)
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
    start = linear.prior_mean, linear.prior_cov, NOTHING, np.array([0.3])
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
        rule, linear, linear.prior_mean, linear.prior_cov, NOTHING, u, np.full(3, np.nan)
    )
    expected_mean, expected_cov = predict(rule, linear, linear.prior_mean, linear.prior_cov, u)
    np.testing.assert_array_equal(mean, expected_mean)
    np.testing.assert_array_equal(cov, expected_cov)
    assert (nis, dof) == (0.0, 0.0)


@rules
def test_a_drive_in_one_call_is_the_same_as_its_steps(rule, linear, linear_drive):
    belief = linear.prior_mean, linear.prior_cov, linear.memory
    means, covs = filter_drive(rule, linear, *belief, linear_drive.inputs, linear_drive.readings)
    for k, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        *belief, _, _ = filter_step(rule, linear, *belief, u, y)
        np.testing.assert_array_equal(means[k], belief[0])
        np.testing.assert_array_equal(covs[k], belief[1])


@rules
def test_a_flat_belief_is_updated_like_its_parts(rule, linear, linear_drive):
    constants, parts = hold((rule, linear)), (linear.prior_mean, linear.prior_cov, linear.memory)
    belief = np.concatenate([*map(np.ravel, parts), np.zeros(7)])
    for u, y in zip(linear_drive.inputs, linear_drive.readings, strict=True):
        before = belief.copy()
        belief, old = filter_update(constants, belief, u, y), belief
        *parts, nis, dof = filter_step(rule, linear, *parts, u, y)
        output = [*report(linear, parts[0], u), nis, dof]
        np.testing.assert_array_equal(belief, np.concatenate([*map(np.ravel, parts), output]))
        np.testing.assert_array_equal(old, before)


# -- the car, which filterpy's code filters too -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def car_drive():
    """A model of the car, and inputs and readings of a brisk lane change without brakes and without silence."""
    setting = scenario("sine_with_dwell", sensors="loud", amplitude=np.radians(60), duration=4.0)
    log = rollout(setting, "truth", "none", seed=1)
    assert not log.ended
    assert np.isfinite(log.readings[:, :FITTED]).all()  # filterpy can neither leave a channel out
    assert np.isnan(log.readings[:, FITTED:]).all()
    assert not log.brake.any()  # nor can it stop believing a wheel
    assert np.abs(log.readings[:, 1]).max() > 5  # and the tyres are beyond their linear range
    return SingleTrackTuning().build(setting.nominal), log.inputs, log.readings


def ours(rule, model, inputs, readings):
    return filter_drive(rule, model, model.prior_mean, model.prior_cov, model.memory, inputs, readings)


def start(other, model):
    other.x, other.P, other.Q = model.prior_mean.copy(), model.prior_cov.copy(), model.process_cov
    return other


def heard(model, x, u):
    """Expected readings of the sensors that are on board, for states as columns."""
    return observe(model, x, u)[:FITTED]


def differentiate(function, model, x, u, step):
    """Value and Jacobian of one of the model's functions by central differences, as the extended rule takes them."""
    h = np.diag(step * np.maximum(1.0, np.abs(x)))
    beside = np.ascontiguousarray(np.column_stack([x, x[:, None] + h, x[:, None] - h]))
    values = function(model, beside, u)
    n = x.size
    width = np.diag(beside[:, 1 : n + 1] - beside[:, n + 1 :])
    return values[:, 0], (values[:, 1 : n + 1] - values[:, n + 1 :]) / width


def test_the_extended_filter_is_filterpys(car_drive):
    model, inputs, readings = car_drive
    rule = Extended()
    other, memory = start(ExtendedKalmanFilter(dim_x=3, dim_z=FITTED), model), model.memory
    means, covs = ours(rule, *car_drive)
    for k, (u, y) in enumerate(zip(inputs, readings, strict=True)):
        predicted, other.F = differentiate(advance, model, other.x, u, rule.step)
        other.predict_x = lambda _, predicted=predicted: setattr(other, "x", predicted)
        other.predict()
        variances, memory = attend(model, memory, u, y)
        expected, H = differentiate(heard, model, other.x, u, rule.step)
        R = np.diag(variances[:FITTED])
        other.update(y[:FITTED], lambda _, H=H: H, lambda _, expected=expected: expected, R=R)
        # The same formulas in another order, one channel after the other instead of jointly: rounding only.
        np.testing.assert_allclose(means[k], other.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(covs[k], other.P, rtol=1e-9, atol=1e-9)


def test_the_unscented_filter_is_filterpys(car_drive):
    model, inputs, readings = car_drive
    rule = Unscented()
    points = MerweScaledSigmaPoints(3, rule.alpha, rule.beta, rule.kappa)

    def fx(x, dt, u):
        return advance(model, np.ascontiguousarray(x[:, None]), u)[:, 0]

    def hx(x, u):
        return heard(model, np.ascontiguousarray(x[:, None]), u)[:, 0]

    other, memory = start(UnscentedKalmanFilter(3, FITTED, model.dt, hx, fx, points), model), model.memory
    means, covs = ours(rule, *car_drive)
    for k, (u, y) in enumerate(zip(inputs, readings, strict=True)):
        other.predict(u=u)
        other.sigmas_f = points.sigma_points(other.x, other.P)  # drawn anew, as every version of it should
        variances, memory = attend(model, memory, u, y)
        other.update(y[:FITTED], R=np.diag(variances[:FITTED]), u=u)
        np.testing.assert_allclose(means[k], other.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(covs[k], other.P, rtol=1e-9, atol=1e-9)
