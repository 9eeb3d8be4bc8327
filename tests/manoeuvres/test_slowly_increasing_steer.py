"""The slowly increasing steer, and the angle at 0.3 g that is read off it."""

import math
from itertools import pairwise

import numpy as np
import pytest

from vse_gym.manoeuvres.slowly_increasing_steer import SlowlyIncreasingSteer, steer_at_0_3g
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.procedures import measure_steer_at_0_3g
from vse_gym.sensors import QUIET
from vse_gym.types import Car
from vse_gym.vehicles import load, names

DEG = math.pi / 180
DT = 0.01
EITHER_WAY = pytest.mark.parametrize("side", [1, -1])


@EITHER_WAY
@pytest.mark.parametrize("bend", [0.0, 0.02])
def test_a_is_read_off_a_straight_line_through_the_tenths_of_a_g(bend, side, nominal, log_of, figure):
    # ay = 3 % of g a degree and an offset: 0.3 g is at 11 deg; what lies outside 0.1 to 0.375 g must not count.
    time = DT * np.arange(401)
    degrees = 13.5 * np.maximum(time - 0.5, 0)
    g = 0.03 * (degrees - 1)
    g = np.where(g < 0.1, g - bend * (0.1 - g), g)
    g = np.where(g > 0.375, 0.375 + (1 - 30 * bend) * (g - 0.375), g)
    log = log_of(time, hand_wheel=side * degrees * DEG, AY=side * g * p.GRAVITY)
    verdict = SlowlyIncreasingSteer(rate=side * 13.5 * DEG).verdict(log, nominal)
    assert figure(verdict, "hand-wheel angle").figure == pytest.approx(11, rel=1e-6)
    assert figure(verdict, "largest lateral").figure == pytest.approx(np.abs(g).max(), rel=1e-9)
    assert verdict.passed


def test_a_car_that_never_corners_at_0_375_g_has_no_a(nominal, log_of, figure):
    time = DT * np.arange(401)
    log = log_of(time, hand_wheel=time, AY=0.37 * p.GRAVITY * time / time[-1])
    verdict = SlowlyIncreasingSteer().verdict(log, nominal)
    assert not verdict.passed
    assert math.isnan(figure(verdict, "hand-wheel angle").figure)


@EITHER_WAY
def test_the_slow_hand_wheel_turns_at_its_rate_until_half_a_g(side, nominal):
    test = SlowlyIncreasingSteer(rate=side * 13.5 * DEG)
    memory, angles = test.init(nominal), []
    for k in range(400):
        state = np.zeros(p.STATE_SIZE)
        state[p.VX], state[p.AY] = test.speed, side * (0.0 if k < 300 else 0.5 * p.GRAVITY)
        driver, memory = test.drive(memory, k * DT, Car(state))
        angles.append(driver.hand_wheel)
        assert not driver.drive.any()  # at its speed it needs no torque
    turning = np.diff(angles)[50:299]
    np.testing.assert_allclose(turning, side * 13.5 * DEG * DT, rtol=1e-9)
    assert not np.any(angles[:50])
    assert set(angles[300:]) == {angles[299]}


@pytest.mark.parametrize("front", [1.0, 0.0, 0.4])
def test_the_slow_steer_holds_its_speed_with_the_driven_wheels(front, nominal):
    told = Nominal(nominal.vehicle._replace(front_drive=front), QUIET, nominal.speed)
    test, drives = SlowlyIncreasingSteer(), []
    for off in (-1.0, 1.0):
        state = np.zeros(p.STATE_SIZE)
        state[p.VX] = test.speed + off
        drives.append(test.drive(test.init(told), 0.0, Car(state))[0].drive)
    slow, fast = drives
    np.testing.assert_allclose(slow / slow.sum(), 0.5 * np.array([front, front, 1 - front, 1 - front]), atol=1e-12)
    assert slow.sum() > 0 and not fast.any()  # and does not brake


@pytest.mark.parametrize(("car", "degrees"), [("qin2014", 16.3), ("qin2014_understeer", 22.4)])
def test_a_of_the_cars_is_as_measured_before(car, degrees):
    # Another implementation of the same car and tyre; how it held its speed and when it began is not known, and
    # 1 deg of hand wheel is 74 ms of turning.
    assert steer_at_0_3g(load(car)) / DEG == pytest.approx(degrees, abs=1)


def test_a_road_too_slippery_for_the_test_gives_no_a():
    assert math.isnan(steer_at_0_3g(load("qin2014_understeer"), friction=0.3))


@pytest.mark.parametrize("car", names())
def test_the_more_friction_the_less_hand_wheel_for_0_3_g(car):
    # The tyre softens by 0.0668 of its normalised slip, which falls with friction.
    angles = [steer_at_0_3g(load(car), friction) for friction in (0.7, 0.9, 1.2)]
    signs = {math.copysign(1, b - a) for a, b in pairwise(angles)}
    assert len(signs) == 1


def test_a_of_two_tyre_laws_with_equal_numbers_is_not_mixed_up():
    car = load("qin2014_understeer")
    laws = []
    for law in (p.LinearTyre, p.DugoffTyre):
        tyres = {axle: law(*getattr(car, axle)[:2]) for axle in ("front_tyre", "rear_tyre")}
        laws.append(steer_at_0_3g(car._replace(**tyres)))
    assert laws[0] != laws[1]


def test_an_offset_of_the_steering_leaves_the_mean_of_left_and_right():
    # 0.01 rad at the road wheel are 9.17 deg of hand wheel, more to one side and less to the other.
    car = load("qin2014_understeer")
    straight, offset = (measure_steer_at_0_3g(car._replace(steering_offset=angle)) for angle in (0.0, 0.01))
    assert offset == pytest.approx(straight, rel=5e-3)
