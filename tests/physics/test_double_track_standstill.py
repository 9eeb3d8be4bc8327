"""Launching, braking, locked and sliding wheels, and a car at rest."""

import math

import numpy as np
import pytest

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    SPEED_FLOOR,
    advance,
    rolling_start,
    wheel_position,
)
from vse_gym.physics.tyres import PLATEAU, tyre_force
from vse_gym.vehicles import load, names

CARS = names()
RIGID = [car for car in CARS if isinstance(load(car).body, p.RigidBody)]  # a body that swings on: test_roll.py
NOTHING = np.zeros(4)
every_car = pytest.mark.parametrize("car", CARS)


def effective_mass(vehicle):
    """Mass and the four wheels' inertia, as rolling feels them [kg]."""
    return vehicle.mass + 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2


def coast(vehicle, road, state, seconds, steer=0.0, drive=NOTHING, brake=NOTHING):
    return advance(vehicle, road, state, p.Inputs(steer, drive, brake), round(1000 * seconds), 1e-3)


def watch(vehicle, road, state, inputs, steps):
    """The states of a drive under constant inputs, one a millisecond, (steps + 1, STATE_SIZE)."""
    states = [state]
    for _ in range(steps):
        states.append(advance(vehicle, road, states[-1], inputs, 1, 1e-3))
    return np.array(states)


@every_car
def test_a_braked_car_creeps_down_a_slope_without_chatter(car):
    # At rest slip is taken relative to v0 = 0.5 m/s: four tyres of slip stiffness Cs are dampers of 4 Cs/v0, which the
    # weight along the slope pulls at m g sin. The tyres soften by 0.0668 u + 0.1032 u^2, u = sin/mu = 0.11: 0.9 %, or
    # as much by their own formula.
    vehicle, slope = load(car), math.atan(0.10)
    damping = 2 * (vehicle.front_tyre.slip_stiffness + vehicle.rear_tyre.slip_stiffness) / SPEED_FLOOR
    creep = vehicle.mass * p.GRAVITY * math.sin(slope) / damping
    for uphill in (1, -1):
        road = p.road((0.0, 0.9), slope=uphill * slope)
        inputs = p.Inputs(0.0, NOTHING, np.full(4, 1500.0))
        states = watch(vehicle, road, np.zeros(p.STATE_SIZE), inputs, 2000)
        speed = -uphill * states[:, p.VX]
        assert speed[-1] == pytest.approx(creep, rel=0.015)
        assert np.all(np.diff(speed) > -1e-7)  # the load transfer settles and moves it by some 10 nm/s
        assert np.ptp(speed[1000:]) < 1e-9
        assert not np.any(states[:, p.WHEEL_SPEEDS])
        # An accelerometer feels the tyres that hold the car, not gravity.
        assert states[-1, p.AX] == pytest.approx(uphill * p.GRAVITY * math.sin(slope), rel=1e-6)


@pytest.mark.parametrize("car", RIGID)
@pytest.mark.parametrize("steer", [0.0, 0.1])
@pytest.mark.parametrize("torque", [200.0, 800.0, 3000.0])
def test_a_car_braked_to_standstill_stays_there(car, steer, torque):
    vehicle, road = load(car), p.road((0.0, 0.9))
    states = watch(vehicle, road, rolling_start(vehicle, 5.0), p.Inputs(steer, NOTHING, np.full(4, torque)), 4000)
    at_rest = states[np.argmax(states[:, p.VX] < 1e-3) + 200 :]
    assert len(at_rest) > 300
    assert np.all(states[:, p.VX] >= -1e-8)  # it does not roll back: turning, it comes to rest sideways, by some nm/s
    assert np.all(states[:, p.WHEEL_SPEEDS] >= 0)
    # What is left decays with 4 C/(v0 m), sideways at 180 1/s or more: 1e-3 m/s becomes 2e-19 in 0.2 s.
    assert np.abs(at_rest[:, [p.VX, p.VY, p.YAW_RATE]]).max() < 1e-12
    assert not np.any(at_rest[:, p.WHEEL_SPEEDS])


@every_car
@pytest.mark.parametrize("drive", [(300.0, 300.0, 0.0, 0.0), (0.0, 0.0, 300.0, 300.0), (150.0, 150.0, 150.0, 150.0)])
def test_a_launch_gains_the_speed_that_the_torque_gives(car, drive):
    # Wheels and car together are one mass while slip is small, here up to 1.5 %; a driven wheel turns that much faster,
    # and the driven wheels are 2 to 3 % of the inertia: up to 0.04 %.
    vehicle = load(car)
    state = coast(vehicle, p.road((0.0, 0.9)), np.zeros(p.STATE_SIZE), 3.0, drive=np.array(drive))
    gained = 3.0 * sum(drive) / vehicle.wheel_radius / effective_mass(vehicle)
    assert state[p.VX] == pytest.approx(gained, rel=6e-4)
    assert gained > 3


def sliding_deceleration(vehicle, friction):
    """Of a car whose wheels all slide straight on [m/s2]: a l (m) = sum of each axle's grip times its load under a."""
    front, rear = (
        -tyre_force(tyre, -1.0, 0.0, 4000.0, friction)[0] / 4000 for tyre in (vehicle.front_tyre, vehicle.rear_tyre)
    )
    arms = vehicle.wheelbase - (front - rear) * vehicle.height
    return p.GRAVITY * (front * vehicle.lr + rear * vehicle.lf) / arms


@every_car
@pytest.mark.parametrize("friction", [0.9, 0.3])
def test_locked_wheels_slow_the_car_as_they_slide(car, friction):
    vehicle, road = load(car), p.road((0.0, friction))
    brake = np.full(4, 8000.0)
    sliding = coast(vehicle, road, rolling_start(vehicle, 20.0), 1.0, brake=brake)
    later = coast(vehicle, road, sliding, 0.5, brake=brake)
    assert not np.any(sliding[p.WHEEL_SPEEDS])
    expected = sliding_deceleration(vehicle, friction)
    assert sliding[p.VX] - later[p.VX] == pytest.approx(0.5 * expected, rel=1e-9)
    assert later[p.AX] == pytest.approx(-expected, rel=1e-9)
    if isinstance(vehicle.front_tyre, p.PolynomialTyre):  # at its plateau, however the load is shared
        assert expected == pytest.approx(PLATEAU * friction * p.GRAVITY, rel=1e-9)


@every_car
def test_locked_wheels_hold_the_car_on_stiffer_tyres_too(car):
    # Four tyres of Cs/v0 on one car: a step of 1 ms that left the car's own speed out would diverge here, because
    # 4 Cs h/(v0 m) = 2.5 > 2.
    vehicle = load(car)
    front, rear = (
        tyre._replace(slip_stiffness=0.5 * 2.5 * vehicle.mass / 4 / 1e-3)
        for tyre in (vehicle.front_tyre, vehicle.rear_tyre)
    )
    stiff = vehicle._replace(front_tyre=front, rear_tyre=rear)
    inputs = p.Inputs(0.0, NOTHING, np.full(4, 3000.0))
    speed = watch(stiff, p.road((0.0, 0.9)), rolling_start(stiff, 5.0), inputs, 1500)[:, p.VX]
    assert np.all(speed >= -np.finfo(float).tiny)  # below the least normal number all is rounding
    assert np.all(np.diff(speed) <= 0)
    assert speed[-1] < 1e-12


@every_car
@pytest.mark.parametrize(
    ("speed", "rim"), [(0.1, 0.0), (1.0, 0.0), (2.0, 0.0), (20.0, 0.0), (0.0, 5.0), (2.0, 10.0), (20.0, 40.0)]
)
def test_wheels_that_slide_find_back_to_rolling(car, speed, rim):
    # No brake, no drive: friction stops the sliding and then there is none, while the momentum of car and wheels,
    # m v + 4 Iw w/R, is kept. At the plateau the rim gains some 0.3 m/s in a step of 1 ms, beyond the slow car's own
    # speed, so that a step that only knows the plateau turns the slip round for ever.
    vehicle = load(car)
    start = rolling_start(vehicle, speed)
    start[p.WHEEL_SPEEDS] = rim / vehicle.wheel_radius
    states = watch(vehicle, p.road((0.0, 0.9)), start, p.Inputs(0.0, NOTHING, NOTHING), 500)
    wheels = 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2
    rolls = (vehicle.mass * speed + wheels * rim) / (vehicle.mass + wheels)
    np.testing.assert_allclose(states[-1, p.WHEEL_SPEEDS] * vehicle.wheel_radius, rolls, rtol=1e-6)
    assert states[-1, p.VX] == pytest.approx(rolls, rel=1e-6)
    assert np.abs(states[-100:, p.AX]).max() < 1e-6


@every_car
@pytest.mark.parametrize("wheel", range(4))
def test_braking_a_wheel_turns_the_car_to_its_side_and_counts_the_heat(car, wheel):
    vehicle, road = load(car), p.road((0.0, 0.9))
    brake = np.zeros(4)
    brake[wheel] = 300.0
    states = watch(vehicle, road, rolling_start(vehicle, 20.0), p.Inputs(0.0, NOTHING, brake), 200)
    state = states[-1]
    assert np.sign(state[p.YAW_RATE]) == np.sign(wheel_position(vehicle, wheel)[1])
    # A wheel's speed is straight over a step, so that the trapezium is the work exactly.
    assert state[p.BRAKE_WORK] == pytest.approx(300 * np.trapezoid(states[:, p.WHEEL + wheel], dx=1e-3), rel=1e-9)
