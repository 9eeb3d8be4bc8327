"""The three double lane changes of system D."""

import numpy as np
import pytest

from vse_gym.catalogue import MANOEUVRES
from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout


@pytest.fixture(scope="module")
def cell():
    return scenario("triple_lane_change", "chen2024_c_class", "clean")


@pytest.fixture(scope="module")
def log(cell):
    return rollout(cell, "truth", "none", 0)


def test_each_third_has_its_friction(log):
    for when, friction in ((4.0, 0.85), (13.0, 0.5), (22.0, 0.35)):
        assert log.friction[round(when / 0.01)] == friction


def test_the_car_goes_over_and_back_three_times(log, cell):
    line, way = cell.manoeuvre.path(cell.vehicle), 300.0 * np.arange(4)
    np.testing.assert_allclose(line.at(way), 0.0, atol=1e-12)
    np.testing.assert_allclose(line.at(way[:3] + 40 + 95 + 17.5), 3.5)
    assert cell.manoeuvre.judge(log, cell.nominal).passed


def test_a_lane_change_keeps_within_the_grip_and_passes_the_threshold(log):
    # Half a cosine over 95 m at 120 km/h: 3.5/2 (pi v/95)^2 = 2.1 m/s2, above the estimator's 1.5, below 0.35 g
    assert 1.8 < np.abs(log.truth[:, p.AY]).max() < 2.3


def test_a_lane_change_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="a double lane change of 265 m needs more than 9 s"):
        MANOEUVRES.make("triple_lane_change", speed=20.0)
