"""A car whose tyres lag behind its motion, in filters that are not of the one recursion; and two rules that are one."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.estimators.multiple_model import InteractingMultipleModel
from vse_gym.inference.gaussian import Cubature, Unscented, filter_drive
from vse_gym.inference.model import attend, heed, recall, remember
from vse_gym.models import RollTrackTuning
from vse_gym.models.roll import M_LAG
from vse_gym.scenarios import scenario
from vse_gym.sensors import stream
from vse_gym.simulation import rollout
from vse_gym.types import Reading

LAGS = slice(M_LAG, M_LAG + 8)
TUNING = RollTrackTuning()


@pytest.fixture(scope="module")
def cell():
    return scenario("sine_steer", "wei2019_roll", "loud", duration=1.5)


@pytest.fixture(scope="module")
def readings(cell):
    log = rollout(cell, "truth", "none", 0)
    assert cell.nominal.vehicle.relaxation_y > 0.1
    return [Reading(*row) for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True)]


def states(estimator, cell, readings):
    """After every reading; the start's comes first."""
    rng = stream(0, "estimator")
    out = [estimator.init(cell.nominal, rng)]
    for reading in readings:
        out.append(estimator.update(out[-1], reading, rng))
    return out


def test_interacting_filters_that_are_all_alike_are_the_single_one(cell, readings):
    friction = cell.nominal.friction
    several = InteractingMultipleModel(model=TUNING, frictions=(friction, friction), shares=(0.5, 0.5))
    mixed, single = (states(e, cell, readings)[1:] for e in (several, ExtendedKalmanFilter(TUNING)))
    # Rounding, which central differences enlarge by one over their step
    np.testing.assert_allclose([m.means[0] for m in mixed], [s.mean for s in single], atol=1e-6)
    np.testing.assert_allclose([m.cov for m in mixed], [s.cov for s in single], atol=1e-6)
    assert max(np.abs(m.memory[LAGS]).max() for m in mixed) > 1e-3


@pytest.mark.parametrize("name", ["mapf_physics", "mhe"])
def test_slips_follow_the_corrected_motion(name, cell, readings):
    model = TUNING.build(cell.nominal)
    drive = states(ESTIMATORS.make(name, model=TUNING), cell, readings)
    lags = 0.0
    for reading, before, after in zip(readings, drive, drive[1:], strict=False):
        old, new = (getattr(s, "swarm", s).memory for s in (before, after))
        u = recall(model, old, heed(model, reading.inputs, reading.y))
        motion = np.concatenate((after.output[:3], np.zeros(2)))  # roll moves no slip
        wanted = remember(model, attend(model, old, u, reading.y)[1], motion, u)
        np.testing.assert_allclose(new, wanted, rtol=1e-9, atol=1e-12)
        lags = max(lags, np.abs(new[LAGS]).max())
    assert lags > 1e-3


def test_over_one_reading_the_moving_horizon_is_the_extended_filter(cell, readings):
    one = ESTIMATORS.make("mhe", model=TUNING, horizon=1, iterations=1, loss="least_squares")
    window, single = (states(e, cell, readings[:60]) for e in (one, ExtendedKalmanFilter(TUNING)))
    np.testing.assert_allclose(window[1].states[-1], single[1].mean, atol=1e-8)
    # Later the two linearise what is let go of in different places.
    found, wanted = (np.array([s.output[:3] for s in path[1:]]) for path in (window, single))
    np.testing.assert_allclose(found, wanted, atol=5e-3)


def test_the_cubature_rule_is_the_unscented_one_without_a_centre(cell, readings):
    # alpha 1, beta 0, kappa 0 leave the centre no weight, and the others 1/(2 n) at sqrt(n) deviations.
    model = TUNING.build(cell.nominal)
    drive = np.array([r.inputs for r in readings[:20]]), np.array([r.y for r in readings[:20]])
    start = model.prior_mean, model.prior_cov, model.memory
    cubature, unscented = (filter_drive(rule, model, *start, *drive) for rule in (Cubature(), Unscented(1.0, 0.0, 0.0)))
    for one, other in zip(cubature, unscented, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    assert np.abs(cubature[0][-1, 1:]).min() > 1e-6  # in each state something happens
