"""The brake unit as an ABS: a foot hard on the pedal, on every car, on uniform, changing and split friction."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from vse_gym.controllers.esc import StabilityControl
from vse_gym.manoeuvres.base import Manoeuvre, Verdict
from vse_gym.physics import parameters as p
from vse_gym.physics.brakes import BELIEFS, ROAD, BrakeUnit, brake_torques, released_brakes
from vse_gym.physics.double_track import CONTACT, FX, advance, contact, rolling_start
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Driver
from vse_gym.vehicles import load, names

DEG = math.pi / 180
UNIT = BrakeUnit()
OFF = UNIT._replace(slip=90.0, slip_added=9.0, enter=math.inf)
SOME_CARS = ("qin2014", "tian2018_electric")  # with a plateau behind the tyre's peak, and with a fall
PANIC = 1.8  # demand [g]: twice what a dry road has

every_car = pytest.mark.parametrize("car", names())
some_cars = pytest.mark.parametrize("car", SOME_CARS)


@dataclass(frozen=True)
class Stop(Manoeuvre):
    """A foot hard on the pedal, from a road's friction to another's at 15 m, or from left to right."""

    after: float = 0.0  # friction from 15 m on; 0: no change [-]
    right: float = 0.0  # friction on the right; 0: as on the left [-]
    hand_wheel: float = 0.0  # held [rad]
    steering: float = 0.0  # road-wheel angle against the heading, 0.15 s late [-]
    torque: float = 3000.0  # of a front wheel, half of it at the rear [N m]
    duration: float = 14.0

    def road(self):
        uniform = p.road((0.0, self.friction), (15.0, self.after or self.friction))
        return uniform._replace(friction_right=np.full(2, self.right)) if self.right else uniform

    def init(self, nominal):
        return nominal.vehicle.steering_ratio, (0.0,) * 15

    def drive(self, state, time, car):
        ratio, seen = state
        wish = -ratio * self.steering * (car.yaw + 0.2 * car.yaw_rate + 0.03 * car.y)
        brake = self.torque * np.array([1.0, 1.0, 0.5, 0.5])
        return Driver(self.hand_wheel + seen[0], brake=brake), (ratio, (*seen[1:], max(-6.0, min(6.0, wish))))

    def off_course(self, car, vehicle):
        return math.hypot(car.vx, car.vy) < 1.0

    def verdict(self, log, nominal):
        return Verdict(())


@cache
def drive(car, friction, estimator="truth", law="none", unit=UNIT, sensors="gaussian", **settings):
    """Log of full braking from 80 km/h, and the braking slip of each wheel (T, 4)."""
    vehicle = load(car)
    torque = PANIC * p.GRAVITY * vehicle.mass * vehicle.wheel_radius / 3
    cell = scenario(Stop(friction=friction, torque=torque, **settings), car, sensors)
    log = rollout(replace(cell, brake_unit=unit), estimator, law, 0)
    speed = np.maximum(log.truth[:, p.VX], 0.1)
    return log, 1 - vehicle.wheel_radius * log.truth[:, p.WHEEL_SPEEDS] / speed[:, None]


def way(log):
    return log.truth[-1, p.DISTANCE]


def longest_lock(log, slip, above):
    """[s]."""
    locked = (slip > 0.95) & (log.truth[:, p.VX] > above)[:, None]
    return 0.01 * locked.sum(axis=0).max()


@pytest.mark.parametrize("friction", [0.9, 0.4, 0.2])
@every_car
def test_with_true_speeds_no_wheel_locks_and_nine_tenths_of_the_friction_are_used(car, friction):
    log, slip = drive(car, friction)
    speed = log.truth[:, p.VX]
    assert slip[speed > 8].max() < 0.5
    # No slip brakes harder than the peak: the polynomial's plateau, or the Magic Formula's. Once built up, the unit is
    # to stay within 10 % of that.
    peak = getattr(load(car).front_tyre, "peak_x", 1.0063)
    built_up = (log.time > 0.5) & (speed > 3)
    slowing = -np.polyfit(log.time[built_up], speed[built_up], 1)[0]
    assert 0.9 < slowing / (peak * friction * p.GRAVITY) < 1.001


@pytest.mark.parametrize("friction", [0.9, 0.4])
@every_car
def test_the_car_stops_no_later_than_with_locked_wheels(car, friction):
    locked, slip = drive(car, friction, unit=OFF)
    assert longest_lock(locked, slip, 3) > 1
    falls = hasattr(load(car).front_tyre, "peak_x")  # behind a plateau locked wheels brake as well as any
    assert way(drive(car, friction)[0]) < way(locked) * (0.9 if falls else 1.001)


@pytest.mark.parametrize("sensors", ["gaussian", "dropout", "outliers"])
@pytest.mark.parametrize("friction", [0.9, 0.4])
@some_cars
def test_with_estimated_speeds_no_wheel_locks_either(car, friction, sensors):
    log, slip = drive(car, friction, "ekf", sensors=sensors)
    assert slip[log.truth[:, p.VX] > 8].max() < 0.7  # bursts in the accelerometer reach the estimated speed
    assert way(log) < 1.1 * way(drive(car, friction)[0])


@some_cars
def test_where_the_road_turns_slippery_locked_wheels_turn_again(car):
    # What brakes at 0.9 is 1 kN m too much at 0.2, and the unit's delays make a wheel stand by the time it lets go.
    for estimator in ("truth", "ekf"):
        log, slip = drive(car, 0.9, estimator, after=0.2)
        assert longest_lock(log, slip, 8) < 0.25
        late = log.truth[:, p.DISTANCE] > 35
        assert slip[late & (log.truth[:, p.VX] > 5)].max() < 0.6


@some_cars
def test_where_the_road_gets_grip_the_torque_follows(car):
    log, _ = drive(car, 0.2, after=0.9)
    jump = np.argmax(log.truth[:, p.DISTANCE] > 15)
    slowing = -log.truth[jump:, p.AX] / p.GRAVITY
    assert 0.01 * np.argmax(slowing > 0.8) < 1.2  # the unit has no way to know but by trying


@some_cars
def test_the_car_can_be_steered_while_it_brakes(car):
    # An eighth of a turn of the hand wheel to the left: 2 s later the car is a lane's width aside, or still in its own.
    free, locked = (drive(car, 0.4, unit=unit, hand_wheel=45 * DEG)[0].truth for unit in (UNIT, OFF))
    assert free[200, p.Y] > 2.0
    assert abs(locked[200, p.Y]) < 0.3
    assert np.degrees(np.abs(np.arctan2(free[:300, p.VY], free[:300, p.VX]))).max() < 15


# -- split friction -------------------------------------------------------------------------------------------------

SPLIT = {"right": 0.3}


def heading(log):
    """Largest |heading| [rad]."""
    return np.abs(log.truth[:, p.YAW]).max()


@pytest.mark.parametrize("estimator", ["truth", "ekf"])
@some_cars
def test_on_split_friction_a_driver_holds_the_heading_and_locked_wheels_do_not_let_him(car, estimator):
    log, slip = drive(car, 0.9, estimator, steering=0.8, **SPLIT)
    assert heading(log) < 15 * DEG
    assert slip[log.truth[:, p.VX] > 8].max() < 0.5
    # All that both sides have, and 0.15 s to build up. The best slip, if all wheels have the same, takes 5-10 % more.
    mean = 0.5 * (0.9 + 0.3)
    assert way(log) < 1.15 * (0.15 * 80 / 3.6 + (80 / 3.6) ** 2 / (2 * mean * p.GRAVITY))
    assert heading(drive(car, 0.9, unit=OFF, steering=0.8, **SPLIT)[0]) > 30 * DEG


def test_without_the_delay_of_the_yaw_moment_the_driver_loses_the_oversteering_car():
    at_once = UNIT._replace(yaw_build_up_front=math.inf, yaw_build_up_rear=math.inf)
    assert heading(drive("qin2014", 0.9, unit=at_once, steering=0.8, **SPLIT)[0]) > 30 * DEG


@some_cars
def test_with_hands_off_only_a_release_of_the_drivers_brake_keeps_the_car_from_turning_round(car):
    # To brake the other side more is in vain: it has no friction to give.
    none = heading(drive(car, 0.9, **SPLIT)[0])
    kept = heading(drive(car, 0.9, law=StabilityControl(whole_release=math.inf), **SPLIT)[0])
    released = heading(drive(car, 0.9, law="esc", **SPLIT)[0])
    assert none > 90 * DEG
    assert kept > 90 * DEG
    assert released < 45 * DEG


# -- what it stands on ----------------------------------------------------------------------------------------------


@some_cars
@pytest.mark.parametrize("friction", [0.9, 0.3])
def test_what_the_road_gives_a_wheel_is_observed(car, friction):
    # The tyres' own force times the radius, mean over each control step; the observer averages over some 2 steps.
    vehicle, road, h, steps = load(car), p.road((0.0, friction)), 1e-3, 10
    state, memory = rolling_start(vehicle, 20.0), released_brakes(UNIT, steps * h)
    heard, wheels, driver = np.zeros(10), np.empty((4, CONTACT)), np.array([500.0, 500.0, 250.0, 250.0])
    seen, true = [], []
    for _ in range(60):
        heard[0], heard[3:7] = state[p.AX], state[p.WHEEL_SPEEDS]
        velocity = tuple(state[[p.VX, p.VY, p.YAW_RATE]])
        memory = brake_torques(
            UNIT, vehicle.geometry, memory, driver, np.zeros(4), np.zeros(4), heard, velocity, 0.0, steps * h
        )
        seen.append(memory[ROAD])
        gives = np.zeros(4)
        for _ in range(steps):
            state = advance(vehicle, road, state, p.Inputs(0.0, np.zeros(4), memory[0]), 1, h)
            contact(vehicle, road, state, 0.0, wheels)
            gives -= wheels[:, FX] * vehicle.wheel_radius / steps
        true.append(gives)
    np.testing.assert_allclose(seen[41:], true[40:-1], atol=0.05 * np.max(true))


def test_a_wheel_that_the_stability_control_brakes_may_slip_more():
    # Alone on a slippery road, 3000 N m on the front left wheel: the driver's ABS would hold it at 0.12 a/g.
    vehicle, road = load("qin2014"), p.road((0.0, 0.4))
    state, memory, heard = rolling_start(vehicle, 25.0), released_brakes(UNIT, 0.01), np.zeros(10)
    slips = []
    for k in range(150):
        heard[0], heard[3:7] = state[p.AX], state[p.WHEEL_SPEEDS] * (1 + 1e-9 * (k % 2))
        added, none = np.array([3000.0, 0.0, 0.0, 0.0]), np.zeros(4)
        velocity = (state[p.VX], 0.0, 0.0)
        memory = brake_torques(UNIT, vehicle.geometry, memory, none, added, none, heard, velocity, 0.0, 0.01)
        state = advance(vehicle, road, state, p.Inputs(0.0, none, memory[0]), 10, 1e-3)
        state[[p.VY, p.YAW_RATE]] = 0.0  # led straight on
        slips.append(1 - vehicle.wheel_radius * state[p.WHEEL] / state[p.VX])
    assert np.mean(slips[60:]) == pytest.approx(UNIT.slip_added, abs=0.03)
    assert max(slips[20:]) < UNIT.slip_added + 0.15


def test_the_memory_of_an_idle_unit_is_empty_and_as_deep_as_its_dead_time():
    assert released_brakes(UNIT, 0.01).shape == (1 + 2 + BELIEFS, 4)
    assert not released_brakes(UNIT, 0.01).any()
