"""The gate on the car: bursts do less harm, and without any it changes next to nothing."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import Gate
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

GATE = Gate(passing=0.9999)


def rmse(sensors, name):
    """Of sideslip [deg] and yaw rate [deg/s] over three of the truth's drives, without and with the gate: (2, 2)."""
    setting, found = scenario("sine_with_dwell", sensors=sensors), []
    estimators = ESTIMATORS.make(name), ESTIMATORS.make(name, gate=GATE)
    for seed in range(3):
        log = rollout(setting, "truth", "esc", seed)
        moving = log.truth[:, p.VX] > 3
        for estimator in estimators:
            trace = shadow(log, estimator, setting.nominal, seed)
            sideslip = np.arctan2(trace.estimate[:, 1], trace.estimate[:, 0]) - log.sideslip
            yaw_rate = trace.estimate[:, 2] - log.truth[:, p.YAW_RATE]
            found.append([np.mean(e[moving] ** 2) for e in (sideslip, yaw_rate)])
    return np.degrees(np.sqrt(np.mean(np.reshape(found, (3, 2, 2)), axis=0)))


@pytest.mark.parametrize("name", ["ekf", "ukf", "imm"])
def test_bursts_do_less_harm(name):
    without, gated = rmse("outliers", name)
    assert gated[1] < 0.5 * without[1]
    assert gated[0] < without[0]


def test_bursts_do_less_harm_to_the_linear_bicycle_if_only_a_little():
    # At the limit its tyres are as wrong as a burst: without the gyro the prediction runs away within a few steps.
    without, gated = rmse("outliers", "kf")
    assert gated[1] < without[1]


@pytest.mark.parametrize("name", ["ekf", "kf"])
@pytest.mark.parametrize("sensors", ["gaussian", "loud"])
def test_without_bursts_it_changes_next_to_nothing(name, sensors):
    without, gated = rmse(sensors, name)
    np.testing.assert_allclose(gated, without, rtol=0.02)


@pytest.mark.parametrize("settings", [{"passing": 0.0}, {"passing": 1.1}, {"patience": -1.0}, {"patience": np.inf}])
def test_a_gate_that_cannot_be_is_refused(settings):
    with pytest.raises(ValueError, match="passing must lie in"):
        Gate(**settings)
