"""The fusion estimator lies between its two schemes, and is each of them at its gain's ends."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.fusion import FusionEstimator, fused_std
from vse_gym.estimators.switching import SwitchingEstimator
from vse_gym.models.adaptation import Adaptation
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

OFF = Adaptation(floor=1.0, cap=1.0)


@pytest.fixture(scope="module")
def cell():
    return scenario("slalom", "qin2014_understeer", "loud")


@pytest.fixture(scope="module")
def log(cell):
    return rollout(cell, "truth", "none", 0)


@pytest.fixture(scope="module")
def trace(log, cell):
    return lambda estimator: shadow(log, estimator, cell.nominal, 0)


@pytest.fixture(scope="module")
def said(trace):
    return lambda estimator: trace(estimator).estimate


def test_with_an_infinite_gain_it_is_the_dynamic_scheme(said):
    # Without adaptation that is the Kalman filter on the linear bicycle, by another algebra.
    mine, filtered = said(FusionEstimator(gain=np.inf, adaptation=OFF)), said(ESTIMATORS.make("kf"))
    np.testing.assert_allclose(mine[:, [0, 1, 2, 4]], filtered[:, [0, 1, 2, 4]], atol=1e-9)


def test_with_no_gain_it_is_the_kinematic_scheme(said):
    mine, integral = said(FusionEstimator(gain=0.0)), said(SwitchingEstimator(threshold=0.0))
    np.testing.assert_array_equal(mine[:, 1], integral[:, 1])


def test_in_between_it_draws_the_integral_to_the_dynamic_scheme(said, cell):
    gain = 3.0
    dynamic, integral = said(FusionEstimator(gain=np.inf))[:, 1], said(FusionEstimator(gain=0.0))[:, 1]
    share, vy, expected = np.exp(-gain * cell.dt), 0.0, []
    for k in range(len(dynamic)):
        vy = share * (vy + integral[k] - (integral[k - 1] if k else 0.0)) + (1 - share) * dynamic[k]
        expected.append(vy)
    np.testing.assert_allclose(said(FusionEstimator(gain=gain))[:, 1], expected, atol=1e-12)


def test_its_covariance_is_that_of_the_scheme_that_it_is(trace):
    dynamic, filtered = trace(FusionEstimator(gain=np.inf, adaptation=OFF)).cov, trace(ESTIMATORS.make("kf")).cov
    np.testing.assert_allclose(dynamic, filtered, rtol=1e-7)  # by another algebra, and from a root
    kinematic, integral = trace(FusionEstimator(gain=0.0)).cov, trace(SwitchingEstimator(threshold=0.0)).cov
    np.testing.assert_allclose(kinematic[:, 1, 1], integral[:, 1, 1], rtol=1e-9)
    assert not kinematic[:, 1, 2].any()


def test_in_between_its_variance_is_not_the_dynamic_schemes(trace):
    slow, dynamic = trace(FusionEstimator(gain=0.1)).cov, trace(FusionEstimator(gain=np.inf)).cov
    # After a second nine tenths of it are still the start's 0.2 m/s, which the dynamic scheme has long halved.
    assert slow[100, 1, 1] > 2 * dynamic[100, 1, 1]
    assert np.sqrt(slow[100, 1, 1]) == pytest.approx(0.9 * 0.2 + 0.1 * np.sqrt(dynamic[100, 1, 1]), rel=0.1)
    np.testing.assert_array_equal(slow[:, 2, 2], dynamic[:, 2, 2])


@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.5, 0.99])
@pytest.mark.parametrize("share", [0.5, 0.98])
def test_its_deviation_is_an_upper_bound_however_the_schemes_errors_hang_together(share, correlation):
    # Errors of both, z <- share (z + n) + (1 - share) d with d <- correlation d + noise of the same variance always.
    noise, dynamic, bound = 0.01, 0.3, 0.2
    step = np.array([[share, (1 - share) * correlation], [0.0, correlation]])
    fresh = (1 - correlation**2) * dynamic * np.outer([1 - share, 1.0], [1 - share, 1.0])
    cov = np.diag([bound**2, dynamic])
    for _ in range(500):
        cov = step @ cov @ step.T + fresh + np.diag([share**2 * noise, 0.0])
        bound = fused_std(share, bound, noise, dynamic)
        assert cov[0, 0] <= bound**2 * (1 + 1e-12)


def test_errors_that_are_one_and_the_same_reach_the_bound():
    assert fused_std(0.9, 0.3, 0.0, 0.09) == pytest.approx(0.3, rel=1e-15)


def test_adaptation_changes_the_dynamic_scheme(said):
    adapted, told = said(FusionEstimator(gain=np.inf)), said(FusionEstimator(gain=np.inf, adaptation=OFF))
    assert np.abs(adapted - told)[:, 1].max() > 1e-3


def test_a_negative_gain_is_refused():
    with pytest.raises(ValueError, match="gain must not be negative"):
        FusionEstimator(gain=-1.0)
