"""How a study draws its cells: alike for everybody, within what is written, and told to nobody."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vse_gym.evaluation import Cell, Randomise
from vse_gym.physics import parameters as p
from vse_gym.sensors import stream
from vse_gym.vehicles import load

RANDOM = Randomise(speed=1.0, steer=0.1, friction=0.03, mass=(1.0, 1.25), stiffness=(0.75, 1.0))
CELL = Cell("short", "sine_with_dwell", settings={"speed_kmh": 80, "amplitude_deg": 120, "friction": 0.5})


def test_a_cell_is_drawn_anew_for_each_seed_and_alike_for_everybody():
    first, again, other = (CELL.scenario(RANDOM, seed) for seed in (0, 0, 1))
    assert first == again
    assert first.vehicle != other.vehicle and first.manoeuvre != other.manoeuvre
    assert first.nominal == other.nominal  # what is told does not depend on the draw
    assert first.nominal.vehicle != first.vehicle


def test_draws_stay_within_what_is_written():
    drawn = [CELL.scenario(RANDOM, seed) for seed in range(200)]
    told = drawn[0].nominal.vehicle
    mass = np.array([s.vehicle.mass for s in drawn]) / told.mass
    stiffness = (
        np.array([s.vehicle.front_tyre.cornering_stiffness for s in drawn]) / told.front_tyre.cornering_stiffness
    )
    steer = np.degrees([s.manoeuvre.amplitude for s in drawn])
    assert mass.min() >= 1 and mass.max() <= 1.25 and np.ptp(mass) > 0.2
    assert stiffness.min() >= 0.75 and stiffness.max() <= 1 and np.ptp(stiffness) > 0.2
    assert np.abs(steer).min() >= 108 - 1e-9 and np.abs(steer).max() <= 132 + 1e-9
    assert np.all(np.sign(steer[1:]) == -np.sign(steer[:-1]))  # to each side in turn


def test_which_side_goes_first_differs_between_cells():
    first = [replace(CELL, name=f"cell {k}").scenario(RANDOM, 0).manoeuvre.amplitude for k in range(40)]
    assert 5 < np.sum(np.array(first) > 0) < 35  # a fair coin: five standard deviations of 3.2


CONDITIONS = replace(RANDOM, steering_offset=0.01, radius_error=0.02, slope=0.03, bank=0.04, gravity_shift=0.15)


def test_conditions_of_the_truth_are_drawn_within_what_is_written_and_told_to_nobody():
    drawn = [CELL.scenario(CONDITIONS, seed) for seed in range(200)]
    for values, most in (
        ([s.vehicle.steering_offset for s in drawn], 0.01),
        ([s.manoeuvre.slope for s in drawn], 0.03),
        ([s.manoeuvre.bank for s in drawn], 0.04),
        *(([s.vehicle.radius_error[i] for s in drawn], 0.02) for i in range(4)),
        ([s.vehicle.lf - s.nominal.vehicle.lf for s in drawn], 0.15),
    ):
        assert 0.95 * most < np.max(values) <= most and -most <= np.min(values) < -0.95 * most
    wheels = np.array([s.vehicle.radius_error for s in drawn])
    correlation = np.corrcoef(wheels.T) - np.eye(4)
    assert np.abs(correlation).max() < 0.35  # each wheel by itself: five standard deviations of 0.07
    for s in drawn:
        told = s.nominal.vehicle
        assert told.steering_offset == 0 and told.radius_error == p.PerWheel()
        assert s.vehicle.wheelbase == pytest.approx(told.wheelbase, abs=1e-12)
        road = s.road
        assert road.slope.tolist() == [s.manoeuvre.slope] and road.bank.tolist() == [s.manoeuvre.bank]


def test_conditions_leave_what_was_drawn_without_them_as_it_was():
    for seed in range(20):
        drawn = CELL.scenario(CONDITIONS, seed)
        draw = stream(seed, "cell/short")
        speed, steer, friction = draw.uniform(-1.0, 1.0), draw.uniform(-0.1, 0.1), draw.uniform(-0.03, 0.03)
        mass, stiffness = draw.uniform(1.0, 1.25), draw.uniform(0.75, 1.0)
        side = math.copysign(1.0, drawn.manoeuvre.amplitude)
        assert drawn.manoeuvre.speed == 80 / 3.6 + speed
        assert drawn.manoeuvre.friction == 0.5 + friction
        assert drawn.manoeuvre.amplitude == pytest.approx(np.radians(120) * side * (1 + steer), rel=1e-12)
        assert drawn.vehicle.mass == drawn.nominal.vehicle.mass * mass
        told = drawn.nominal.vehicle.rear_tyre.cornering_stiffness
        assert drawn.vehicle.rear_tyre.cornering_stiffness == told * stiffness


def test_each_condition_leaves_the_others_draws_as_they_were():
    for seed in range(20):
        with_all = CELL.scenario(CONDITIONS, seed).vehicle
        without_shift = CELL.scenario(replace(CONDITIONS, gravity_shift=0.0), seed).vehicle
        assert without_shift.lf == load(CELL.vehicle).lf
        assert with_all._replace(lf=without_shift.lf, lr=without_shift.lr) == without_shift


def test_a_centre_of_gravity_further_back_makes_the_car_oversteer_more():
    """K = m (lr Cr - lf Cf)/(l Cf Cr): its slope over the shift is -m (Cf + Cr)/(l Cf Cr), whatever else is drawn."""
    for seed in range(20):
        moved = CELL.scenario(CONDITIONS, seed)
        car, told = moved.vehicle, moved.nominal.vehicle
        front, rear = (2 * tyre.cornering_stiffness for tyre in (car.front_tyre, car.rear_tyre))
        slope = -car.mass * (front + rear) / (told.wheelbase * front * rear)
        middle = car._replace(lf=told.lf, lr=told.lr).understeer_gradient
        assert car.understeer_gradient - middle == pytest.approx(slope * (car.lf - told.lf), rel=1e-9)


def test_a_cell_s_own_ranges_take_the_place_of_the_study_s_and_leave_the_rest():
    own = replace(CELL, randomise={"bank_deg": 3.0, "mass": [0.8, 1.2]})
    drawn = [own.scenario(RANDOM, seed) for seed in range(200)]
    mass = np.array([s.vehicle.mass for s in drawn]) / load(CELL.vehicle).mass
    bank = np.degrees([s.manoeuvre.bank for s in drawn])
    assert 0.8 <= mass.min() < 0.82 and 1.18 < mass.max() <= 1.2
    assert 2.9 < np.abs(bank).max() <= 3.0
    for seed, scenario in enumerate(drawn[:20]):
        studys = CELL.scenario(RANDOM, seed)
        assert scenario.manoeuvre.friction == studys.manoeuvre.friction
        assert scenario.vehicle.rear_tyre == studys.vehicle.rear_tyre


def test_a_range_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(TypeError, match=r"cannot randomise tilt_deg; known: speed, .*gravity_shift"):
        replace(CELL, randomise={"tilt_deg": 3.0})


def test_a_load_rides_on_the_springs_of_a_car_that_rolls():
    cell = Cell("rolling", "sine_with_dwell", vehicle="wei2019_roll")
    car = load("wei2019_roll")
    driven = cell.scenario(Randomise(mass=(1.2, 1.2)), 0).vehicle
    assert driven.mass - car.mass == pytest.approx(0.2 * car.mass)
    assert driven.body.sprung_mass - car.body.sprung_mass == pytest.approx(0.2 * car.mass)
