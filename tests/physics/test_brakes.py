"""The brake unit against the response of its dead time, lag and rates, and as an ABS that sees true speeds."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.manoeuvres.base import Manoeuvre, Verdict
from vse_gym.physics import parameters as p
from vse_gym.physics.brakes import BrakeUnit, brake_torques, limiter, released_brakes
from vse_gym.physics.double_track import wheel_velocity
from vse_gym.sensors import QUIET, Sensors
from vse_gym.simulation import Simulation, rollout, scenario
from vse_gym.types import Driver
from vse_gym.vehicles import load, names

UNIT = BrakeUnit()
CAR = load("qin2014")
NOTHING = np.zeros(4)
STANDING = (0.0, 0.0, 0.0)
some_examples = settings(deadline=None)  # the first example may have to compile a kernel


def rolling(vx, vy=0.0, yaw_rate=0.0, steer=0.0):
    """Readings of a car whose wheels roll without slip, (7,)."""
    along = [wheel_velocity(CAR, i, vx, vy, yaw_rate, steer)[0] for i in range(4)]
    return np.array([0.0, 0.0, 0.0, *along]) / CAR.wheel_radius


def respond(steps, dt=0.01, driver=NOTHING, added=NOTHING, release=NOTHING, memory=None, heard=None, velocity=STANDING):
    """Torques of so many control steps under one demand, (steps, 4), and the memory after."""
    memory = released_brakes(UNIT, dt) if memory is None else memory
    heard = np.zeros(7) if heard is None else heard
    torques = []
    for _ in range(steps):
        memory = brake_torques(UNIT, CAR.geometry, memory, driver, added, release, heard, velocity, 0.0, dt)
        torques.append(memory[0])
    return np.array(torques), memory


def test_the_limiter_lets_all_pass_up_to_its_lower_slip_and_nothing_from_its_upper():
    assert limiter(UNIT, -0.5) == limiter(UNIT, 0.0) == limiter(UNIT, UNIT.slip_full) == 1
    assert limiter(UNIT, UNIT.slip_none) == limiter(UNIT, 1.0) == 0
    assert limiter(UNIT, 0.5 * (UNIT.slip_full + UNIT.slip_none)) == pytest.approx(0.5, rel=1e-12)


@some_examples
@given(st.floats(-2, 2), st.floats(-2, 2))
def test_more_slip_never_lets_more_torque_pass(one, other):
    less, more = sorted((one, other))
    assert 0 <= limiter(UNIT, more) <= limiter(UNIT, less) <= 1


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
        assert np.all(memory >= 0)
        assert np.all(memory <= 4000 + CAR.brake_caps)


@some_examples
@given(st.floats(5, 40), st.floats(-3, 3), st.floats(-2, 2), st.floats(-0.2, 0.2))
def test_wheels_that_roll_in_a_turn_are_not_taken_to_slip(vx, vy, yaw_rate, steer):
    heard = rolling(vx, vy, yaw_rate, steer)
    memory = released_brakes(UNIT, 0.01)
    after = brake_torques(
        UNIT, CAR.geometry, memory, np.full(4, 700.0), NOTHING, NOTHING, heard, (vx, vy, yaw_rate), steer, 0.01
    )
    assert np.all(after[-1] == 700)


@pytest.mark.parametrize("wheel", range(4))
def test_only_the_wheel_that_locks_is_let_go(wheel):
    heard = rolling(20.0)
    heard[3 + wheel] = 0.0
    torques, _ = respond(200, driver=np.full(4, 700.0), heard=heard, velocity=(20.0, 0.0, 0.0))
    expected = np.full(4, 700.0)
    expected[wheel] = 0
    np.testing.assert_allclose(torques[-1], expected, rtol=1e-9)


def test_locked_wheels_keep_their_torque_below_the_slowest_speed():
    torques, _ = respond(200, driver=np.full(4, 700.0), velocity=(0.9 * UNIT.slowest, 0.0, 0.0))
    np.testing.assert_allclose(torques[-1], 700, rtol=1e-9)


def test_a_wheel_that_the_turning_car_carries_slowly_keeps_its_torque():
    # The inner wheels go at 3 - 0.76 x 3 and 3 - 0.80 x 3 m/s: too slow to speak of slip.
    torques, _ = respond(200, driver=np.full(4, 700.0), velocity=(3.0, 0.0, 3.0))
    np.testing.assert_allclose(torques[-1], [700, 0, 700, 0], rtol=1e-9)


@dataclass(frozen=True)
class FullBraking(Manoeuvre):
    """Straight ahead, a foot hard on the pedal."""

    torque: float = 1000.0  # of a front wheel, half of it at the rear [N m]

    def drive(self, state, time, car):
        return Driver(brake=self.torque * np.array([1.0, 1.0, 0.5, 0.5])), state

    def verdict(self, log, nominal):
        return Verdict(())


def brake_hard(car, demand, unit=UNIT):
    """Speed and braking slip (T, 4) of full braking on mu 0.4 with true speeds, for a demand in g."""
    vehicle = load(car)
    torque = demand * p.GRAVITY * vehicle.mass * vehicle.wheel_radius / 3
    named = scenario(FullBraking(friction=0.4, torque=torque, duration=9.0), car, "clean")
    log = rollout(replace(named, brake_unit=unit), "truth", "none", 0)
    speed = log.truth[:, p.VX]
    assert speed[-1] < 2
    rim = named.vehicle.wheel_radius * log.truth[:, p.WHEEL_SPEEDS]
    return log.time, speed, 1 - rim / np.maximum(speed, 0.1)[:, None]


@pytest.mark.parametrize("car", names())
def test_the_unit_keeps_wheels_from_locking_on_a_slippery_road(car):
    # A demand of 0.6 g, half as much again as the road has. The unit's delays, 80 ms, make slip swing about its
    # target, the wider the slower the car, because slip changes with R T/(Iw v).
    _, speed, slip = brake_hard(car, 0.6)
    assert slip[speed > 3].max() < 0.9


@pytest.mark.parametrize("car", names())
def test_the_unit_turns_wheels_again_that_a_panic_locks(car):
    # At 1.8 g, some 3000 N m in front, the swing reaches a lock below some 8 m/s, but no wheel stays locked.
    time, speed, slip = brake_hard(car, 1.8)
    assert slip[speed > 10].max() < 0.9
    for wheel in range(4):
        locked = (slip[:, wheel] > 0.9) & (speed > 3)
        assert locked.sum() * (time[1] - time[0]) < 0.5
    no_unit = UNIT._replace(slip_full=1.5, slip_none=2.0)
    _, speed, slip = brake_hard(car, 1.8, no_unit)
    assert np.mean(slip[(speed > 3) & (speed < 20)] > 0.99) > 0.9


@pytest.mark.parametrize("car", names())
def test_braking_with_the_unit_uses_most_of_the_friction(car):
    time, speed, _ = brake_hard(car, 0.6)
    built_up = (speed > 5) & (time > 0.3)
    slowing = -np.polyfit(time[built_up], speed[built_up], 1)[0]
    most = getattr(load(car).front_tyre, "peak_x", 1.0063)  # the polynomial's plateau, or the Magic Formula's peak
    assert 0.85 < slowing / (0.4 * p.GRAVITY) < most  # chosen: no less than 85 %


def test_a_wheel_sensor_that_has_not_spoken_yet_is_not_taken_for_a_locked_wheel():
    always_silent = Sensors(QUIET, silence_rate=1e6)
    drive = scenario(FullBraking(torque=500.0), "qin2014", always_silent)
    simulation = Simulation(drive, "truth")
    simulation.reset(0)
    for _ in range(30):
        frame = simulation.step()
    # 0.3 s less the dead time are 5.6 lags, which leave 0.4 % of the step.
    np.testing.assert_allclose(frame.brake, [500, 500, 250, 250], rtol=0.01)
