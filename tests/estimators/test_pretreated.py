"""Another estimator behind the pre-treatment hears clean readings."""

from typing import NamedTuple

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.pretreatment import Pretreated, Pretreatment
from vse_gym.models.pretreatment import steady_yaw_rate
from vse_gym.testing import ESTIMATOR_CHECKS
from vse_gym.types import Y_AY, Y_YAW_RATE, Estimate
from vse_gym.vehicles import load


class Heard(NamedTuple):
    y: np.ndarray


class Listens(Estimator):
    """Keeps what it was told last."""

    def init(self, nominal, rng):
        return Heard(np.zeros(10))

    def update(self, state, reading, rng):
        return Heard(reading.y)

    def estimate(self, state):
        return Estimate(vx=0.0)


def told(treatment, nominal, readings):
    estimator, rng, out = Pretreated(Listens(), treatment), np.random.default_rng(0), []
    state = estimator.init(nominal, rng)
    for reading in readings:
        state = estimator.update(state, reading, rng)
        out.append(state.inner.y)
    return np.array(out)


NOTHING = Pretreatment(filtered=(), ay_band=np.inf, yaw_rate_band=np.inf)


def test_a_treatment_that_does_nothing_changes_nothing(nominal, readings):
    np.testing.assert_array_equal(told(NOTHING, nominal, readings), [r.y for r in readings])


def test_a_spike_of_the_gyro_is_replaced_and_other_channels_are_left_alone(nominal, readings):
    quiet = [r._replace(y=np.where(np.arange(10) < 3, 0.01, r.y), inputs=np.zeros(9)) for r in readings[:50]]
    quiet[30].y[Y_YAW_RATE] = 0.84
    heard = told(Pretreatment(filtered=()), nominal, quiet)
    assert heard[30, Y_YAW_RATE] == 0.01
    others = np.arange(10) != Y_YAW_RATE
    np.testing.assert_array_equal(heard[30, others], quiet[30].y[others])


def test_a_silent_sensor_stays_silent(nominal, readings):
    silent = [r._replace(y=r.y.copy()) for r in readings[:20]]
    silent[10].y[[Y_AY, Y_YAW_RATE]] = np.nan
    heard = told(Pretreatment(filtered=("ay", "yaw_rate")), nominal, silent)
    assert np.isnan(heard[10, [Y_AY, Y_YAW_RATE]]).all()
    assert np.isfinite(heard[11, [Y_AY, Y_YAW_RATE]]).all()


def test_the_reference_is_the_steady_turn_within_the_friction(nominal):
    car = nominal.vehicle
    t = Pretreatment().build(nominal)
    assert steady_yaw_rate(t, 0.01, 20.0) == pytest.approx(20 * 0.01 / (car.wheelbase + car.understeer_gradient * 400))
    assert steady_yaw_rate(t, -0.3, 20.0) == pytest.approx(-0.9 * 9.81 / 20)
    assert steady_yaw_rate(t, 0.3, 0.0) == 0.0


def test_an_oversteering_car_is_taken_for_a_neutral_one(nominal):
    car = load("qin2014")
    t = Pretreatment().build(type(nominal)(car, nominal.sheet, 40.0))
    assert steady_yaw_rate(t, 0.001, 40.0) == pytest.approx(40 * 0.001 / car.wheelbase)


@pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_an_estimators_promises(check, nominal, readings):
    check(Pretreated(ESTIMATORS.make("ekf")), nominal, readings)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"filtered": ("ax",)}, "no such channel"),
        ({"corner": 0.0}, "corner must be positive"),
        ({"patience": -1.0}, "patience and lag"),
    ],
)
def test_wrong_settings_are_refused(settings, says):
    with pytest.raises(ValueError, match=says):
        Pretreatment(**settings)
