"""The strong tracking filter on the car: a changed car, bursts, settings."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import Gate
from vse_gym.inference.gaussian import fading_factors
from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET, Sensors
from vse_gym.simulation import rollout
from vse_gym.types import Y_WHEEL, Reading


def followed(estimator, setting, log):
    """Fading factors (T, 3) and estimates (T, 3) over a recorded drive."""
    rng = np.random.default_rng(0)
    state, factors, means = estimator.init(setting.nominal, rng), [], []
    for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True):
        state = estimator.update(state, Reading(*row), rng)
        factors.append(fading_factors(state.kept) if len(state.kept) > 3 else np.ones(3))
        means.append(state.mean)
    return np.array(factors), np.array(means)


def test_where_nothing_fades_it_is_the_extended_filter():
    setting = scenario("sine_with_dwell", duration=3.0)
    log = rollout(setting, "truth", "none", seed=0)
    _, means = followed(ESTIMATORS.make("strong_tracking", weakening=1e6), setting, log)
    extended, rng = ESTIMATORS.make("ekf"), np.random.default_rng(0)
    state = extended.init(setting.nominal, rng)
    for row, mean in zip(zip(log.time.tolist(), log.inputs, log.readings, strict=True), means, strict=True):
        state = extended.update(state, Reading(*row), rng)
        np.testing.assert_array_equal(state.mean, mean)


def test_bursts_are_changes_to_it_and_a_gate_keeps_them_out():
    bursts = Sensors(QUIET, burst_rate=1.0, yaw_rate_burst=np.radians(30))
    setting = scenario("straight_driving", sensors=bursts, duration=6.0)
    log = rollout(setting, "truth", "none", seed=3)
    off = np.abs(log.readings[:, 2]) > 0.3
    assert off.sum() > 10
    free, gated = (
        followed(ESTIMATORS.make("strong_tracking", weakening=1.0, gate=gate), setting, log)
        for gate in (Gate(), Gate(passing=0.9999))
    )
    assert free[0][off].max() > 10
    assert np.median(gated[0][off]) == 1.0
    assert np.abs(gated[1][:, 2]).max() < 0.5 * np.abs(free[1][:, 2]).max()


@pytest.mark.parametrize("sensors", ["cauchy_gaussian", "outliers"])
def test_without_wheel_speeds_the_speed_does_not_run_away(sensors):
    setting = scenario("sine_with_dwell", sensors=sensors, friction=0.4)
    log = rollout(setting, "truth", "esc", seed=0)
    readings = log.readings.copy()
    readings[log.time > 1.0, Y_WHEEL : Y_WHEEL + 4] = np.nan
    silent = log._replace(readings=readings)
    lost = {
        name: np.abs(followed(ESTIMATORS.make(name), setting, silent)[1][:, 0] - log.truth[:, p.VX]).max()
        for name in ("strong_tracking", "ekf")
    }
    # To it an outlier is a change, so it loses more than the extended filter; unbounded it is off by more than 1e7 m/s.
    assert lost["strong_tracking"] < 2.5 * lost["ekf"]


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"forgetting": 1.5}, "forgetting must lie in"),
        ({"weakening": 0.0}, "weakening be positive"),
        ({"shares": (1.0, -1.0, 1.0)}, "shares must not be negative"),
        ({"shares": (0.0, 0.0, 0.0)}, "one positive"),
        ({"shares": ()}, "one positive"),
        ({"largest": 0.0}, "largest must be positive"),
        ({"watched": ("az",)}, "watched names no such channel"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(settings, told):
    with pytest.raises(ValueError, match=told):
        ESTIMATORS.make("strong_tracking", **settings)


def test_a_share_for_each_state_is_asked_for(nominal):
    with pytest.raises(ValueError, match="one for each of the model's 3 states"):
        ESTIMATORS.make("strong_tracking", shares=(1.0, 1.0)).init(nominal, np.random.default_rng(0))
