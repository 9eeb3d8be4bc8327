"""The single track that carries friction: the plain one on each column's road, and a decay towards what was told."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.inference.model import advance, observe, report
from vse_gym.models import Nominal, SingleTrackTuning
from vse_gym.models.single_track_friction import HIGHEST, LOWEST, with_friction, within
from vse_gym.sensors import LOUD
from vse_gym.types import U_BRAKE, U_STEER, Y_AX
from vse_gym.vehicles import load

TOLD = 0.8
STATES = np.array([[20.0, 15.0, 20.0, 3.0], [0.5, -1.0, 2.0, 0.0], [0.3, -0.2, 0.5, 0.0], [0.9, 0.35, 1.5, -0.2]])


@pytest.fixture(scope="module")
def car():
    return SingleTrackTuning().build(Nominal(load("qin2014_understeer"), LOUD, 20.0, friction=TOLD))


def steered(brake):
    u = np.zeros(9)
    u[U_STEER], u[U_BRAKE : U_BRAKE + 4] = 0.05, [brake, 0.5 * brake, 0.2 * brake, 0.0]
    return u


@pytest.mark.parametrize(("brake", "frictions"), [(0.0, STATES[3]), (1500.0, np.full(4, TOLD))])
def test_every_column_is_the_single_track_on_its_own_road(car, brake, frictions):
    # Any road while nothing brakes, and the one that was told whatever brakes; the ratio of frictions rounds.
    model, u, states = with_friction(car, 0.3, 0.2, 2.0), steered(brake), np.vstack((STATES[:3], frictions))
    ahead, read = advance(model, states, u), observe(model, states, u)
    for j in range(states.shape[1]):
        road = car._replace(friction=min(max(states[3, j], LOWEST), HIGHEST))
        column = states[:3, j : j + 1].copy()
        np.testing.assert_allclose(ahead[:3, j], advance(road, column, u)[:, 0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(read[:, j], observe(road, column, u)[:, 0], rtol=1e-9, atol=1e-9)
        told = report(model, states[:, j].copy(), u), report(road, column[:, 0].copy(), u)
        np.testing.assert_allclose(*told, rtol=1e-9, atol=1e-9)


def test_deceleration_says_nothing_of_the_road(car):
    # But for the drag of the steered wheels, which it has without brakes too.
    model, slow = with_friction(car, 0.3, 0.2, 2.0), np.array(2 * [[20.0], [0.0], [0.0]]).reshape(2, 3).T
    u = steered(2000.0)
    u[U_STEER] = 0.0
    ax = observe(model, np.vstack((slow, [0.3, 0.9])), u)[Y_AX]
    assert ax[0] == ax[1] < -3


@given(st.floats(-10, 10), st.floats(0.01, 100))
def test_friction_stays_within_its_bounds_and_decays_towards_what_was_told(car, friction, decay):
    states = np.array([[20.0], [0.0], [0.0], [friction]])
    ahead = advance(with_friction(car, 0.3, 0.2, decay), states, np.zeros(9))[3, 0]
    share = np.exp(-car.dt / decay)
    assert ahead == pytest.approx(TOLD + share * (within(friction) - TOLD), rel=1e-12)
    assert LOWEST <= ahead <= HIGHEST


def test_a_friction_that_nobody_feels_has_a_bounded_doubt(car):
    # The stationary variance of the process: noise^2 decay / 2, to the first order of a step over the decay.
    model = with_friction(car, 0.3, 0.0, 2.0)
    variance = 0.0
    for _ in range(5000):
        variance = model.remaining**2 * variance + model.process_cov[3, 3]
    assert variance == pytest.approx(0.3**2 * 2.0 / 2, rel=0.01)
