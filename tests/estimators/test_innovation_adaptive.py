"""The innovation-adaptive filter on the car."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import Gate
from vse_gym.estimators.innovation_adaptive import InnovationAdaptiveKalmanFilter
from vse_gym.models import SingleTrackTuning
from vse_gym.models.adaptation import Adaptation
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

OFF = Adaptation(floor=1.0, cap=1.0)


@pytest.mark.parametrize("gate", [Gate(), Gate(passing=0.99)], ids=["open", "gated"])
def test_without_adaptation_it_is_the_extended_kalman_filter(gate, nominal, readings):
    rng = np.random.default_rng(0)
    mine, theirs = InnovationAdaptiveKalmanFilter(adaptation=OFF, gate=gate), ESTIMATORS.make("ekf", gate=gate)
    a, b = mine.init(nominal, rng), theirs.init(nominal, rng)
    for reading in readings:
        a, b = mine.update(a, reading, rng), theirs.update(b, reading, rng)
        np.testing.assert_array_equal(a.output, b.output)
        np.testing.assert_array_equal(a.cov, b.cov)


def test_growing_noise_does_it_less_harm():
    # The gyro's noise grows twentyfold: who is told its first level follows it, be he ever so sure of his model.
    cell = scenario("slalom", "qin2014_understeer", "growing")
    log = rollout(cell, "truth", "none", 0)
    model = SingleTrackTuning(yaw_noise=0.05)
    late = log.time > 5.0
    rough = {
        name: np.std(np.diff(shadow(log, ESTIMATORS.make(name, model=model), cell.nominal, 0).estimate[late, 2]))
        for name in ("iae_ekf", "ekf")
    }
    assert rough["iae_ekf"] < 0.5 * rough["ekf"]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"window": 0}, "window"),
        ({"floor": 2.0, "cap": 1.0}, "floor and cap"),
        ({"channels": ("az",)}, "no such channel"),
    ],
)
def test_wrong_settings_are_refused(settings, says):
    with pytest.raises(ValueError, match=says):
        Adaptation(**settings)
