"""Slip angles and forces of axles against what a linear tyre must give."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.physics import parameters as p
from vse_gym.physics.axles import axle_slips, axle_stiffness
from vse_gym.vehicles import load

FRONT, REAR = 45e3, 60e3
# On one track both wheels of an axle have the axle's own slip angle
CAR = load("qin2014_understeer")._replace(
    front_tyre=p.LinearTyre(120e3, FRONT), rear_tyre=p.LinearTyre(120e3, REAR), track_front=1e-9, track_rear=1e-9
)


def at(vx, vy=0.0, yaw_rate=0.0):
    x = np.zeros((1, p.STATE_SIZE))
    x[0, [p.VX, p.VY, p.YAW_RATE]] = vx, vy, yaw_rate
    x[0, p.WHEEL_SPEEDS] = vx / CAR.wheel_radius
    return x


def of(function, x, steer=0.0, *more, car=CAR):
    return function(car, x, np.full(len(x), steer), np.full(len(x), 0.9), *more)


@given(st.floats(5, 50), st.floats(-3, 3), st.floats(-0.5, 0.5), st.floats(-0.1, 0.1))
def test_linear_tyres_give_their_stiffness_times_the_tangent_of_the_slip_angle(vx, vy, yaw_rate, steer):
    angles, forces = of(axle_slips, at(vx, vy, yaw_rate), steer)
    # The law is linear in tan(alpha); rounding alone is left of forces up to 100 kN
    np.testing.assert_allclose(forces[0], 2 * np.array([FRONT, REAR]) * np.tan(angles[0]), rtol=1e-9, atol=1e-6)


def test_an_axle_of_linear_tyres_has_exactly_twice_their_cornering_stiffness():
    small = 1e-5  # tan(x)/x is 1 but for x^2/3, 3e-11
    stiffness = of(axle_stiffness, at(20.0, -20.0 * small), small, 1e-9)
    np.testing.assert_allclose(stiffness[0], [2 * FRONT, 2 * REAR], rtol=1e-9)


def test_the_slip_angles_are_those_of_the_velocity_at_the_axles():
    vx, vy, r, steer = 20.0, 1.0, 0.3, 0.05
    angles, _ = of(axle_slips, at(vx, vy, r), steer)
    front, rear = math.atan((vy + CAR.lf * r) / vx), math.atan((vy - CAR.lr * r) / vx)
    np.testing.assert_allclose(angles[0], [steer - front, -rear], rtol=1e-12)


def test_a_car_that_stands_or_rolls_backwards_has_no_slip_angles():
    x = np.vstack([at(0.0, 1.0), at(-5.0, 1.0), at(5.0, 1.0)])
    for values in (*of(axle_slips, x), of(axle_stiffness, x, 0.0, 1e-3)):
        assert np.isnan(values[:2]).all() and np.isfinite(values[2]).all()


def test_a_steering_offset_is_steered_by_the_front_axle_alone():
    offset = 0.02
    crooked = CAR._replace(steering_offset=offset)
    x = at(20.0, 0.5, 0.1)
    for mine, other in zip(of(axle_slips, x, 0.03, car=crooked), of(axle_slips, x, 0.03 + offset), strict=True):
        np.testing.assert_array_equal(mine, other)
    angles, straight = of(axle_slips, x, 0.03, car=crooked)[0], of(axle_slips, x, 0.03)[0]
    np.testing.assert_allclose(angles - straight, [[offset, 0.0]], atol=1e-15)


def test_a_slip_angle_below_the_smallest_gives_no_stiffness():
    stiffness = of(axle_stiffness, at(20.0, -1.0), math.atan(-1.0 / 20.0), 1e-3)  # the front wheels point as they go
    assert np.isnan(stiffness[0, 0]) and stiffness[0, 1] == pytest.approx(2 * REAR, rel=1e-3)
