"""The brake unit against the response of its dead time, lag and rates, and what it lets whom have."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.manoeuvres.base import Manoeuvre, Verdict
from vse_gym.physics.brakes import BELIEFS, BrakeUnit, brake_torques, drive_torques, released_brakes
from vse_gym.physics.double_track import wheel_velocity
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET, Sensors
from vse_gym.simulation import Simulation
from vse_gym.types import Driver
from vse_gym.vehicles import load

UNIT = BrakeUnit()
CAR = load("qin2014")
NOTHING = np.zeros(4)
STANDING = (0.0, 0.0, 0.0)
some_examples = settings(deadline=None)  # the first example may have to compile a kernel


def rolling(vx, vy=0.0, yaw_rate=0.0, steer=0.0):
    """Readings of a car whose wheels roll without slip, (7,)."""
    along = [wheel_velocity(CAR, i, vx, vy, yaw_rate, steer)[0] for i in range(4)]
    return np.array([0.0, 0.0, 0.0, *along]) / CAR.wheel_radius


def respond(
    steps,
    dt=0.01,
    driver=NOTHING,
    added=NOTHING,
    release=NOTHING,
    memory=None,
    heard=None,
    velocity=STANDING,
    unit=UNIT,
):
    """Torques of so many control steps under one demand, (steps, 4), and the memory after."""
    memory = released_brakes(unit, dt) if memory is None else memory
    heard = np.zeros(7) if heard is None else heard
    torques = []
    for k in range(steps):
        speeds = heard * (1 + 1e-9 * (k % 2))  # a sensor that speaks never says the same twice
        memory = brake_torques(unit, CAR.geometry, memory, driver, added, release, speeds, velocity, 0.0, dt)
        torques.append(memory[0])
    return np.array(torques), memory


@pytest.mark.parametrize("dt", [0.005, 0.01, 0.02])
def test_answers_a_small_demand_by_dead_time_and_lag(dt):
    # 100 N m asks for at most 100/lag = 2 kN m/s, so that the rate limits don't act. A row is the torque at the end
    # of its step; the lag's own exponential is what the unit steps with, so that nothing but rounding is left.
    torques, _ = respond(60, dt, driver=np.full(4, 100.0))
    since = dt * np.arange(1, 61) - UNIT.dead_time
    expected = 100 * -np.expm1(-np.maximum(since, 0) / UNIT.lag)
    np.testing.assert_allclose(torques, np.outer(expected, np.ones(4)), rtol=1e-9, atol=1e-9)


def test_builds_up_and_lets_go_no_faster_than_its_rates():
    dt = 0.01
    up, memory = respond(200, dt, driver=np.full(4, 3000.0))
    down, _ = respond(200, dt, memory=memory)
    rises, falls = np.diff(up[:, 0]), -np.diff(down[:, 0])
    assert rises.max() == pytest.approx(UNIT.rise * dt, rel=1e-9)
    assert falls.max() == pytest.approx(UNIT.fall * dt, rel=1e-9)
    late = round(UNIT.dead_time / dt)
    np.testing.assert_allclose(up[late : late + 19, 0], UNIT.rise * dt * np.arange(1, 20), rtol=1e-9)
    # The lag takes over where it asks for less than the rate, rate times lag below the demand, to within one step.
    reached = up[late:][np.argmax(rises[late:] < UNIT.rise * dt * (1 - 1e-9)), 0]
    assert reached == pytest.approx(3000 - UNIT.lag * UNIT.rise, abs=UNIT.rise * dt)
    np.testing.assert_allclose(up[-1], 3000, rtol=1e-9)
    np.testing.assert_allclose(down[-1], 0, atol=1e-9)


@pytest.mark.parametrize("wheel", range(4))
def test_a_released_wheel_loses_the_drivers_torque_and_no_other_does(wheel):
    driver, release = np.full(4, 1000.0), np.zeros(4)
    _, memory = respond(200, driver=driver)
    release[wheel] = 1.0
    torques, _ = respond(100, driver=driver, release=release, memory=memory)
    expected = driver * (1 - release)
    np.testing.assert_allclose(torques[-1], expected, atol=1e-3)  # 1 s less the dead time leaves 1000 e^-19.6 N m


def test_half_a_release_leaves_half_the_torque():
    torques, _ = respond(200, driver=np.full(4, 1000.0), release=np.full(4, 0.5))
    np.testing.assert_allclose(torques[-1], 500, rtol=1e-9)


def test_what_is_added_ends_at_the_caps_and_the_drivers_torque_does_not():
    caps = CAR.brake_caps
    torques, _ = respond(300, added=np.full(4, 1e5))
    np.testing.assert_allclose(torques[-1], caps, rtol=1e-6)
    torques, _ = respond(300, driver=np.full(4, 5000.0), added=np.full(4, 1e5))
    np.testing.assert_allclose(torques[-1], 5000 + caps, rtol=1e-6)


@some_examples
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.005, 0.01, 0.02, 0.05]))
def test_torques_are_never_negative_nor_beyond_what_was_asked(seed, dt):
    rng = np.random.default_rng(seed)
    memory = released_brakes(UNIT, dt)
    for _ in range(40):
        driver, added, release = rng.uniform(0, 4000, 4), rng.uniform(-4000, 4000, 4), rng.uniform(-1, 2, 4)
        heard, velocity = rng.uniform(-20, 80, 7), tuple(rng.uniform([-5, -10, -2], [30, 10, 2]))
        steer = rng.uniform(-0.5, 0.5)
        memory = brake_torques(UNIT, CAR.geometry, memory, driver, added, release, heard, velocity, steer, dt)
        assert np.all(memory[:-BELIEFS] >= 0)
        assert np.all(memory[:-BELIEFS] <= 4000 + CAR.brake_caps)


@some_examples
@given(st.floats(5, 40), st.floats(-3, 3), st.floats(-2, 2), st.floats(-0.2, 0.2))
def test_wheels_that_roll_in_a_turn_are_not_taken_to_slip(vx, vy, yaw_rate, steer):
    heard = rolling(vx, vy, yaw_rate, steer)
    memory = released_brakes(UNIT, 0.01)
    after = brake_torques(
        UNIT, CAR.geometry, memory, np.full(4, 700.0), NOTHING, NOTHING, heard, (vx, vy, yaw_rate), steer, 0.01
    )
    assert np.all(after[-BELIEFS - 1] == 700)


def one_locks(wheel):
    """Readings at 20 m/s of rolling wheels but one, (7,)."""
    heard = rolling(20.0)
    heard[3 + wheel] = 0.0
    return heard


@pytest.mark.parametrize("wheel", range(4))
def test_only_the_wheel_that_locks_is_let_go_and_the_other_axle_brakes_on(wheel):
    torques, _ = respond(200, driver=np.full(4, 700.0), heard=one_locks(wheel), velocity=(20.0, 0.0, 0.0))
    assert torques[-1, wheel] == pytest.approx(UNIT.least, rel=1e-6)
    np.testing.assert_allclose(torques[-1, [2, 3] if wheel < 2 else [0, 1]], 700, rtol=1e-6)


@pytest.mark.parametrize("wheel", range(4))
def test_beside_a_locked_wheel_torque_builds_up_slowly_in_front_and_wears_off_behind(wheel):
    driver, moving = np.full(4, 700.0), (20.0, 0.0, 0.0)
    _, memory = respond(0 if wheel < 2 else 200, driver=driver, heard=rolling(20.0), velocity=moving)
    torques, _ = respond(60, driver=driver, heard=one_locks(wheel), velocity=moving, memory=memory)
    rate = UNIT.yaw_build_up_front if wheel < 2 else UNIT.yaw_build_up_rear
    neighbour = torques[:, wheel + 1 if wheel % 2 == 0 else wheel - 1]
    # Once the dead time and the lag have passed; the unit reckons with them as if its steps were short.
    np.testing.assert_allclose(np.diff(neighbour[30:]), rate * 0.01, rtol=0.1)


def test_locked_wheels_keep_their_torque_below_the_slowest_speed():
    torques, _ = respond(200, driver=np.full(4, 700.0), velocity=(0.9 * UNIT.slowest, 0.0, 0.0))
    np.testing.assert_allclose(torques[-1], 700, rtol=1e-9)


def test_a_wheel_that_the_turning_car_carries_slowly_keeps_its_torque():
    # The inner wheels go at 3 - 0.76 x 3 and 3 - 0.80 x 3 m/s: too slow to speak of slip.
    alone = UNIT._replace(yaw_build_up_front=np.inf, yaw_build_up_rear=np.inf)
    torques, _ = respond(200, driver=np.full(4, 700.0), velocity=(3.0, 0.0, 3.0), unit=alone)
    np.testing.assert_allclose(torques[-1], [700, UNIT.least, 700, UNIT.least], rtol=1e-9)


@dataclass(frozen=True)
class FullBraking(Manoeuvre):
    """Straight ahead, a foot on the pedal."""

    torque: float = 1000.0  # of a front wheel, half of it at the rear [N m]

    def drive(self, state, time, car):
        return Driver(brake=self.torque * np.array([1.0, 1.0, 0.5, 0.5])), state

    def verdict(self, log, nominal):
        return Verdict(())


def test_a_wheel_sensor_that_has_not_spoken_yet_is_not_taken_for_a_locked_wheel():
    always_silent = Sensors(QUIET, silence_rate=1e6)
    drive = scenario(FullBraking(torque=500.0), "qin2014", always_silent)
    simulation = Simulation(drive, "truth")
    simulation.reset(0)
    for _ in range(30):
        frame = simulation.step()
    # 0.3 s less the dead time are 5.6 lags, which leave 0.4 % of the step.
    np.testing.assert_allclose(frame.brake, [500, 500, 250, 250], rtol=0.01)


def test_the_engine_is_cut_while_the_stability_control_brakes_and_drags_on():
    driver = np.array([300.0, 300.0, -50.0, 0.0])
    assert drive_torques(driver, np.zeros(4)).tolist() == driver.tolist()
    assert drive_torques(driver, np.array([0.0, 0.0, 1.0, 0.0])).tolist() == [0.0, 0.0, -50.0, 0.0]
