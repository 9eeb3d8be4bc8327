"""Filters on the double track: all of them take it, and it sees what the single track cannot."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.models import DoubleTrackTuning
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

TAKERS = ["ekf", "ekf_told", "ukf", "ckf", "sr_ukf", "enkf", "pf", "pf_cauchy_gaussian"]
SETTINGS = {
    "braked by the stability control": {"manoeuvre": "sine_with_dwell", "sensors": "loud"},
    "the same on a smoother road than told": {"manoeuvre": "sine_with_dwell", "sensors": "loud", "friction": 0.5},
}


def sideslip_rmse(estimators, seeds=(0, 1), **settings):
    """Root mean square over seeds in the truth's drives [deg], for each estimator."""
    setting, squares = scenario(**settings), {name: [] for name in estimators}
    for seed in seeds:
        log = rollout(setting, "truth", "esc", seed)
        assert (log.brake.max(axis=1) > 200).mean() > 0.1
        moving = log.truth[:, p.VX] > 3
        for name, estimator in estimators.items():
            trace = shadow(log, estimator, setting.nominal, seed)
            assert not trace.ended
            error = np.degrees(np.arctan2(trace.estimate[:, 1], trace.estimate[:, 0]) - log.sideslip)
            squares[name].append(np.mean(error[moving] ** 2))
    return {name: np.sqrt(np.mean(found)) for name, found in squares.items()}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("rule", ["ekf", "ukf"])
def test_where_wheels_brake_it_knows_the_sideslip_better_than_the_single_track(rule, settings):
    pair = {name: ESTIMATORS.make(name) for name in (rule, f"{rule}_double_track")}
    found = sideslip_rmse(pair, **settings)
    assert found[f"{rule}_double_track"] < found[rule]


def test_every_filter_takes_it():
    tuning = DoubleTrackTuning(yaw_rate_error=0.036, wheel_error=0.16)  # a likelihood wide enough for particles too
    found = sideslip_rmse({name: ESTIMATORS.make(name, model=tuning) for name in TAKERS}, manoeuvre="sine_with_dwell")
    assert max(found.values()) < 0.5, found  # of 3.7 deg
