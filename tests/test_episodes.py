"""What an environment draws at its resets: everything in reach, the same for a seed, nothing that is told."""

import gymnasium
import numpy as np
import pytest

from vse_gym.episodes import AS_WRITTEN, episodes
from vse_gym.models import Nominal
from vse_gym.randomise import Randomise
from vse_gym.sensors import SUITES
from vse_gym.vehicles import load

RANGES = Randomise(speed=2.0, steer=0.2, friction=0.3, mass=(1.0, 1.25), stiffness=(0.75, 1.0))
CAR = load("qin2014_understeer")


def drawn_from(estimator=("ekf", "ukf", "truth"), sensors=("gaussian", "late"), randomise=RANGES):
    return episodes("held_steer", estimator, CAR, sensors, None, "double_track", randomise, friction=0.6)


def test_what_is_written_is_driven_where_nothing_is_drawn():
    fixed = drawn_from("ekf", "loud", AS_WRITTEN)
    first, second = fixed.draw(1), fixed.draw(2)
    assert first[0] is second[0] is fixed.written[0]
    assert first[1] is second[1] is fixed.estimators[0]


def test_a_seed_draws_the_same_again_and_another_something_else():
    one, again, other = drawn_from().draw(3), drawn_from().draw(3), drawn_from().draw(4)
    assert one == again
    assert one[0] != other[0]


def test_everything_is_drawn_within_its_range_and_comes_up():
    drives = [drawn_from().draw(seed) for seed in range(200)]
    assert {type(estimator).__name__ for _, estimator in drives} == {
        "ExtendedKalmanFilter",
        "UnscentedKalmanFilter",
        "Truth",
    }
    assert {s.sensors.delay for s, _ in drives} == {SUITES["gaussian"].delay, SUITES["late"].delay}
    written = drawn_from().written[0].manoeuvre
    for values, low, high in (
        ([s.manoeuvre.friction for s, _ in drives], 0.3, 0.9),
        ([s.manoeuvre.speed for s, _ in drives], written.speed - 2, written.speed + 2),
        ([abs(s.manoeuvre.amplitude) / written.amplitude for s, _ in drives], 0.8, 1.2),
        ([s.vehicle.mass / CAR.mass for s, _ in drives], 1.0, 1.25),
    ):
        assert low <= min(values) and max(values) <= high
        assert max(values) - min(values) > 0.9 * (high - low)  # of 200 draws all but surely
    sides = [np.sign(s.manoeuvre.amplitude) for s, _ in drives]
    assert 60 < sides.count(1.0) < 140


def test_nothing_of_it_is_told():
    for seed in range(5):
        drive, _ = drawn_from(sensors="gaussian").draw(seed)
        assert drive.nominal == Nominal(CAR, SUITES["gaussian"].sheet, drawn_from().written[0].manoeuvre.speed)


def test_an_environment_drives_what_its_seed_draws():
    env = gymnasium.make("vse_gym/HeldSteer-v0", estimator=("ekf", "truth"), friction=0.6, randomise=RANGES).unwrapped
    env.reset(seed=11)
    drive, estimator = env.episodes.draw(11)
    assert (env.scenario, env.simulation.estimator) == (drive, estimator)
    env.reset()  # without a seed another
    assert env.scenario != drive


def test_a_choice_of_nothing_is_refused():
    with pytest.raises(ValueError, match="sensors must be one name or several to draw from"):
        drawn_from(sensors=[])
