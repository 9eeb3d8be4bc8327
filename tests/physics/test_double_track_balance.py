"""What the plant conserves: energy, the symmetry of left and right, a straight line; and how wheels carry the car."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    CONTACT,
    COS,
    FX,
    FY,
    MZ,
    RADIUS,
    SIN,
    advance,
    contact,
    rolling_start,
    wheel_load,
    wheel_position,
    wheel_velocity,
)
from vse_gym.physics.reference import advance_reference
from vse_gym.vehicles import load, names

CARS = names()
RIGID = [car for car in CARS if isinstance(load(car).body, p.RigidBody)]  # the others' energy: test_roll.py
NOTHING = np.zeros(4)
KMH = 1 / 3.6
MIRRORED = [1, 0, 3, 2]  # wheel order: front left, front right, rear left, rear right
every_car = pytest.mark.parametrize("car", CARS)
every_integrator = pytest.mark.parametrize("integrator", [advance, advance_reference], ids=lambda f: f.__name__)
# One car of each kind of tyre, where a drive takes long.
TYRES = {(type(load(car).front_tyre), getattr(load(car).front_tyre, "reference_load", 0.0) > 0): car for car in RIGID}
every_tyre = pytest.mark.parametrize("car", TYRES.values())


def evaluate(vehicle, road, state, steer=0.0):
    wheels = np.empty((4, CONTACT))
    contact(vehicle, road, state, steer, wheels)
    return wheels


def kinetic_energy(vehicle, x):
    translation = 0.5 * vehicle.mass * (x[p.VX] ** 2 + x[p.VY] ** 2)
    return (
        translation
        + 0.5 * vehicle.yaw_inertia * x[p.YAW_RATE] ** 2
        + 0.5 * vehicle.wheel_inertia * np.sum(x[p.WHEEL_SPEEDS] ** 2)
    )


def tyre_power(vehicle, road, x, steer):
    """What the four contacts turn into heat: force times the velocity at which the tread slides [W]."""
    wheels, power = evaluate(vehicle, road, x, steer), 0.0
    for i in range(4):
        along, across = wheel_velocity(vehicle, i, x[p.VX], x[p.VY], x[p.YAW_RATE], steer)
        slip_velocity = wheels[i, RADIUS] * x[p.WHEEL + i] - along
        power += wheels[i, FX] * slip_velocity - wheels[i, FY] * across - wheels[i, MZ] * x[p.YAW_RATE]
    return power


def violent(k):
    """Inputs of the k-th 10 ms: 12 deg of steer at 0.7 Hz, a launch, one side braked, then all wheels locked."""
    time = 0.01 * k
    steer = math.radians(12) * math.sin(2 * math.pi * 0.7 * time)
    drive = np.array([400.0, 400.0, 0.0, 0.0]) if time < 1 else NOTHING
    if 1.5 < time < 2:
        return p.Inputs(steer, drive, np.array([1500.0, 0.0, 400.0, 0.0]))
    if 2.8 < time < 3.2:
        return p.Inputs(steer, drive, np.array([2500.0, 2500.0, 1200.0, 1200.0]))
    return p.Inputs(steer, drive, NOTHING)


@cache
def energy_imbalance(car, integrator, per_control_step, radius_error=(0.0, 0.0, 0.0, 0.0)):
    """Change of kinetic energy less what came in and went out in 4 violent seconds, over what went out [-]."""
    vehicle, road, h = (
        load(car)._replace(radius_error=p.PerWheel(*radius_error)),
        p.road((0.0, 0.9)),
        0.01 / per_control_step,
    )
    x = rolling_start(vehicle, 80 * KMH)
    before, driven, rubbed = kinetic_energy(vehicle, x), 0.0, 0.0
    for k in range(400):
        inputs = violent(k)
        for _ in range(per_control_step):
            y = integrator(vehicle, road, x, inputs, 1, h)
            rubbed += h / 2 * (tyre_power(vehicle, road, x, inputs.steer) + tyre_power(vehicle, road, y, inputs.steer))
            driven += h / 2 * inputs.drive @ (x[p.WHEEL_SPEEDS] + y[p.WHEEL_SPEEDS])
            x = y
    gone = rubbed + x[p.BRAKE_WORK]
    assert rubbed > 50e3  # J: it was violent
    assert x[p.BRAKE_WORK] > 20e3
    return (kinetic_energy(vehicle, x) - before - driven + gone) / gone


@every_tyre
def test_keeps_account_of_energy(car):
    # All is smooth but where a wheel locks or lets go: there the trapezium errs by half a step of the jump in power,
    # 0.5 ms of some 20 kW, of 200 kJ: 5e-5.
    assert abs(energy_imbalance(car, advance_reference, 10)) < 1e-4


@every_tyre
def test_keeps_account_of_energy_on_unlike_wheels(car):
    assert abs(energy_imbalance(car, advance_reference, 10, (0.05, -0.03, 0.0, 0.02))) < 1e-4


@every_tyre
def test_the_semi_implicit_step_loses_energy_in_proportion_to_its_length(car):
    # First order: the force at the end of a step acts on the mean of two speeds, wrong by h dF/2 or 1e-3 at 1 ms.
    coarse, fine = energy_imbalance(car, advance, 10), energy_imbalance(car, advance, 20)
    assert abs(coarse) < 2e-3
    assert 1.7 < coarse / fine < 2.3


def mirror(state):
    """The same car in a mirror."""
    out = state.copy()
    for k in (p.Y, p.YAW, p.VY, p.YAW_RATE, p.LOAD_AY, p.AY, p.ROLL, p.ROLL_RATE):
        out[k] = -state[k]
    for first in (p.WHEEL, p.LAG_X, p.LAG_Y):
        out[first : first + 4] = state[first : first + 4][MIRRORED]
    out[p.LAG_Y : p.LAG_Y + 4] *= -1
    return out


@every_car
@every_integrator
def test_a_mirrored_driver_gets_the_mirrored_drive(car, integrator):
    vehicle, road = load(car), p.road((0.0, 0.9))
    left = right = rolling_start(vehicle, 80 * KMH)
    for k in range(400):
        steer, drive, brake = violent(k)
        left = integrator(vehicle, road, left, p.Inputs(steer, drive, brake), 10, 1e-3)
        right = integrator(vehicle, road, right, p.Inputs(-steer, drive[MIRRORED], brake[MIRRORED]), 10, 1e-3)
        # Sums over wheels run in another order: rounding of 1e-16 a step, carried on for 4000 steps.
        np.testing.assert_allclose(mirror(right), left, rtol=0, atol=1e-9 * max(1.0, np.abs(left).max()))


@every_car
@every_integrator
def test_a_split_road_seen_in_a_mirror_has_its_sides_exchanged(car, integrator):
    vehicle, here = load(car), p.road((0.0, 0.9))
    split = here._replace(friction_right=np.array([0.4]))
    swapped = here._replace(friction_left=np.array([0.4]))
    brake, start = np.full(4, 400.0), rolling_start(vehicle, 20.0)
    one = integrator(vehicle, split, start, p.Inputs(0.02, NOTHING, brake), 500, 1e-3)
    other = integrator(vehicle, swapped, start, p.Inputs(-0.02, NOTHING, brake), 500, 1e-3)
    np.testing.assert_allclose(mirror(other), one, rtol=0, atol=1e-9 * np.abs(one).max())


@every_car
@every_integrator
def test_a_coasting_straight_car_stays_straight_exactly(car, integrator):
    vehicle = load(car)
    inputs = p.Inputs(0.0, NOTHING, NOTHING)
    state = integrator(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, 20.0), inputs, 5000, 1e-3)
    assert not np.any(state[[p.Y, p.YAW, p.VY, p.YAW_RATE]])
    assert state[p.VX] == pytest.approx(20.0, rel=1e-12)  # nothing resists; R (v/R) is v but for rounding
    assert state[p.X] == pytest.approx(100.0, rel=1e-9)
    assert state[p.DISTANCE] == pytest.approx(state[p.X], rel=1e-9)


def test_wheels_stand_front_left_front_right_rear_left_rear_right():
    vehicle = load("qin2014")
    signs = [tuple(np.sign(wheel_position(vehicle, i))) for i in range(4)]
    assert signs == [(1, 1), (1, -1), (-1, 1), (-1, -1)]


@settings(deadline=None)  # the first example may have to compile a kernel
@given(st.floats(-12, 12), st.floats(-20, 20), st.sampled_from(CARS))
def test_wheels_never_pull_on_the_road_and_carry_the_car(ax, ay, car):
    vehicle = load(car)
    loads = np.array([wheel_load(vehicle, i, ax, ay, p.GRAVITY) for i in range(4)])
    assert np.all(loads >= 0)
    if np.all(loads > 0):
        x, y = np.array([wheel_position(vehicle, i) for i in range(4)]).T
        weight = vehicle.mass * p.GRAVITY
        # Newton and Euler: the loads carry the weight and balance the moments of the forces at the road.
        assert loads.sum() == pytest.approx(weight, rel=1e-12)
        assert loads @ x == pytest.approx(-vehicle.mass * ax * vehicle.height, abs=1e-9 * weight)
        assert loads @ y == pytest.approx(-vehicle.mass * ay * vehicle.height, abs=1e-9 * weight)


@every_car
def test_the_front_axle_takes_its_share_of_the_lateral_transfer(car):
    vehicle = load(car)
    still, turning = (np.array([wheel_load(vehicle, i, 0.0, ay, p.GRAVITY) for i in range(4)]) for ay in (0.0, 2.0))
    moments = (turning - still)[1::2] * [vehicle.track_front, vehicle.track_rear]  # right wheels of each axle
    assert moments[0] / moments.sum() == pytest.approx(vehicle.front_transfer, rel=1e-9)


@every_car
def test_only_the_front_wheels_steer(car):
    vehicle = load(car)
    wheels = evaluate(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, 20.0), steer=0.02)
    np.testing.assert_allclose(wheels[:, COS], [math.cos(0.02)] * 2 + [1.0] * 2, rtol=1e-15)
    np.testing.assert_allclose(wheels[:, SIN], [math.sin(0.02)] * 2 + [0.0] * 2, rtol=1e-15)
    assert np.all(wheels[:2, FY] > 0)  # steering left pushes left
