"""The body that rolls, against the linear theory of one degree of freedom and of four, and what it must leave alone."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    CONTACT,
    LOAD,
    advance,
    contact,
    rolling_start,
    wheel_position,
)
from vse_gym.physics.reference import advance_reference
from vse_gym.physics.roll import accelerations
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Y_AY, Y_ROLL_RATE
from vse_gym.vehicles import load

CAR = load("wei2019_roll")
BODY = CAR.body
STEADY = CAR._replace(relaxation_x=0.0, relaxation_y=0.0)
LINEAR = STEADY._replace(front_tyre=p.LinearTyre(94e3, 49e3), rear_tyre=p.LinearTyre(75e3, 45.8e3))
SWING = BODY.sprung_mass * BODY.roll_arm  # [kg m]
RESTORING = BODY.roll_stiffness - SWING * p.GRAVITY  # [N m/rad]
INERTIA = BODY.roll_inertia + SWING * BODY.roll_arm  # about the roll axis [kg m2]
NOTHING = np.zeros(4)
ROAD = p.road((0.0, 0.9))
LATERAL = [p.VY, p.YAW_RATE, p.ROLL, p.ROLL_RATE]
every_integrator = pytest.mark.parametrize("integrator", [advance, advance_reference], ids=lambda f: f.__name__)


def rolling(**changes):
    """The body with other numbers."""
    return BODY._replace(**changes)


def held(angle):
    """A steer held."""
    return lambda _: p.Inputs(angle, NOTHING, NOTHING)


def swept(time, amplitude=0.03, frequency=0.7):
    """A sine steer."""
    return p.Inputs(amplitude * math.sin(2 * math.pi * frequency * time), NOTHING, NOTHING)


def linear_system(speed):
    """The linear car in (vy, yaw rate, roll, roll rate) at a speed, written down anew from the equations of motion."""
    m, iz, lf, lr = CAR.mass, CAR.yaw_inertia, CAR.lf, CAR.lr
    iz += 4 * CAR.wheel_inertia * (0.5 * CAR.track_front / CAR.wheel_radius) ** 2  # a yawing car spins its wheels
    front, rear = 2 * LINEAR.front_tyre.cornering_stiffness, 2 * LINEAR.rear_tyre.cornering_stiffness
    inertia = np.array(
        [
            [m, 0, 0, -SWING],
            [0, iz, 0, -BODY.roll_yaw_product],
            [0, 0, 1, 0],
            [-SWING, -BODY.roll_yaw_product, 0, INERTIA],
        ]
    )
    force = np.array(
        [
            [-(front + rear) / speed, (lr * rear - lf * front) / speed - m * speed, 0, 0],
            [(lr * rear - lf * front) / speed, -(lf**2 * front + lr**2 * rear) / speed, 0, 0],
            [0, 0, 0, 1],
            [0, SWING * speed, -RESTORING, -BODY.roll_damping],
        ]
    )
    return np.linalg.solve(inertia, force)


@every_integrator
@pytest.mark.parametrize("side", [1, -1])
def test_a_steady_turn_rolls_the_car_outwards_by_the_moment_over_the_stiffness(integrator, side, driven):
    states = driven(STEADY, integrator, held(side * 0.02), 4.0)
    last = states[-1]
    ay = last[p.AY] - p.GRAVITY * math.sin(last[p.ROLL])  # what the accelerometer feels, less its lean
    assert side * ay > 2.0
    # The coasting car slows by 0.1 m/s2 and turns ever slower: the roll lags by C/K' = 57 ms times d(ay)/dt.
    assert last[p.ROLL] == pytest.approx(SWING * ay / RESTORING, rel=2e-3)
    assert 4.0 < math.degrees(last[p.ROLL] / ay * p.GRAVITY) < 6.0


@every_integrator
def test_on_ice_the_body_swings_as_the_damped_oscillator_of_theory(integrator, driven):
    # Without any force from the road the car slides aside and yaws under the body: less inertia, a faster swing.
    inertia = INERTIA - SWING**2 / CAR.mass - BODY.roll_yaw_product**2 / CAR.yaw_inertia
    natural = math.sqrt(RESTORING / inertia)
    damping = BODY.roll_damping / (2 * inertia * natural)
    states = driven(STEADY, integrator, held(0.0), 3.0, speed=0.0, road=p.road((0.0, 1e-9)), roll=0.1)
    time, damped = 0.01 * np.arange(301), natural * math.sqrt(1 - damping**2)
    fade = 0.1 * np.exp(-damping * natural * time)
    theory = fade * (np.cos(damped * time) + damping * natural / damped * np.sin(damped * time))
    # Both are of second order or more in roll: (10/s 1 ms)^2/12 of the angle in each period.
    np.testing.assert_allclose(states[:, p.ROLL], theory, rtol=0, atol=1e-5)
    assert 1.2 < natural / (2 * math.pi) < 1.8
    assert 0.2 < damping < 0.35


@every_integrator
def test_a_rolling_linear_car_moves_in_the_modes_of_the_linear_system(integrator, driven):
    speed, roll = 25.0, 1e-3
    states = driven(LINEAR, integrator, held(0.0), 2.0, speed=speed, roll=roll)
    step, x = expm(0.01 * linear_system(speed)), np.array([0.0, 0.0, roll, 0.0])
    theory = [x := step @ x for _ in range(200)]
    scale = np.abs(theory).max(axis=0)
    # Runge-Kutta: for 4 ms the wheels, 1 % of the inertia, slip until they follow. Semi-implicit: 1 ms of 10/s.
    tolerance = 1e-3 if integrator is advance_reference else 1e-2
    np.testing.assert_allclose(states[1:, LATERAL] / scale, np.array(theory) / scale, rtol=0, atol=tolerance)


@pytest.mark.parametrize(("integrator", "order"), [(advance, 1), (advance_reference, 4)])
def test_converges_with_the_integrators_order(integrator, order, driven):
    coarse, half, fine = (
        driven(STEADY, integrator, lambda time: swept(time), 1.0, h)[-1, [*LATERAL, p.VX]]
        for h in (2e-3, 1e-3, 1.25e-4)
    )
    # Against 1/16 of the coarse step the first order's ratio is (16 - 1)/(8 - 1) = 2.14.
    ratio = np.linalg.norm(coarse - fine) / np.linalg.norm(half - fine)
    assert math.log2(ratio) == pytest.approx(order, abs=0.5)


@every_integrator
def test_a_body_on_ever_stiffer_springs_becomes_the_car_with_seven_degrees_of_freedom(integrator, driven):
    # A rigid car's load transfer lags as a whole, here only what goes through the roll centres: so, almost no lag.
    quick = STEADY._replace(load_lag=2e-3)
    rigid = driven(quick._replace(body=p.RigidBody()), integrator, swept, 2.0)
    away = []
    for times in (100.0, 1000.0):
        stiff = rolling(roll_stiffness=times * BODY.roll_stiffness, roll_damping=times**0.5 * BODY.roll_damping)
        states = driven(quick._replace(body=stiff), integrator, swept, 2.0)
        motion = [p.X, p.Y, p.YAW, p.VX, p.VY, p.YAW_RATE]
        away.append((np.abs(states - rigid)[:, motion] / np.abs(rigid[:, motion]).max(axis=0)).max())
    assert away[0] < 2e-3
    assert away[1] < away[0] / 4  # in proportion to the springs' give, but for what is left of the lag


def test_a_body_without_arm_still_rolls_by_its_product_of_inertia(driven):
    hung = STEADY._replace(body=rolling(roll_arm=0.0))
    states = driven(hung, advance_reference, swept, 1.0)
    rigid = driven(hung._replace(body=p.RigidBody()), advance_reference, swept, 1.0)
    assert np.abs(states[:, p.ROLL]).max() > 1e-5
    assert 0 < np.abs(states - rigid)[:, p.YAW_RATE].max() < 1e-3


def test_wheel_loads_carry_the_car_and_balance_the_steady_turn(driven):
    x = driven(STEADY, advance_reference, held(0.02), 4.0)[-1]
    wheels = np.empty((4, CONTACT))
    contact(STEADY, ROAD, x, 0.02, wheels)
    loads = wheels[:, LOAD]
    along, across = np.array([wheel_position(STEADY, i) for i in range(4)]).T
    weight = CAR.mass * p.GRAVITY
    ay = x[p.AY] - p.GRAVITY * math.sin(x[p.ROLL])
    assert loads.sum() == pytest.approx(weight, rel=1e-12)
    assert loads @ along == pytest.approx(-CAR.mass * x[p.LOAD_AX] * CAR.height, abs=1e-9 * weight)
    # As the roll angle lags behind the slowing turn, 2e-3.
    assert loads @ across == pytest.approx(-CAR.mass * ay * CAR.height, rel=2e-3)
    front, rear = (loads[1] - loads[0]) * CAR.track_front, (loads[3] - loads[2]) * CAR.track_rear
    assert front / (front + rear) == pytest.approx(CAR.front_transfer, rel=1e-9)


def test_a_swinging_body_leans_on_its_outer_wheels():
    x = rolling_start(STEADY, 20.0)
    x[p.ROLL], x[p.ROLL_RATE] = 0.05, 0.1
    wheels = np.empty((4, CONTACT))
    contact(STEADY, ROAD, x, 0.0, wheels)
    moment = np.diff(wheels[:, LOAD].reshape(2, 2), axis=1).ravel() @ [CAR.track_front / 2, CAR.track_rear / 2]
    assert moment == pytest.approx(BODY.roll_stiffness * 0.05 + BODY.roll_damping * 0.1, rel=1e-12)


@settings(deadline=None)  # the first example may have to compile a kernel
@given(*[st.floats(-10, 10)] * 3, st.floats(-0.3, 0.3), st.floats(-1, 1), st.floats(-1, 1), st.floats(-200, 200))
def test_the_accelerations_solve_the_coupled_equations(ax, ay, yaw, roll, roll_rate, yaw_rate, product):
    body = rolling(roll_yaw_product=product)
    x = np.zeros(p.STATE_SIZE)
    x[p.ROLL], x[p.ROLL_RATE], x[p.YAW_RATE] = roll, roll_rate, yaw_rate
    got = accelerations(body, CAR, x, ax, ay, yaw, 0.0)
    m, iz = CAR.mass, CAR.yaw_inertia
    inertia = np.array([[m, 0, 0, 0], [0, m, 0, -SWING], [0, 0, iz, -product], [0, -SWING, -product, INERTIA]])
    moment = -RESTORING * roll - BODY.roll_damping * roll_rate
    forces = np.array([m * ax - SWING * yaw_rate * roll_rate, m * ay, iz * yaw, moment])
    np.testing.assert_allclose(got, np.linalg.solve(inertia, forces), rtol=1e-9, atol=1e-9)


def test_the_accelerometer_feels_the_motion_and_the_lean_of_the_body(driven):
    bank = 0.05
    states = driven(STEADY, advance_reference, held(0.02), 2.0, road=p.road((0.0, 0.9), bank=bank))
    change = (states[2:, p.VY] - states[:-2, p.VY]) / 0.02  # to second order: 2 m/s2 (10/s 10 ms)^2/6
    middle = states[1:-1]
    expected = change + middle[:, p.YAW_RATE] * middle[:, p.VX] + p.GRAVITY * np.sin(middle[:, p.ROLL] + bank)
    np.testing.assert_allclose(middle[5:, p.AY], expected[5:], rtol=0, atol=0.02)
    assert np.abs(middle[:, p.ROLL]).max() > 0.025  # 0.25 m/s2 of lean


def test_a_car_that_stands_on_a_bank_leans_down_and_feels_gravity_in_its_own_axes(driven):
    bank = 0.06
    state = driven(CAR, advance_reference, held(0.0), 6.0, speed=0.0, road=p.road((0.0, 0.9), bank=bank))[-1]
    lean = SWING * p.GRAVITY * math.sin(bank) / RESTORING
    assert state[p.ROLL] == pytest.approx(lean, rel=1e-3)  # the left side is higher: to the right
    assert state[p.AY] == pytest.approx(p.GRAVITY * math.sin(state[p.ROLL] + bank), abs=1e-3)
    assert abs(state[p.VY]) < 1e-4


def test_a_drive_with_a_roll_gyro_reads_what_the_body_does():
    log = rollout(scenario("sine_steer", "wei2019_roll", "clean+roll_rate", duration=3.0), "truth", "none", 0)
    np.testing.assert_array_equal(log.readings[:, Y_ROLL_RATE], log.truth[:, p.ROLL_RATE])
    np.testing.assert_array_equal(log.readings[:, Y_AY], log.truth[:, p.AY])
    assert np.abs(log.truth[:, p.ROLL]).max() > math.radians(2)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"sprung_mass": 0.0}, "sprung_mass"),
        ({"sprung_mass": 1600.0}, "sprung_mass"),
        ({"roll_arm": -0.1}, "roll_arm"),
        ({"roll_inertia": math.nan}, "roll_inertia"),
        ({"roll_yaw_product": 1300.0}, "roll_yaw_product"),
        ({"roll_stiffness": 5e3}, "topples"),
        ({"roll_damping": -1.0}, "roll_damping"),
    ],
)
def test_a_body_that_cannot_be_is_refused_by_name(changes, named):
    with pytest.raises(ValueError, match=named):
        p.check_vehicle(CAR._replace(body=rolling(**changes)))


def test_a_body_is_rigid_or_rolling():
    with pytest.raises(ValueError, match="RigidBody or a RollingBody"):
        p.check_vehicle(CAR._replace(body=(1.0, 2.0)))
