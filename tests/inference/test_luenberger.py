"""The observer's error goes as fast as its poles are placed."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.inference.linear import matrices
from vse_gym.inference.luenberger import placed_gain
from vse_gym.models import LinearBicycleTuning, Nominal
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET
from vse_gym.simulation import rollout
from vse_gym.types import Y_AY, Y_YAW_RATE, Reading
from vse_gym.vehicles import load

ROWS = [Y_AY, Y_YAW_RATE]


@pytest.mark.parametrize("car", ["qin2014", "chen2024_c_class", "bmw_320i"])
@pytest.mark.parametrize("speed", [2.0, 10.0, 40.0])
def test_the_errors_dynamics_have_the_poles_that_are_asked_for(car, speed):
    bicycle = LinearBicycleTuning().build(Nominal(load(car), QUIET, speed=speed))
    F, _, H, _ = matrices(bicycle, bicycle.memory, np.zeros(9))
    gain = placed_gain(F, H[ROWS], 0.97, 0.8)
    np.testing.assert_allclose((np.eye(2) - gain @ H[ROWS]) @ F, np.diag([0.97, 0.8]), atol=1e-10)


def test_a_wrong_start_is_forgotten_at_the_rates_asked_for(nominal, readings):
    # The observer is linear in its state: the difference of two that hear the same is the error's dynamics itself.
    observer, rng = ESTIMATORS.make("luenberger", vy_rate=3.0, yaw_rate=15.0), np.random.default_rng(0)
    right = observer.init(nominal, rng)
    belief = right.belief.copy()
    belief[:2] += 2.0, 0.5
    wrong = right._replace(belief=belief)
    heard = [r._replace(y=np.where(np.isnan(r.y), 0.0, r.y)) for r in readings[:100]]
    for reading in heard:
        right, wrong = observer.update(right, reading, rng), observer.update(wrong, reading, rng)
    left = (wrong.belief - right.belief)[:2]
    np.testing.assert_allclose(left, [2.0 * np.exp(-3.0), 0.5 * np.exp(-15.0)], rtol=1e-6, atol=1e-9)


def linear_car():
    car = load("qin2014_understeer")
    tyres = [p.LinearTyre(t.slip_stiffness, t.cornering_stiffness) for t in (car.front_tyre, car.rear_tyre)]
    return car._replace(front_tyre=tyres[0], rear_tyre=tyres[1])


def test_on_linear_tyres_it_finds_the_sideslip_from_a_wrong_start():
    cell = scenario("sine_steer", linear_car(), "clean", amplitude=0.3)
    log = rollout(cell, "truth", "none", 0)
    observer, rng = ESTIMATORS.make("luenberger"), np.random.default_rng(0)
    state = observer.init(cell.nominal, rng)
    belief = state.belief.copy()
    belief[0] = 1.5
    state, said = state._replace(belief=belief), []
    for k in range(len(log.time)):
        state = observer.update(state, Reading(float(log.time[k]), log.inputs[k], log.readings[k]), rng)
        said.append(observer.estimate(state).vy)
    error = np.abs(np.array(said) - log.truth[:, p.VY])
    assert error[0] > 1.0
    assert error[300:].max() < 0.05 * np.abs(log.truth[:, p.VY]).max()  # the wheels' slip and the tyres' drag


def test_a_silent_channel_corrects_nothing(nominal, readings):
    observer, rng = ESTIMATORS.make("luenberger"), np.random.default_rng(0)
    state = observer.init(nominal, rng)
    y = readings[0].y.copy()
    y[ROWS] = np.nan
    after = observer.update(state, readings[0]._replace(y=y), rng)
    model = state.constants.value[1]
    F, g, _, _ = matrices(model, after.belief[2:-5], readings[0].inputs)
    np.testing.assert_allclose(after.belief[:2], F @ state.belief[:2] + g, atol=1e-14)


def test_rates_must_be_positive():
    with pytest.raises(ValueError, match="rates must be positive"):
        ESTIMATORS.make("luenberger", vy_rate=0.0)


def test_most_of_a_slaloms_sideslip_is_known():
    cell = scenario("slalom", "qin2014_understeer", "gaussian")
    log = rollout(cell, "truth", "none", 0)
    error = [
        np.std(shadow(log, ESTIMATORS.make(name), cell.nominal, 0).estimate[:, 1] - log.truth[:, p.VY])
        for name in ("luenberger", "zero")
    ]
    assert error[0] < 0.5 * error[1]
