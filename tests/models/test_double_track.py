"""The double track beside the plant, and what it does without a wheel's sensor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models import DoubleTrackTuning, Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import CONTACT, contact, specific_forces
from vse_gym.sensors import LOUD
from vse_gym.types import CHANNELS, U_BRAKE, U_DRIVE, U_STEER, Y_AX, Y_AY, Y_WHEEL
from vse_gym.vehicles import load

CAR = load("qin2014_understeer")
ELLIPSE = CAR._replace(
    front_tyre=p.EllipseTyre(120e3, 34377.0, 0.1),
    rear_tyre=p.FialaTyre(120e3, 56082.5, 0.1),
)


def model_of(car=CAR, friction=0.9):
    return DoubleTrackTuning().build(Nominal(car, LOUD, speed=20.0, friction=friction))


def rolling(speed, car=CAR):
    y = np.zeros(len(CHANNELS))
    y[Y_WHEEL : Y_WHEEL + 4] = speed / car.wheel_radius
    return y


def braked(*torques):
    u = np.zeros(9)
    u[U_BRAKE : U_BRAKE + 4] = torques
    return u


@pytest.mark.parametrize("car", [CAR, ELLIPSE], ids=["polynomial", "ellipse and printed"])
@given(
    vx=st.floats(5, 40),
    vy=st.floats(-5, 5),
    r=st.floats(-1, 1),
    steer=st.floats(-0.2, 0.2),
    slips=st.lists(st.floats(-1, 0.2), min_size=2, max_size=2),
    torques=st.lists(st.floats(21, 3000), min_size=2, max_size=2),
)
def test_its_forces_are_the_plants_at_the_same_loads(car, vx, vy, r, steer, slips, torques):
    model, u, y = model_of(car), braked(0.0, torques[0], torques[1], 0.0), rolling(vx, car)
    u[U_STEER], y[Y_AX] = steer, np.nan
    y[Y_WHEEL + 1 : Y_WHEEL + 3] *= 1 + np.array(slips)
    along = (vx - r * car.track_front / 2) * np.cos(steer) + (vy + r * car.lf) * np.sin(steer)
    y[[Y_WHEEL, Y_WHEEL + 3]] = np.array([along, vx + r * car.track_rear / 2]) / car.wheel_radius  # the others roll
    limit = model.friction * p.GRAVITY
    x = np.zeros(p.STATE_SIZE)
    x[p.VX], x[p.VY], x[p.YAW_RATE], x[p.WHEEL_SPEEDS] = vx, vy, r, y[Y_WHEEL : Y_WHEEL + 4]
    x[p.LOAD_AX] = np.clip(-sum(torques) / car.wheel_radius / car.mass, -limit, limit)
    x[p.LOAD_AY] = np.clip(vx * r, -limit, limit)
    wheels = np.empty((4, CONTACT))
    contact(car, p.road((0.0, 0.9)), x, steer, wheels)
    ax, ay, yaw_acceleration = specific_forces(car, wheels)
    u, state = heed(model, u, y), np.array([vx, vy, r])
    # Nothing but rounding; where a wheel lifts off, of a load that is the difference of two large ones.
    np.testing.assert_allclose(report(model, state, u), [vx, vy, r, ax, ay], rtol=1e-9, atol=1e-9)
    short = model._replace(dt=1e-7)  # of the step, the slope at its beginning is left
    slope = (advance(short, state[:, None].copy(), u)[:, 0] - state) / short.dt
    expected = [ax + vy * r, ay - vx * r, yaw_acceleration]
    np.testing.assert_allclose(slope, expected, rtol=1e-3, atol=2e-3)  # states of 40 to 1e-16, over 1e-7


def test_a_car_that_coasts_keeps_its_speed():
    # By the slips of free wheels it would not: they are noise.
    model, y = model_of(), rolling(20.1)
    u = heed(model, np.zeros(9), y)
    state = np.array([[20.0], [0.0], [0.0]])
    np.testing.assert_array_equal(advance(model, state, u), state)
    assert observe(model, state, u)[Y_AX, 0] == 0


def test_a_braked_wheel_whose_sensor_is_silent_pulls_what_its_torque_says():
    model, state = model_of(), np.array([20.0, 0.0, 0.0])
    _, _, _, ax, _ = report(model, state, heed(model, braked(100, 100, 100, 100), np.full(10, np.nan)))
    # The tyre's curve lies 2 % below its slope at 6 % of the friction.
    assert ax == pytest.approx(-400 / CAR.wheel_radius / CAR.mass, rel=0.03)
    _, _, _, ax, _ = report(model, state, heed(model, braked(9e3, 9e3, 9e3, 9e3), np.full(10, np.nan)))
    assert -0.9 * p.GRAVITY < ax < -0.7 * p.GRAVITY


def test_a_braked_wheel_that_is_heard_pulls_what_its_slip_says():
    model, state = model_of(friction=0.3), np.array([20.0, 0.0, 0.0])
    u, y = braked(0, 0, 0, 800), rolling(20.0)
    y[Y_AX] = np.nan  # else it would say that nothing brakes
    _, _, _, gripping, _ = report(model, state, heed(model, u, y))
    assert gripping == 0
    y[Y_WHEEL + 3] = 0
    _, _, _, locked, _ = report(model, state, heed(model, u, y))
    load_rear = CAR.mass * p.GRAVITY * CAR.lf / CAR.wheelbase / 2
    assert locked == pytest.approx(-0.3 * load_rear / CAR.mass, rel=0.1)  # though the torque would be four times that


def test_brakes_make_no_more_force_than_is_felt():
    model, state, y = model_of(), np.array([20.0, 0.0, 0.0]), rolling(15.0)  # wheels that slip, on who knows what
    y[Y_AX] = -2.0
    _, _, _, ax, _ = report(model, state, heed(model, braked(3000, 3000, 1500, 1500), y))
    assert ax == pytest.approx(-2.0 - 0.3, rel=1e-9)


def test_a_driven_wheel_that_spins_is_seen():
    model, u, y = model_of(friction=0.2), np.zeros(9), rolling(10.0)
    u[U_DRIVE] = 300.0
    y[Y_WHEEL] *= 2
    _, _, _, ax, _ = report(model, np.array([10.0, 0.0, 0.0]), heed(model, u, y))
    assert 0 < ax < 0.2 * p.GRAVITY / 3  # no more than a front wheel's share of the friction


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.0, 5.0, 20.0])
def test_a_disturbed_speed_comes_back_to_the_braked_wheels_without_ringing(speed):
    model = model_of()
    u = heed(model, braked(21, 21, 21, 21), rolling(speed))
    state, before = np.array([[speed + 0.2], [0.05], [0.02]]), 0.2
    for _ in range(20):
        state = advance(model, state, u)
        error = state[0, 0] - speed
        assert -0.02 * before <= error <= before  # the turn takes a little along
        before = max(error, 1e-6)


def test_the_outer_wheels_carry_more_and_grip_better_than_their_mean():
    # Load transfer costs lateral force only by way of the tyres' curve: at the limit, friction times load, nothing.
    model, state = model_of(), np.array([20.0, -1.0, 0.4])
    flat = model._replace(vehicle=CAR._replace(height=1e-9))
    u = heed(model, np.zeros(9), rolling(20.0))
    (_, _, _, _, real), (_, _, _, _, without) = report(model, state, u), report(flat, state, u)
    assert 0.9 * without < real < without


def test_wheels_are_believed_as_the_single_track_believes_them():
    model, u, y = model_of(), braked(0, 0, 0, 500), rolling(20.0)
    variances, memory = attend(model, model.memory, u, y)
    assert np.isnan(variances[Y_WHEEL + 3]) and np.isfinite(variances[Y_WHEEL : Y_WHEEL + 3]).all()
    for _ in range(9):
        variances, memory = attend(model, memory, np.zeros(9), y)
        assert np.isnan(variances[Y_WHEEL + 3])
    for _ in range(2):  # the tenth step ends at 0.1 s but for rounding
        variances, memory = attend(model, memory, np.zeros(9), y)
    assert np.isfinite(variances[Y_WHEEL + 3])
    assert variances[Y_AY] == LOUD.acceleration**2 + 6.0**2
