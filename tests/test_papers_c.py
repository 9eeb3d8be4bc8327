"""What system C's experiment takes from the plant's tyres, and what it tells whom."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from vse_gym.estimators.fuzzy_adaptive import FuzzyAdaptiveKalmanFilter
from vse_gym.physics import parameters as p
from vse_gym.sensors import stream
from vse_gym.simulation import rollout
from vse_gym.types import Y_AY

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
drives = import_module("papers_c_drive")
tables = import_module("papers_c_noise")


@pytest.fixture(scope="module")
def slalom():
    return rollout(drives.drive(0), "truth", "none", 0)


def test_linear_tyres_have_their_whole_stiffness_at_every_slip():
    log = rollout(drives.drive(0, linear=True), "truth", "none", 0)
    # tan(alpha) over alpha, and each wheel's own place: second order in slips below 5 deg
    np.testing.assert_allclose(drives.secant(log), 1.0, rtol=5e-3)


def test_the_plants_tyres_have_a_sixth_less_than_their_slope_at_zero(slalom):
    assert np.all((drives.secant(slalom) > 0.75) & (drives.secant(slalom) < 0.95))


def test_who_is_told_other_stiffnesses_believes_them_and_nothing_else():
    nominal, rng = drives.drive(0).nominal, stream(0, "estimator")
    inner = FuzzyAdaptiveKalmanFilter()
    plain, other = (e.init(nominal, rng).model.car for e in (inner, drives.WithStiffness(inner, (0.8, 0.9))))
    assert other.stiffness_front == pytest.approx(0.8 * plain.stiffness_front)
    assert other.stiffness_rear == pytest.approx(0.9 * plain.stiffness_rear)
    assert other.mass == plain.mass and other.yaw_inertia == plain.yaw_inertia


def test_noise_in_the_regressor_alone_makes_the_car_light_as_theory_has_it(slalom):
    ay = slalom.truth[:, p.AY]
    exact, noisy = slalom.readings.copy(), slalom.readings.copy()
    exact[:, Y_AY] = ay
    assert tables._mass_of_exact_forces(slalom._replace(readings=exact), 0.998) == pytest.approx(drives.TRUE_MASS)
    sigma = 2.0
    noisy[:, Y_AY] = ay + sigma * np.random.default_rng(0).standard_normal(len(ay))
    turning = (slalom.time > 2) & (slalom.time < 8)
    found = tables._mass_of_exact_forces(_part(slalom._replace(readings=noisy), turning), 1.0)
    # Errors in variables: m S/(S + sigma^2), S the mean square of ay; its sampling error in 600 readings is 3 %
    size = np.mean(ay[turning] ** 2)
    assert found == pytest.approx(drives.TRUE_MASS * size / (size + sigma**2), rel=0.1)


def _part(log, rows):
    return log._replace(time=log.time[rows], truth=log.truth[rows], readings=log.readings[rows])
