"""The fusion estimator lies between its two schemes, and is each of them at its gain's ends."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.fusion import FusionEstimator
from vse_gym.estimators.switching import SwitchingEstimator
from vse_gym.models.adaptation import Adaptation
from vse_gym.replay import shadow
from vse_gym.simulation import rollout, scenario

OFF = Adaptation(floor=1.0, cap=1.0)


@pytest.fixture(scope="module")
def cell():
    return scenario("slalom", "qin2014_understeer", "loud")


@pytest.fixture(scope="module")
def log(cell):
    return rollout(cell, "truth", "none", 0)


@pytest.fixture(scope="module")
def said(log, cell):
    def said(estimator):
        return shadow(log, estimator, cell.nominal, 0).estimate

    return said


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


def test_adaptation_changes_the_dynamic_scheme(said):
    adapted, told = said(FusionEstimator(gain=np.inf)), said(FusionEstimator(gain=np.inf, adaptation=OFF))
    assert np.abs(adapted - told)[:, 1].max() > 1e-3


def test_a_negative_gain_is_refused():
    with pytest.raises(ValueError, match="gain must not be negative"):
        FusionEstimator(gain=-1.0)
