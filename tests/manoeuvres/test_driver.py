"""The driver: stable with every car, honest about his limits, and alike to both sides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_discrete_are

from vse_gym.compiled import hold
from vse_gym.manoeuvres.driver import DRIVER, Skill, Steering, pedals, practised, riccati, stepped
from vse_gym.manoeuvres.path import STRAIGHT, Circle, Line
from vse_gym.manoeuvres.script import (
    FASTEST,
    FOLLOW,
    NEEDLE,
    PRESSED,
    SLOWEST,
    Task,
    drive_at,
    first_memory,
    script_of,
)
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.vehicles import load, names

DT = 0.01
KMH = 1 / 3.6
every_car = pytest.mark.parametrize("car", names())


def followed(vehicle, path, speed=20.0, driver=DRIVER, dt=DT):
    """A driver who follows a line and holds a speed for ever: his task, held, and his memory at the start."""
    script = script_of(np.zeros(1), FOLLOW, speed=speed)
    task = Task(script, path.guide, driver.arms(vehicle, dt), pedals(vehicle, dt), STRAIGHT.guide, math.inf, dt)
    return hold(task), first_memory(task)


def skill_of(driver, dt=DT):
    reach = driver.preview * (1 + np.arange(driver.points)) / driver.points
    return Skill(tuple(reach.tolist()), driver.calm, driver.heading, driver.lag, round(driver.delay / dt), dt)


def delayed(vehicle, skill, speed):
    """The linear car with the driver's arms and the angles on their way: F (5 + waiting, 5 + waiting) and b."""
    ((prompt,), _), waiting = stepped(vehicle, skill, np.array([speed])), skill.delay + 1
    f, b = np.zeros((5 + waiting, 5 + waiting)), np.zeros(5 + waiting)
    f[:5, :6] = prompt[:5]
    f[5:-1, 6:] = np.eye(waiting - 1)
    f[-1, -1] = b[-1] = 1.0
    return f, b


def looped(vehicle, speed, more_delay=0):
    """The linear car and the driver in one matrix, his delay some steps longer than he knows."""
    skill = skill_of(DRIVER)
    reach = np.array(skill.reach)
    gain = practised(vehicle, skill)[speed - SLOWEST]
    ahead, rest = gain[: reach.size], gain[reach.size :]
    f, _ = delayed(vehicle, skill._replace(delay=skill.delay + more_delay), float(speed))
    f[-1] = 0.0
    f[-1, :2] = -ahead.sum(), -(ahead * reach).sum() * speed  # offset and heading, as the line ahead shows them
    f[-1, 2:5] = rest[:3]
    f[-1, 5 + more_delay :] = rest[3:]
    return f


@every_car
@pytest.mark.parametrize("speed", [3.0, 15.0, 27.0, 60.0])
def test_the_car_in_steps_is_the_single_track_s_exponential(car, speed):
    vehicle, skill = load(car), skill_of(DRIVER)
    cf, cr = 2 * vehicle.front_tyre.cornering_stiffness, 2 * vehicle.rear_tyre.cornering_stiffness
    # From forces: Fyf = cf (steer - (vy + lf r)/v), Fyr = -cr (vy - lr r)/v, column by column.
    a = np.zeros((6, 6))
    for k, (vy, r, steer) in enumerate(np.eye(3)):
        fyf, fyr = cf * (steer - (vy + vehicle.lf * r) / speed), -cr * (vy - vehicle.lr * r) / speed
        a[2, 2 + k] = (fyf + fyr) / vehicle.mass - speed * r
        a[3, 2 + k] = (vehicle.lf * fyf - vehicle.lr * fyr) / vehicle.yaw_inertia
    a[0, 1], a[0, 2], a[1, 3] = speed, 1.0, 1.0
    a[4, 4:] = np.array([-1.0, 1.0]) / skill.lag
    (f,), _ = stepped(vehicle, skill, np.array([speed]))
    np.testing.assert_allclose(f, expm(a * DT), rtol=1e-10, atol=1e-12)


@every_car
def test_the_gains_are_those_of_scipy_s_regulator_that_knows_every_angle_on_its_way(car):
    # With the delay as states of their own, the textbook's regulator; the driver solves without them and looks ahead.
    vehicle, skill, speed = load(car), skill_of(DRIVER), 22.0
    f, b = delayed(vehicle, skill, speed)
    prices = np.diag([1.0, (skill.heading * speed) ** 2, *np.zeros(b.size - 2)])
    price = (skill.calm / DT) ** 2
    cost = solve_discrete_are(f, b[:, None], prices, np.array([[price]]))
    gain = b @ cost @ f / (price + b @ cost @ b)
    gain[-1] -= 1
    mine = practised(vehicle, skill)[int(speed) - SLOWEST][len(skill.reach) :]
    np.testing.assert_allclose(mine, -gain[2:], rtol=1e-6, atol=1e-8)  # the equation's own condition


def test_the_doubling_solves_the_riccati_equation():
    vehicle, skill = load("qin2014"), skill_of(DRIVER)
    speeds = np.array([3.0, 20.0, 60.0])
    f, b = stepped(vehicle, skill, speeds)
    prices = np.array([[1.0, 0.5, 0.0, 0.0, 0.0, 0.0]] * 3)
    for a, p_, q in zip(f, riccati(f, b, prices, 9.0), prices, strict=True):
        next_ = np.diag(q) + a.T @ p_ @ a - np.outer(a.T @ p_ @ b, b @ p_ @ a) / (9.0 + b @ p_ @ b)
        np.testing.assert_allclose(next_, p_, rtol=1e-7, atol=1e-7 * np.abs(p_).max())


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
    (task, memory), state = followed(vehicle, path, speed, driver), rolling_start(vehicle, speed)
    state[p.Y], state[p.YAW] = offset, yaw
    states, angles = [state], [0.0]
    for _ in range(round(seconds / DT)):
        angle, torque, _, memory = drive_at(task, memory, 0.0, state)
        inputs = p.Inputs(angle / vehicle.steering_ratio, torque, np.zeros(4))
        state = advance(vehicle, p.road((0.0, 0.9)), state, inputs, 10, 1e-3)
        states.append(state)
        angles.append(angle)
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
    task, memory = followed(vehicle, path)
    last = 0.0
    for _ in range(30):
        angle, _, _, memory = drive_at(task, memory, 0.0, state)
        assert abs(angle - last) <= DRIVER.rate * DT * (1 + 1e-9)
        assert abs(angle) <= DRIVER.limit * (1 + 1e-9)
        last = angle


@pytest.mark.parametrize("dt", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2])
def test_hands_begin_to_move_when_the_delay_is_over(delay, dt):
    driver, vehicle = Steering(delay=delay), load("qin2014_understeer")
    (task, memory), state = followed(vehicle, STRAIGHT, driver=driver, dt=dt), rolling_start(vehicle, 20.0)
    state[p.Y] = 1.0
    moved = []
    for _ in range(round(0.4 / dt)):
        angle, _, _, memory = drive_at(task, memory, 0.0, state)
        moved.append(angle != 0)
    # What he sees now he decides on now, and begins after the delay.
    assert moved.index(True) * dt == pytest.approx(delay + dt)


@given(st.floats(SLOWEST, FASTEST - 1e-6))
def test_gains_go_over_into_each_other_without_a_jump(speed):
    vehicle = load("qin2014_understeer")
    state = rolling_start(vehicle, speed)
    state[p.Y], state[p.VY], state[p.YAW_RATE] = 0.3, 0.2, 0.1
    task, memory = followed(vehicle, STRAIGHT)
    wanted = []
    for v in (speed, speed + 1e-7):
        state[p.VX] = v
        wanted.append(drive_at(task, memory, 0.0, state)[3][-1])
    assert wanted[1] == pytest.approx(wanted[0], abs=1e-6 * vehicle.steering_ratio)


@every_car
def test_pedals_give_the_acceleration_that_is_asked_for(car):
    vehicle = load(car)
    feet = pedals(vehicle, DT)
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


def test_the_foot_does_not_tell_a_speed_more_finely_than_the_needle_shows():
    # Estimators know the drive torque: two speeds that the needle shows alike must press the pedal alike.
    vehicle = load("qin2014")
    task, memory = followed(vehicle, STRAIGHT, 80 / 3.6)
    states = [rolling_start(vehicle, v / 3.6) for v in (77.1, 78.9, 79.1)]
    pressed = [drive_at(task, memory, 0.0, state)[3][PRESSED] for state in states]
    assert pressed[0] == pressed[1] > pressed[2] == 0.0


def test_the_foot_holds_the_speed_that_the_needle_shows():
    states, _ = run(load("qin2014_understeer"), Circle(100.0), 18.0, 20.0)
    speed = np.hypot(states[:, p.VX], states[:, p.VY])
    assert np.abs(speed[1000:] - 18.0).max() < 1.5 * NEEDLE  # half a needle's step, and the foot's delay


def test_the_driver_knows_his_own_car_whatever_estimators_are_told():
    drives = []
    for mass in (1.0, 1.25):
        cell = scenario("double_lane_change", "qin2014_understeer", "clean", speed=22.0)
        other = cell.vehicle._replace(mass=cell.vehicle.mass * mass)
        log = rollout(replace(cell, nominal=replace(cell.nominal, vehicle=other)), "truth", "none", 0)
        drives.append(log.hand_wheel)
    np.testing.assert_array_equal(*drives)
