"""Gaussian filters on the car, beside other libraries' and beside each other."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import CubatureKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import CubatureKalmanUpdater

from vse_gym.inference.gaussian import (
    Cubature,
    Extended,
    SquareRootUnscented,
    Unscented,
    correct,
    covariance,
    failed_downdates,
    filter_drive,
    keep,
    predict,
)
from vse_gym.inference.model import advance, attend, observe
from vse_gym.models import SingleTrackTuning
from vse_gym.scenarios import scenario
from vse_gym.sensors import FITTED
from vse_gym.simulation import rollout


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


class OneStep(TransitionModel):
    """The car's model over one step, as Stone Soup wants it."""

    model = u = None
    ndim_state = 3

    def function(self, state, noise=False, **_):
        return StateVector(advance(self.model, np.array(state.state_vector, dtype=float), self.u))

    def covar(self, **_):
        return CovarianceMatrix(self.model.process_cov)

    def rvs(self, *_, **__):
        raise NotImplementedError

    pdf = rvs


class Sensors(MeasurementModel):
    """What the car's sensors read, as Stone Soup wants it."""

    model = u = variances = None
    ndim_state, ndim_meas, mapping = 3, FITTED, (0, 1, 2)

    def function(self, state, noise=False, **_):
        return StateVector(heard(self.model, np.array(state.state_vector, dtype=float), self.u))

    def covar(self, **_):
        return CovarianceMatrix(np.diag(self.variances))

    def rvs(self, *_, **__):
        raise NotImplementedError

    pdf = rvs


def test_the_cubature_filter_is_stone_soups(car_drive):
    # filterpy's would be no oracle: it does not draw its points anew for the update.
    model, inputs, readings = car_drive
    means, covs = ours(Cubature(), *car_drive)
    belief, memory = GaussianState(model.prior_mean, model.prior_cov), model.memory
    for k, (u, y) in enumerate(zip(inputs, readings, strict=True)):
        motion, sensors = OneStep(), Sensors()
        motion.model, motion.u, sensors.model, sensors.u = model, u, model, u
        prediction = CubatureKalmanPredictor(motion).predict(belief)
        variances, memory = attend(model, memory, u, y)
        sensors.variances = variances[:FITTED]
        reading = Detection(y[:FITTED], measurement_model=sensors)
        belief = CubatureKalmanUpdater(sensors).update(SingleHypothesis(prediction, reading))
        np.testing.assert_allclose(means[k], belief.mean.ravel(), rtol=1e-9, atol=1e-9)  # rounding only
        np.testing.assert_allclose(covs[k], belief.covar, rtol=1e-9, atol=1e-9)


# -- beside each other ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "other"),
    [
        (Cubature(), Unscented(alpha=1.0, beta=0.0, kappa=0.0)),
        (SquareRootUnscented(), Unscented()),
        (SquareRootUnscented(alpha=0.5, beta=2.0, kappa=1.0), Unscented(alpha=0.5, beta=2.0, kappa=1.0)),
    ],
    ids=["cubature", "square root", "square root with a negative weight"],
)
def test_it_is_the_unscented_filter_in_other_words(car_drive, rule, other):
    for mine, theirs in zip(ours(rule, *car_drive), ours(other, *car_drive), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-10)


def test_a_downdate_that_fails_is_mended_and_counted(car_drive):
    model, inputs, readings = car_drive
    u, k = inputs[100], 100
    assert abs(u[0]) > 0.01  # steering: the curve of the tyres is not the same on both sides
    # A first point that takes away far more variance than the others give; no Gaussian has such a beta.
    for beta, fails in ((2.0, False), (-1e4, True)):
        rule = SquareRootUnscented(alpha=1.0, beta=beta, kappa=0.0)
        mean, kept = predict(rule, model, model.prior_mean, keep(rule, np.diag([1.0, 4.0, 0.25])), u)
        mean, kept, _, _ = correct(rule, model, mean, kept, u, readings[k], model.variances)
        assert (failed_downdates(kept) > 0) == fails
        assert np.isfinite(mean).all()
        assert np.linalg.eigvalsh(covariance(rule, kept)).min() >= 0
