"""The driver: stable with every car, honest about his limits, and alike to both sides."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.manoeuvres.driver import DRIVER, FASTEST, SLOWEST, Skill, Steering, _stepped, pedals, practised
from vse_gym.manoeuvres.path import STRAIGHT, Circle, Line
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.sensors import QUIET
from vse_gym.types import Car
from vse_gym.vehicles import load, names

DT = 0.01
KMH = 1 / 3.6
every_car = pytest.mark.parametrize("car", names())


def told(vehicle, speed=20.0, dt=DT):
    return Nominal(vehicle, QUIET, speed, dt=dt)


def looped(vehicle, speed, more_delay=0):
    """The linear car and the driver in one matrix, his delay some steps longer than he knows."""
    hands = DRIVER.init(told(vehicle))
    reach = hands.reach
    skill = Skill(tuple(reach.tolist()), DRIVER.calm, DRIVER.heading, DRIVER.lag, round(DRIVER.delay / DT), DT)
    gain = practised(vehicle, skill)[speed - SLOWEST]
    ahead, rest = gain[: reach.size], gain[reach.size :]
    longer, _ = _stepped(vehicle, skill._replace(delay=skill.delay + more_delay), float(speed))
    f = longer.copy()
    f[-1] = 0.0
    f[-1, :2] = -ahead.sum(), -(ahead * reach).sum() * speed  # offset and heading, as the line ahead shows them
    f[-1, 2:5] = rest[:3]
    f[-1, 5 + more_delay :] = rest[3:]
    return f


@every_car
@pytest.mark.parametrize("more_delay", [0, 3])
def test_no_car_sways_on_a_straight_road_at_any_speed_below_its_critical_one(car, more_delay):
    vehicle = load(car)
    for speed in range(5, 34):  # 18 to 119 km/h
        if speed < vehicle.critical_speed:
            radius = np.abs(np.linalg.eigvals(looped(vehicle, speed, more_delay))).max()
            assert radius < 1, f"{3.6 * speed:.0f} km/h"


def run(vehicle, path, speed, seconds, offset=0.0, yaw=0.0, driver=DRIVER):
    """The plant under the driver, speed held: states (T, STATE_SIZE) and hand-wheel angles (T,)."""
    hands, feet, state = driver.init(told(vehicle, speed)), pedals(vehicle), rolling_start(vehicle, speed)
    state[p.Y], state[p.YAW] = offset, yaw
    states, angles = [state], [0.0]
    for _ in range(round(seconds / DT)):
        hands = driver.steer(hands, path, Car(state))
        inputs = p.Inputs(hands.angle, feet.hold(speed, Car(state)), np.zeros(4))
        state = advance(vehicle, p.road((0.0, 0.9)), state, inputs, 10, 1e-3)
        states.append(state)
        angles.append(hands.angle * vehicle.steering_ratio)
    return np.array(states), np.array(angles)


@every_car
@pytest.mark.parametrize("kmh", [20, 50, 80, 95, 120])
def test_a_car_beside_its_lane_is_brought_back_and_stays(car, kmh):
    vehicle = load(car)
    speed = min(kmh * KMH, 0.95 * vehicle.critical_speed)
    states, _ = run(vehicle, STRAIGHT, speed, 10.0, offset=0.5)
    # The slowest pole of all cars and speeds is 0.995 a step: of 0.5 m, 3 mm would be left after 10 s.
    assert np.abs(states[-100:, p.Y]).max() < 0.02
    assert np.abs(states[:, p.Y]).max() < 0.6


@every_car
@pytest.mark.parametrize("radius", [100.0, -100.0])
def test_a_circle_is_kept_at_a_third_of_a_g(car, radius):
    # A change of the angle costs, the angle does not, so that a steady turn leaves the line only as the tyres soften.
    vehicle = load(car)
    states, _ = run(vehicle, Circle(radius), math.sqrt(3.3 * 100), 12.0)
    away = Circle(radius).stray(states[500:, p.X], states[500:, p.Y])
    assert np.abs(away).max() < 0.1


def test_the_line_is_followed_by_the_same_hands_to_either_side():
    vehicle = load("qin2014")
    swings = ((20.0, 50.0, 2.0),)
    left, _ = run(vehicle, Line(swings), 22.0, 4.0)
    right, _ = run(vehicle, Line(tuple((a, b, -c) for a, b, c in swings)), 22.0, 4.0)
    np.testing.assert_allclose(right[:, p.Y], -left[:, p.Y], atol=1e-9)  # rounding of loads, fed back


finite = st.floats(-1e12, 1e12)


@given(st.tuples(finite, finite, finite, finite, finite, finite), st.sampled_from([STRAIGHT, Circle(90.0, 20.0)]))
def test_hands_stay_within_their_reach_and_speed_whatever_the_car_does(values, path):
    vehicle = load("qin2014")
    state = np.zeros(p.STATE_SIZE)
    state[:6] = values
    hands, ratio = DRIVER.init(told(vehicle)), vehicle.steering_ratio
    last = 0.0
    for _ in range(30):
        hands = DRIVER.steer(hands, path, Car(state))
        assert abs(hands.angle - last) * ratio <= DRIVER.rate * DT * (1 + 1e-9)
        assert abs(hands.angle) * ratio <= DRIVER.limit * (1 + 1e-9)
        last = hands.angle


@pytest.mark.parametrize("dt", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2])
def test_hands_begin_to_move_when_the_delay_is_over(delay, dt):
    driver, vehicle = Steering(delay=delay), load("qin2014_understeer")
    hands, state = driver.init(told(vehicle, dt=dt)), rolling_start(vehicle, 20.0)
    state[p.Y] = 1.0
    moved = []
    for _ in range(round(0.4 / dt)):
        hands = driver.steer(hands, STRAIGHT, Car(state))
        moved.append(hands.angle != 0)
    # What he sees now he decides on now, and begins after the delay.
    assert moved.index(True) * dt == pytest.approx(delay + dt)


@given(st.floats(SLOWEST, FASTEST - 1e-6))
def test_gains_go_over_into_each_other_without_a_jump(speed):
    vehicle = load("qin2014_understeer")
    state = rolling_start(vehicle, speed)
    state[p.Y], state[p.VY], state[p.YAW_RATE] = 0.3, 0.2, 0.1
    wanted = []
    for v in (speed, speed + 1e-7):
        state[p.VX] = v
        wanted.append(DRIVER.steer(DRIVER.init(told(vehicle)), STRAIGHT, Car(state)).pending[-1])
    assert wanted[1] == pytest.approx(wanted[0], abs=1e-6)


@every_car
def test_pedals_give_the_acceleration_that_is_asked_for(car):
    vehicle = load(car)
    feet = pedals(vehicle)
    force = vehicle.mass * vehicle.wheel_radius
    assert feet.drive.sum() == pytest.approx(force) and feet.brake.sum() == pytest.approx(force)
    assert feet.drive[0] == feet.drive[1] and feet.drive[:2].sum() == pytest.approx(vehicle.front_drive * force)
    # At 0.8 g the brakes ask each axle for the same share of its load.
    front = (vehicle.lr + 0.8 * vehicle.height) / vehicle.wheelbase
    assert feet.brake[:2].sum() / front == pytest.approx(feet.brake[2:].sum() / (1 - front))


@pytest.mark.parametrize("name", ["preview", "calm", "lag", "rate", "limit", "delay", "heading"])
@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf])
def test_a_driver_who_cannot_be_is_refused(name, wrong):
    with pytest.raises(ValueError, match=name):
        Steering(**{name: wrong})
