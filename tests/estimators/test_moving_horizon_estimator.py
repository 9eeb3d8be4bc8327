"""The moving-horizon estimator: what it is told, what it shrugs off, and what it costs."""

import time

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.types import Y_YAW_RATE, Reading


def said(estimator, nominal, readings):
    rng, out = np.random.default_rng(0), []
    state = estimator.init(nominal, rng)
    for reading in readings:
        state = estimator.update(state, reading, rng)
        out.append(estimator.estimate(state))
    return out


@pytest.mark.parametrize(
    "settings", [{"horizon": 0}, {"iterations": 0}, {"loss": "square"}, {"limit": 0.0}, {"alpha": 0.9}], ids=str
)
def test_a_number_that_cannot_be_is_refused(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        ESTIMATORS.make("mhe", **settings)


def test_a_burst_of_the_gyro_moves_it_less_than_least_squares(nominal, readings):
    # Huber's loss would follow it: what it leaves of the pull of such a gyro still beats what the model is trusted.
    wild = [Reading(r.time, r.inputs, r.y.copy()) for r in readings[:150]]
    for reading in wild[100:105]:
        reading.y[Y_YAW_RATE] += 2.0
    moved = {}
    for kind in ("cauchy_gaussian", "least_squares"):
        estimator = ESTIMATORS.make("mhe", loss=kind)
        pair = [np.array([e[:3] for e in said(estimator, nominal, heard)]) for heard in (readings[:150], wild)]
        moved[kind] = np.abs(pair[0] - pair[1]).max(axis=0)
    assert moved["cauchy_gaussian"][2] < 0.5 * moved["least_squares"][2]
    assert (
        moved["cauchy_gaussian"][1] < 0.5 * moved["least_squares"][1]
    )  # the lateral speed that nothing but the model tells


def test_friction_that_is_told_is_used(nominal, readings):
    estimator, rng = ESTIMATORS.make("mhe"), np.random.default_rng(0)
    state = estimator.tell_friction(estimator.init(nominal, rng), 0.3)
    assert state.model.friction == 0.3
    assert estimator.update(state, readings[0], rng).model.friction == 0.3


def test_its_cost_grows_with_the_horizon_and_not_with_its_square(nominal, readings):
    def seconds(horizon):
        estimator, rng = ESTIMATORS.make("mhe", horizon=horizon), np.random.default_rng(0)
        state = estimator.init(nominal, rng)
        for reading in readings[:horizon]:  # the window is full from here on
            state = estimator.update(state, reading, rng)
        took = []
        for reading in (readings * 2)[horizon : horizon + 60]:
            begin = time.process_time()
            state = estimator.update(state, reading, rng)
            took.append(time.process_time() - begin)
        return np.median(took)

    seconds(10)  # compiles
    short, long = seconds(40), seconds(160)
    assert long < 8 * short  # four times the readings; with a dense solution, 64 times
    assert seconds(10) < 1e-3  # of the default
