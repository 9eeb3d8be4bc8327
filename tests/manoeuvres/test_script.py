"""The compiled driver against a plain one, and what every script keeps so that one machine code drives them all."""

import math
import pickle
from dataclasses import dataclass, replace

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.catalogue import MANOEUVRES
from vse_gym.compiled import hold
from vse_gym.manoeuvres.base import Verdict
from vse_gym.manoeuvres.double_lane_change import DoubleLaneChange
from vse_gym.manoeuvres.driver import DRIVER, Skill, Steering, pedals, practised
from vse_gym.manoeuvres.held_steer import HeldSteer
from vse_gym.manoeuvres.path import STEP, STRAIGHT, Circle, Line
from vse_gym.manoeuvres.script import FOLLOW, HOLD, TURN_ON, TURN_TO, Task, drive_at, first_memory, script_of
from vse_gym.manoeuvres.scripted import AtWheel, Bounds, Scripted, is_scripted
from vse_gym.physics import parameters as p
from vse_gym.types import Car
from vse_gym.vehicles import load

DT = 0.01
VEHICLE = load("qin2014")
SWING = Line(((20.0, 50.0, 3.5), (70.0, 100.0, -1.0)))
PATHS = (STRAIGHT, SWING, Circle(90.0), Circle(-60.0, 25.0))
OTHER = Steering(points=9, delay=0.03, lag=0.2, rate=4.0, limit=2.0)
every_manoeuvre = pytest.mark.parametrize("name", MANOEUVRES)


# -- a plain driver, in road-wheel angles ----------------------------------------------------------------------------


def seen_ahead(path, x, y, yaw, ahead):
    """Where the line lies at distances ahead, in the car's axes, its y alone."""
    if isinstance(path, Line):
        grid = np.arange(0.0, 200.0, STEP)
        points = np.column_stack((x + ahead, np.interp(x + ahead, grid, path.at(grid))))
    else:
        centre = np.array([path.straight, path.radius])
        away = np.array([x, y]) - centre
        bearing = math.atan2(away[0] * math.copysign(1, path.radius), -away[1] * math.copysign(1, path.radius))
        way = abs(path.radius) * math.copysign(1, path.radius) * bearing  # along the circle, from where it begins
        if x < path.straight and path.straight > 0:
            way = x - path.straight
        way = way + ahead
        turn = way / path.radius
        points = centre + path.radius * np.column_stack((np.sin(turn), -np.cos(turn)))
        before = (way < 0) & (path.straight > 0)
        points[before] = np.column_stack((path.straight + way, np.zeros_like(way)))[before]
    turned = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    return ((points - [x, y]) @ turned.T)[:, 1]


def decided(driver, path, state, angle, pending):
    """The road-wheel angle that he decides on, from the regulator's table."""
    reach = driver.preview * np.arange(1, driver.points + 1) / driver.points
    skill = Skill(tuple(reach.tolist()), driver.calm, driver.heading, driver.lag, round(driver.delay / DT), DT)
    table, speeds = practised(VEHICLE, skill), np.arange(3.0, 61.0)
    speed = np.clip(state[p.VX], 3, 60)
    felt = [np.clip(state[p.VY], -speed, speed), np.clip(state[p.YAW_RATE], -10, 10), angle, *pending]
    sensed = np.concatenate((seen_ahead(path, state[p.X], state[p.Y], state[p.YAW], speed * reach), felt))
    gains = np.array([np.interp(speed, speeds, column) for column in table.T])
    most = driver.limit / VEHICLE.steering_ratio
    return np.clip(gains @ sensed, -most, most)


@st.composite
def situations(draw):
    """A car, a memory of the driver's, his line, and one line of a script."""
    state, wild = np.zeros(p.STATE_SIZE), draw(st.booleans())
    state[p.X], state[p.VX] = draw(st.floats(-50, 150)), draw(st.floats(-5, 80))
    # A tame car, for which he rarely turns the hand wheel as far as it goes, and one beyond all limits
    for place, tame, any_ in ((p.Y, 1, 8), (p.YAW, 0.1, 3), (p.VY, 1, 20), (p.YAW_RATE, 0.5, 12), (p.AY, 6, 12)):
        most = any_ if wild else tame
        state[place] = draw(st.floats(-most, most))
    driver, path = draw(st.sampled_from((DRIVER, OTHER))), draw(st.sampled_from(PATHS))
    angles = st.floats(-0.3, 0.3)
    memory = draw(angles), draw(st.floats(0, 2.5)), draw(st.lists(angles, min_size=11, max_size=11))
    row = {
        "hands": draw(st.sampled_from((FOLLOW, FOLLOW, FOLLOW, HOLD, TURN_TO, TURN_ON))),
        "hand_wheel": draw(st.floats(-3, 3)),
        "speed": draw(st.one_of(st.just(math.nan), st.floats(0, 60))),
        "acceleration": draw(st.floats(0, 3)),
        "deceleration": draw(st.floats(0, 9)),
        "lifts": draw(st.one_of(st.just(math.inf), st.floats(-50, 150))),
        "stops": draw(st.one_of(st.just(math.inf), st.floats(0, 10))),
    }
    return driver, path, state, memory, row


@given(situations())
def test_the_driver_does_what_a_plain_one_does(situation):
    driver, path, state, (angle, pressed, waiting), row = situation
    ratio, waiting = VEHICLE.steering_ratio, waiting[: round(driver.delay / DT) + 1]
    script = script_of(np.zeros(1), **row)
    task = Task(script, path.guide, driver.arms(VEHICLE, DT), pedals(VEHICLE, DT), STRAIGHT.guide, math.inf, DT)
    memory = np.array([ratio * angle, pressed, *(ratio * a for a in waiting)])
    before = memory.copy()
    hand_wheel, drive, brake, after = drive_at(hold(task), memory, 0.0, state)
    np.testing.assert_array_equal(memory, before)
    # Hands
    expected, pending = ratio * angle, waiting
    if row["hands"] == FOLLOW:
        change = (1 - math.exp(-DT / driver.lag)) * (waiting[0] - angle)
        expected += ratio * np.clip(change, -driver.rate * DT / ratio, driver.rate * DT / ratio)
        pending = [*waiting[1:], decided(driver, path, state, angle, waiting)]
    elif row["hands"] == TURN_TO:
        expected = row["hand_wheel"]
    elif row["hands"] == TURN_ON and abs(state[p.AY]) < row["stops"]:
        expected += DT * row["hand_wheel"]
    # The same sums in another order, of angles of up to 7 rad of which 30 gains of up to 10 make one
    np.testing.assert_allclose([hand_wheel, *after[2:]], [expected, *(ratio * a for a in pending)], atol=1e-9)
    # Foot
    if state[p.X] > row["lifts"]:
        pressed = 0.0
    elif math.isnan(row["speed"]):
        pressed = row["acceleration"]
    else:
        needle = round(math.hypot(state[p.VX], state[p.VY]) * 1.8) / 1.8  # a mark every 2 km/h
        wanted = np.clip(2.0 * (row["speed"] - needle), 0.0, 2.5)
        pressed += (1 - math.exp(-DT / 0.3)) * (wanted - pressed)
    torque = VEHICLE.mass * VEHICLE.wheel_radius
    assert drive.sum() == pytest.approx(torque * pressed, abs=1e-9)
    assert brake.sum() == pytest.approx(torque * row["deceleration"], abs=1e-9)
    assert after[0] == hand_wheel and after[1] == pytest.approx(pressed, abs=1e-12)


def mirrored(path):
    return (
        Line(tuple((a, b, -c) for a, b, c in path.swings))
        if isinstance(path, Line)
        else Circle(-path.radius, path.straight)
    )


@given(situations())
def test_a_mirrored_car_makes_the_driver_do_the_mirror_image_bit_by_bit(situation):
    driver, path, state, (angle, pressed, waiting), row = situation
    odd, acted = [p.Y, p.YAW, p.VY, p.YAW_RATE, p.AY], []
    for side in (1.0, -1.0):
        seen, line = state.copy(), path if side > 0 else mirrored(path)
        seen[odd] *= side
        script = script_of(np.zeros(1), **row | {"hand_wheel": side * row["hand_wheel"]})
        task = Task(script, line.guide, driver.arms(VEHICLE, DT), pedals(VEHICLE, DT), STRAIGHT.guide, math.inf, DT)
        memory = np.array([side * angle, pressed, *(side * a for a in waiting[: round(driver.delay / DT) + 1])])
        hand_wheel, drive, brake, after = drive_at(hold(task), memory, 0.0, seen)
        acted.append([side * hand_wheel, *drive, *brake, after[1], *(side * after[2:])])
    np.testing.assert_array_equal(*acted)


# -- scripts ----------------------------------------------------------------------------------------------------------


@every_manoeuvre
def test_one_machine_code_drives_every_manoeuvre_also_after_pickling(name):
    manoeuvre = MANOEUVRES.make(name)
    assert is_scripted(manoeuvre)
    task, memory = manoeuvre.at_wheel(VEHICLE, DT)
    one = numba.typeof(HeldSteer().task(VEHICLE, DT))
    whole = replace(manoeuvre, duration=30, speed=round(manoeuvre.speed))  # settings may be whole numbers
    for same in (task.value, pickle.loads(pickle.dumps(task)).value, whole.task(VEHICLE, DT)):
        assert numba.typeof(same) == one
    assert memory.dtype == np.float64 and memory.ndim == 1 and not memory.any()
    assert task.value.script.hands.size == round(manoeuvre.duration / DT) + 1


@pytest.mark.parametrize("dt", [0.005, 0.01, 0.02])
def test_each_step_finds_its_own_line_of_the_script_and_later_ones_the_last(dt):
    steps = 4001
    script = script_of(np.zeros(steps), TURN_TO, np.arange(float(steps)))
    task = HeldSteer().task(VEHICLE, dt)._replace(script=script)
    held, memory, state = hold(task), first_memory(task), np.zeros(p.STATE_SIZE)
    for k in (*range(-1, steps), steps, 10 * steps):
        assert drive_at(held, memory, k * dt, state)[0] == min(max(k, 0), steps - 1)


@pytest.mark.parametrize("column", ["hands", "hand_wheel", "speed", "acceleration", "deceleration"])
def test_a_script_with_a_column_of_another_length_is_refused(column):
    with pytest.raises(ValueError, match="broadcast"):
        script_of(np.zeros(5), **{column: np.zeros(4)})


@dataclass(frozen=True)
class Lost(Scripted):
    """Follows a line that is not there; ends 2 m beside a circle."""

    def script(self, times):
        return script_of(times, FOLLOW)

    def bounds(self, vehicle):
        return Bounds(Circle(50.0), 2.0)

    def verdict(self, log, nominal):
        return Verdict(())


def test_whoever_follows_a_line_needs_one():
    with pytest.raises(ValueError, match="Lost: its script follows a line, but it has no path"):
        Lost().at_wheel(VEHICLE, DT)


def test_a_drive_is_over_where_its_bounds_say():
    state = np.zeros(p.STATE_SIZE)
    for y, over in (
        (0.0, False),
        (1.9, False),
        (2.1, True),
        (-1.9, False),
        (-2.1, True),
        (98.5, False),
        (math.nan, False),
    ):
        state[p.Y] = y
        assert Lost().off_course(Car(state), VEHICLE) is over
        assert HeldSteer().off_course(Car(state), VEHICLE) is False


def test_whoever_takes_the_wheel_himself_is_not_driven_by_machine_code():
    class Oversteers(DoubleLaneChange):
        def drive(self, state, time, car):
            driver, state = super().drive(state, time, car)
            return driver._replace(hand_wheel=1.1 * driver.hand_wheel), state

    class OtherEnd(HeldSteer):
        def off_course(self, car, vehicle):
            return car.vx < 1.0

    class OtherStart(HeldSteer):
        def init(self, nominal):
            return AtWheel(*super().init(nominal))

    class OtherScript(HeldSteer):
        def script(self, times):
            return super().script(times)._replace(lifts=1.0)

    assert [is_scripted(kind()) for kind in (Oversteers, OtherEnd, OtherStart, OtherScript)] == [False] * 3 + [True]
