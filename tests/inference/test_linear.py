"""Kalman's filter on linear models, and the linear bicycle beside its analytic solution."""

import numpy as np
import pytest
from scipy.linalg import expm

from vse_gym.compiled import hold
from vse_gym.inference.linear import Kalman, kalman_drive, kalman_update, matrices
from vse_gym.inference.model import attend
from vse_gym.models import LinearBicycleTuning, Nominal
from vse_gym.models.bicycle import held_gain
from vse_gym.sensors import LOUD
from vse_gym.types import U_BRAKE, U_STEER, Y_AX, Y_AY, Y_WHEEL, Y_YAW_RATE
from vse_gym.vehicles import load


def test_it_is_what_kalmans_equations_give(linear, linear_drive):
    memory = np.zeros(3)  # refusals
    means, covs = kalman_drive(
        Kalman(), linear, linear.prior_mean, linear.prior_cov, memory, linear_drive.inputs, linear_drive.readings
    )
    np.testing.assert_allclose(means, linear_drive.means, atol=1e-12)  # exact but for rounding
    np.testing.assert_allclose(covs, linear_drive.covs, atol=1e-12)


def test_a_flat_belief_is_updated_like_a_drive(linear, linear_drive):
    model = linear._replace(memory=np.zeros(3))
    constants, start = hold((Kalman(), model)), (linear.prior_mean, linear.prior_cov)
    belief = np.concatenate([*map(np.ravel, start), model.memory, np.zeros(7)])
    means, covs = kalman_drive(Kalman(), model, *start, model.memory, linear_drive.inputs, linear_drive.readings)
    for k, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        before = belief.copy()
        belief, old = kalman_update(constants, belief, u, y), belief
        np.testing.assert_array_equal(belief[:2], means[k])
        np.testing.assert_array_equal(belief[2:6].reshape(2, 2), covs[k])
        assert belief[-1] == np.isfinite(y).sum()
        np.testing.assert_array_equal(old, before)


# -- the linear bicycle -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def car():
    return load("qin2014_understeer")


@pytest.fixture(scope="module")
def bicycle(car):
    return LinearBicycleTuning().build(Nominal(car, LOUD, speed=20.0))


def at(speed):
    """What the model remembers of wheels that have rolled at a speed."""
    return np.array([1.0, 1.0, 1.0, 1.0, speed])


def steered(angle):
    u = np.zeros(9)
    u[U_STEER] = angle
    return u


@pytest.mark.parametrize("scale", [1e-6, 0.1, 1.0, 200.0])
def test_inputs_are_held_exactly(scale):
    a, h = scale * np.array([[-0.9, 0.7], [-0.4, -1.1]]), 0.01
    whole = expm(h * np.block([[a, np.eye(2)], [np.zeros((2, 4))]]))  # Van Loan (1978)
    gain = held_gain(a, h)
    np.testing.assert_allclose(gain, whole[:2, 2:], rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(np.eye(2) + a @ gain, whole[:2, :2], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("speed", [5.0, 20.0, 40.0])
def test_a_held_steer_ends_in_the_textbooks_steady_turn(bicycle, car, speed):
    F, g, H, d = matrices(bicycle, at(speed), steered(0.01))
    vy, yaw_rate = steady = np.linalg.solve(np.eye(2) - F, g)
    assert yaw_rate == pytest.approx(speed * 0.01 / (car.wheelbase + car.understeer_gradient * speed**2), rel=1e-9)
    alpha_rear = car.mass * car.lf * speed * yaw_rate / car.wheelbase / (2 * car.rear_tyre.cornering_stiffness)
    assert vy == pytest.approx(car.lr * yaw_rate - speed * alpha_rear, rel=1e-9)
    assert (H @ steady + d)[Y_AY] == pytest.approx(speed * yaw_rate, rel=1e-9)


def test_braking_one_side_turns_the_car_there(bicycle, car):
    u = np.zeros(9)
    u[U_BRAKE] = 330.0
    _, g, _, _ = matrices(bicycle, at(20.0), u)
    moment = 330.0 / car.wheel_radius * car.track_front / 2
    assert g[1] == pytest.approx(bicycle.car.dt * moment / car.yaw_inertia, rel=0.1)  # damped a little within the step


def wheels_of(car, speed, yaw_rate=0.0):
    y = np.full(10, np.nan)
    y[Y_AX], y[Y_AY], y[Y_YAW_RATE] = 0.0, 0.0, yaw_rate
    halves = np.array([-car.track_front, car.track_front, -car.track_rear, car.track_rear]) / 2
    y[Y_WHEEL : Y_WHEEL + 4] = (speed + halves * yaw_rate) / car.wheel_radius
    return y


def test_the_speed_is_that_of_the_rolling_wheels_about_the_cars_centre(bicycle, car):
    u, y = np.zeros(9), wheels_of(car, 18.0, yaw_rate=0.5)
    u[U_BRAKE], y[Y_WHEEL] = 500.0, 10.0  # one brakes, and slips
    _, memory = attend(bicycle, at(20.0), u, y)
    assert memory[4] == pytest.approx(18.0)
    y[Y_WHEEL + 1] = np.nan
    _, memory = attend(bicycle, at(20.0), u, y)
    assert memory[4] == pytest.approx(18.0)


def test_while_all_wheels_brake_the_speed_falls_no_faster_than_the_car(bicycle, car):
    u, y = np.zeros(9), wheels_of(car, 5.0)  # nearly locked
    u[U_BRAKE : U_BRAKE + 4], y[Y_AX] = 1000.0, -6.0
    _, memory = attend(bicycle, at(20.0), u, y)
    assert memory[4] == pytest.approx(20.0 - 0.01 * (6.0 + 0.3))
    y[Y_WHEEL + 2] = 19.99 / car.wheel_radius  # one grips again
    _, memory = attend(bicycle, at(20.0), u, y)
    assert memory[4] == pytest.approx(19.99)
    _, memory = attend(bicycle, at(20.0), u, np.full(10, np.nan))
    assert memory[4] == 20.0
