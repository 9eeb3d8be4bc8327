"""Scores of parameters against drives in which they are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vse_gym import metrics_found
from vse_gym.metrics_found import NAMES, found, sheet_value, true_value
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.scenarios import Scenario, scenario
from vse_gym.sensors import QUIET
from vse_gym.simulation import rollout
from vse_gym.types import FOUND
from vse_gym.vehicles import load

CAR = load("qin2014_understeer")
LINEAR = CAR._replace(
    front_tyre=p.LinearTyre(120e3, CAR.front_tyre.cornering_stiffness),
    rear_tyre=p.LinearTyre(120e3, CAR.rear_tyre.cornering_stiffness),
)


def drive(car=CAR, **settings):
    return rollout(scenario("sine_steer", car, "clean", **settings), "truth", "none", seed=0)


def believed(log, **values):
    """As FOUND, (T, 12), of fields that an estimator gives."""
    return np.column_stack([values.get(name, math.nan) + np.zeros(len(log.time)) for name in FOUND])


NOMINAL = Nominal(CAR, QUIET, 20.0)


def test_the_stiffness_of_an_axle_with_linear_tyres_is_that_of_its_two_tyres():
    log = drive(LINEAR, amplitude=math.radians(30))
    for name in ("stiffness_front", "stiffness_rear"):
        true = true_value(log, name)
        known = ~np.isnan(true)
        assert known.sum() > 100
        # tan(alpha) of each wheel's own place for the axle's angle: second order in a slip below 1.5 deg
        np.testing.assert_allclose(true[known], sheet_value(NOMINAL, name), rtol=2e-3)


def test_a_crooked_steering_does_not_change_the_stiffness_of_linear_tyres():
    true = true_value(drive(LINEAR._replace(steering_offset=0.01), amplitude=math.radians(30)), "stiffness_front")
    np.testing.assert_allclose(true[~np.isnan(true)], sheet_value(NOMINAL, "stiffness_front"), rtol=2e-3)


def test_a_softening_tyre_has_less_stiffness_than_on_its_sheet_and_less_still_on_ice():
    dry, wet = (true_value(drive(friction=mu, amplitude=math.radians(30)), "stiffness_front") for mu in (0.9, 0.4))
    sheet = sheet_value(NOMINAL, "stiffness_front")
    assert 0.5 * sheet < np.nanmin(wet) < np.nanmin(dry) < sheet


def test_stiffness_and_mass_are_unknown_where_another_plant_or_nobody_knows_moved_the_car():
    log = drive()
    assert np.isnan(true_value(log, "stiffness_rear", tyres_known=False)).all()
    assert np.isnan(true_value(log._replace(vehicle=None), "mass")).all()
    assert (true_value(log, "mass", tyres_known=False) == CAR.mass).all()


def test_a_constant_error_is_its_own_score():
    heavy = CAR._replace(mass=CAR.mass + 100)
    setting = scenario("sine_steer", CAR, "clean")
    log = rollout(Scenario(setting.manoeuvre, heavy, setting.sensors, setting.nominal), "truth", "none", seed=0)
    scores = found(log, believed(log, mass=heavy.mass - 30, mass_std=20, friction=0.5, roll=math.radians(2)), NOMINAL)
    assert scores["mass_rmse_kg"] == pytest.approx(30) and scores["mass_final_kg"] == pytest.approx(-30)
    assert scores["mass_sheet_rmse_kg"] == pytest.approx(100)
    assert scores["mass_coverage_percent"] == 100
    assert scores["friction_rmse_abs"] == pytest.approx(0.4)
    assert scores["roll_rmse_deg"] == pytest.approx(2)
    assert math.isnan(scores["friction_coverage_percent"])
    assert math.isnan(scores["stiffness_front_rmse_percent"])


def test_the_band_covers_only_where_it_is_wide_enough():
    log = drive()
    narrow = found(log, believed(log, mass=CAR.mass + 50, mass_std=25), NOMINAL)
    assert narrow["mass_coverage_percent"] == 0
    assert found(log, believed(log, mass=CAR.mass + 50, mass_std=26), NOMINAL)["mass_coverage_percent"] == 100


def test_the_sheet_is_compared_where_the_truth_is_defined():
    log = drive(LINEAR, amplitude=math.radians(30))
    sheet = replace(NOMINAL, vehicle=LINEAR)
    half = 0.5 * sheet_value(sheet, "stiffness_front")
    scores = found(log, believed(log, stiffness_front=half), sheet)
    assert scores["stiffness_front_rmse_percent"] == pytest.approx(50, rel=3e-3)
    assert scores["stiffness_front_sheet_rmse_percent"] < 0.3


def test_every_name_has_a_scale_and_a_standard_deviation():
    assert set(metrics_found.SCALES) == set(NAMES)
    assert (*NAMES, *(f"{name}_std" for name in NAMES)) == FOUND
