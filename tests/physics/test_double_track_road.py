"""What the road does to the car: slope, bank, and friction that changes along and across it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    CONTACT,
    FX,
    FY,
    LOAD,
    advance,
    contact,
    road_friction,
    rolling_start,
)
from vse_gym.physics.tyres import tyre_force
from vse_gym.vehicles import load, names

CARS = names()
NOTHING = np.zeros(4)
every_car = pytest.mark.parametrize("car", CARS)


def effective_mass(vehicle):
    """Mass and the four wheels' inertia, as rolling feels them [kg]."""
    return vehicle.mass + 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2


def evaluate(vehicle, road, state, steer=0.0):
    wheels = np.empty((4, CONTACT))
    contact(vehicle, road, state, steer, wheels)
    return wheels


def coast(vehicle, road, state, seconds, steer=0.0, drive=NOTHING, brake=NOTHING):
    return advance(vehicle, road, state, p.Inputs(steer, drive, brake), round(1000 * seconds), 1e-3)


@settings(deadline=None)  # the first example may have to compile a kernel
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_wheels_press_with_the_weight_across_the_road(slope, bank):
    vehicle = load("qin2014")
    wheels = evaluate(vehicle, p.road((0.0, 0.9), slope=slope, bank=bank), rolling_start(vehicle, 10.0))
    weight = vehicle.mass * p.GRAVITY * math.cos(slope) * math.cos(bank)
    assert wheels[:, LOAD].sum() == pytest.approx(weight, rel=1e-12)


@every_car
def test_a_bank_pulls_to_the_lower_side(car):
    vehicle, bank = load(car), 0.05  # left side higher
    road = p.road((0.0, 0.9), bank=bank)
    first = coast(vehicle, road, rolling_start(vehicle, 20.0), 0.001)
    assert first[p.VY] == pytest.approx(-1e-3 * p.GRAVITY * math.sin(bank), rel=1e-9)
    later = coast(vehicle, road, rolling_start(vehicle, 20.0), 1.0)
    assert later[p.Y] < -0.03  # to the right


@every_car
@pytest.mark.parametrize("slope", [0.05, -0.05])
def test_a_slope_slows_a_coasting_car_and_its_wheels(car, slope):
    # The free wheels are held back through their tyres, with a slip of 1 to 2e-4: so much they differ from one mass.
    vehicle = load(car)
    state = coast(vehicle, p.road((0.0, 0.9), slope=slope), rolling_start(vehicle, 20.0), 2.0)
    fall = -p.GRAVITY * math.sin(slope) * vehicle.mass / effective_mass(vehicle)
    assert state[p.VX] - 20.0 == pytest.approx(2.0 * fall, rel=2e-4)


def grip(tyre, friction):
    """Force of a locked wheel that slides straight on, over its load."""
    return -tyre_force(tyre, -1.0, 0.0, 4000.0, friction)[0] / 4000


def grip_under(vehicle, road, distance):
    """What each locked wheel of a sliding car finds, (4,)."""
    state = rolling_start(vehicle, 20.0)
    state[p.WHEEL_SPEEDS], state[p.DISTANCE] = 0.0, distance
    wheels = evaluate(vehicle, road, state)
    return np.hypot(wheels[:, FX], wheels[:, FY]) / wheels[:, LOAD]


@every_car
def test_friction_changes_at_the_front_wheels_first(car):
    vehicle, road = load(car), p.road((0.0, 0.9), (50.0, 0.3))
    for distance, front, rear in (
        (50 - vehicle.lf - 1e-6, 0.9, 0.9),
        (50 - vehicle.lf + 1e-6, 0.3, 0.9),
        (50 + vehicle.lr - 1e-6, 0.3, 0.9),
        (50 + vehicle.lr + 1e-6, 0.3, 0.3),
    ):
        expected = np.repeat([grip(vehicle.front_tyre, front), grip(vehicle.rear_tyre, rear)], 2)
        np.testing.assert_allclose(grip_under(vehicle, road, distance), expected, rtol=1e-9)
        assert road_friction(vehicle, road, distance) == pytest.approx((front + rear) / 2, rel=1e-12)


@every_car
def test_each_side_has_its_own_friction(car):
    vehicle = load(car)
    road = p.road((0.0, 0.9))._replace(friction_right=np.array([0.2]))
    expected = [grip(tyre, friction) for tyre in (vehicle.front_tyre, vehicle.rear_tyre) for friction in (0.9, 0.2)]
    np.testing.assert_allclose(grip_under(vehicle, road, 0.0), expected, rtol=1e-9)
    braked = coast(vehicle, road, rolling_start(vehicle, 20.0), 0.3, brake=np.full(4, 8000.0))
    assert braked[p.YAW_RATE] > 0  # towards the side that grips
