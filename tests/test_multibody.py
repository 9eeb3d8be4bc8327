"""CommonRoad's multi-body car in our axes: signs, brakes, where it starts, stops and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vse_gym import multibody
from vse_gym.multibody import CARS, MultiBody, loads, parameters, project
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.vehicles import load

NOTHING = np.zeros(4)
DRY = p.road((0.0, 0.8))
every_car = pytest.mark.parametrize("name", CARS)


def drive(plant, speed, steps, steer=0.0, drive=NOTHING, brake=NOTHING):
    """States at every 10 ms, (steps + 1, STATE_SIZE); steer is an angle or one for each step."""
    bodies, state = plant.start(speed)
    states = [state]
    for angle in np.broadcast_to(steer, steps):
        bodies, state = plant.advance(bodies, state, p.Inputs(float(angle), drive, brake), 0.01)
        states.append(state)
    return np.array(states)


def per_wheel(*torques):
    return np.array(torques, dtype=float)


def test_the_projection_names_each_of_the_library_s_states_in_our_axes_and_wheel_order():
    x, dx = [float(k) for k in range(29)], [0.1 * k for k in range(29)]
    state = project(x, dx, distance=50.0, work=60.0)
    expected = np.zeros(p.STATE_SIZE)
    expected[[p.X, p.Y, p.YAW, p.VX, p.VY, p.YAW_RATE]] = 0, 1, 4, 3, 10, 5
    expected[p.WHEEL_SPEEDS] = 24, 23, 26, 25  # its left is our right
    expected[[p.DISTANCE, p.BRAKE_WORK]] = 50, 60
    expected[p.AX] = 0.3 - 5 * 10  # dvx/dt - r vy
    expected[p.AY] = 1.0 + 5 * 3  # dvy/dt + r vx
    expected[[p.ROLL, p.ROLL_RATE]] = -6, -7  # z-down there
    np.testing.assert_allclose(state, expected, rtol=1e-12)


@every_car
def test_a_left_turn_is_one_in_every_channel(name):
    last = drive(MultiBody(load(name), DRY), 20.0, 150, steer=0.02)[-1]
    assert all(last[k] > 0 for k in (p.Y, p.YAW, p.YAW_RATE, p.AY, p.ROLL))
    left, right = last[p.WHEEL], last[p.WHEEL + 1]
    car = load(name)
    # free wheels turn as fast as the ground passes, the outer ones by the track times the yaw rate faster, but for
    # the slip at which the library's tyre rolls free: it grows with the load, to 1.1e-3 of the speed here
    assert (right - left) * car.wheel_radius == pytest.approx(car.track_front * last[p.YAW_RATE], abs=0.025)
    left, right = last[p.WHEEL + 2], last[p.WHEEL + 3]
    assert (right - left) * car.wheel_radius == pytest.approx(car.track_rear * last[p.YAW_RATE], abs=0.025)


@every_car
@pytest.mark.parametrize("wheel", range(4))
def test_one_braked_or_driven_wheel_turns_the_car_as_it_turns_the_double_track(name, wheel):
    car, torque = load(name), 200 * np.eye(4)[wheel]
    for kind, side in (("brake", 1), ("drive", -1)):
        yaw_rate = drive(MultiBody(car, DRY), 20.0, 30, **{kind: torque})[-1, p.YAW_RATE]
        inputs = p.Inputs(0.0, NOTHING, NOTHING)._replace(**{kind: torque})
        other = advance(car, DRY, rolling_start(car, 20.0), inputs, 300, 1e-3)[p.YAW_RATE]
        assert np.sign(yaw_rate) == (side if wheel % 2 == 0 else -side)
        assert yaw_rate == pytest.approx(other, rel=0.2)  # its slipping tyre also pulls sideways (r_vy1): 3 to 17 %


@every_car
def test_runs_straight_from_its_springs_rest_without_a_jump(name):
    plant = MultiBody(load(name), DRY)
    states = drive(plant, 80 / 3.6, 500)
    # 111 m on, what is left is the tyre's sideways pull of a rolling wheel (r_vy1): 1e-3 of the load
    assert np.abs(states[:, [p.AX, p.AY]]).max() < 0.02
    assert np.degrees(np.abs(states[:, p.YAW_RATE]).max()) < 0.05
    assert np.degrees(np.abs(states[:, p.ROLL]).max()) < 0.02
    assert abs(states[-1, p.Y]) < 0.5
    assert states[-1, p.VX] == pytest.approx(80 / 3.6, abs=1e-3)  # nothing drags


@every_car
def test_the_body_starts_where_its_springs_carry_it(name):
    plant = MultiBody(load(name), DRY)
    bodies, state = plant.start(20.0)
    after = plant.advance(bodies, state, p.Inputs(0.0, NOTHING, NOTHING), 0.01)[0]
    upright = [multibody.HEAVE, multibody.PITCH, multibody.HEAVE_FRONT, multibody.HEAVE_REAR]
    # the library's own start lets the body fall by 17 mm: 0.5 mm within this time
    np.testing.assert_allclose(np.array(after)[upright], np.array(bodies)[upright], atol=2e-6)


def test_with_the_library_s_offsets_a_straight_running_car_hunts():
    # Why they are off: their sign is that of a camber angle which is zero on average.
    states = drive(MultiBody(load("bmw_320i"), DRY, offsets=True), 80 / 3.6, 500)
    assert np.ptp(states[300:, p.AY]) > 0.2


@every_car
def test_a_mirrored_hand_wheel_gives_the_mirrored_drive(name):
    plant = MultiBody(load(name), DRY)
    steer = 0.03 * np.sin(2 * np.pi * 0.7 * 0.01 * np.arange(143))
    left, right = (drive(plant, 20.0, 143, steer=side * steer) for side in (1, -1))
    lateral = [p.VY, p.YAW_RATE, p.AY, p.ROLL]
    scale = np.abs(left[:, lateral]).max(axis=0)
    # but for the tyre's sideways pull of a rolling wheel, which has a side of its own
    assert np.all(np.abs(left + right)[:, lateral].max(axis=0) < 0.02 * scale)
    np.testing.assert_allclose(left[:, p.WHEEL], right[:, p.WHEEL + 1], rtol=1e-3)


@every_car
def test_brakes_stop_the_car_where_energy_says_and_nothing_turns_back(name):
    car, torque = load(name), per_wheel(500, 500, 250, 250)
    states = drive(MultiBody(car, DRY), 15.0, 700, brake=torque)
    assert np.all(np.diff(states[:, p.VX]) <= 1e-9)  # and it comes to rest, not back
    assert np.all(states[:, p.WHEEL_SPEEDS] >= 0)
    assert not np.any(states[-1, [p.VX, p.VY, p.YAW_RATE, p.AX, p.AY]]) and not np.any(states[-1, p.WHEEL_SPEEDS])
    energy = 0.5 * car.mass * 15.0**2 + 0.5 * 4 * car.wheel_inertia * (15.0 / car.wheel_radius) ** 2
    # the tyres' slip, some 2 % of the way, takes the rest
    assert 0.95 * energy < states[-1, p.BRAKE_WORK] < energy
    force = torque.sum() / car.wheel_radius
    assert states[-1, p.DISTANCE] == pytest.approx(energy / force, rel=0.03)


def test_a_car_that_stands_stays_there():
    plant = MultiBody(load("bmw_320i"), DRY)
    states = drive(plant, 3.0, 200, brake=per_wheel(500, 500, 250, 250), drive=per_wheel(0, 0, 50, 50))
    assert np.ptp(states[150:, p.X]) == 0 and states[-1, p.VX] == 0


def test_a_wheel_that_locks_stands_until_its_brake_lets_go():
    plant = MultiBody(load("bmw_320i"), DRY)
    bodies, state = plant.start(20.0)
    speeds = []
    for k in range(60):
        brake = per_wheel(2500, 2500, 0, 0) if k < 30 else NOTHING
        bodies, state = plant.advance(bodies, state, p.Inputs(0.0, NOTHING, brake), 0.01)
        speeds.append(state[p.WHEEL_SPEEDS])
    speeds = np.array(speeds)
    assert not np.any(speeds[20:30, :2]) and np.all(speeds[:, 2:] > 40)
    # a locked wheel has done no work since
    assert np.all(speeds[-1, :2] > 0.9 * state[p.VX] / load("bmw_320i").wheel_radius)


def test_locked_wheels_slide_at_the_friction_of_the_road_under_them():
    # m ax = -mu(s = 1) m g with the Magic Formula at the slip of a locked wheel.
    plant = MultiBody(load("bmw_320i"), p.road((0.0, 0.8), (20.0, 0.3)))
    states = drive(plant, 20.0, 350, brake=per_wheel(4000, 4000, 4000, 4000))
    q = plant.library.tire
    for friction, when in ((0.8, states[:, p.DISTANCE] < 18), (0.3, states[:, p.DISTANCE] > 23)):
        peak = q.p_dx1 * friction
        slip = q.p_kx1 / (q.p_cx1 * peak)
        shift = -q.p_vx1 * plant.library.m * p.GRAVITY / 4  # of a wheel that carries its share
        sliding = peak * math.sin(q.p_cx1 * math.atan(slip - q.p_ex1 * (slip - math.atan(slip))) + shift)
        measured = states[when & (states[:, p.VX] > 1) & ~np.any(states[:, p.WHEEL_SPEEDS], axis=1), p.AX]
        assert measured.size > 30
        assert measured.mean() == pytest.approx(-sliding * p.GRAVITY, rel=0.03)  # braking leans on the front wheels


def test_half_the_step_gives_the_same_drive(monkeypatch):
    plant = MultiBody(load("vw_vanagon"), DRY)
    steer = 0.08 * np.sin(2 * np.pi * 0.7 * 0.01 * np.arange(100))
    coarse = drive(plant, 20.0, 100, steer=steer, brake=per_wheel(300, 0, 100, 0))
    monkeypatch.setattr(multibody, "SUBSTEP", 1e-3)
    fine = drive(plant, 20.0, 100, steer=steer, brake=per_wheel(300, 0, 100, 0))
    # order four: the wheels' spin, 0.8 of a step's limit of 2.78, leaves 1e-4 of what the car does
    np.testing.assert_allclose(coarse[:, :6], fine[:, :6], atol=2e-4)


def test_advance_edits_nothing_and_repeats_itself_bit_by_bit():
    plant = MultiBody(load("ford_escort"), DRY)
    bodies, state = plant.start(20.0)
    before, inputs = state.copy(), p.Inputs(0.05, NOTHING, per_wheel(3000, 0, 0, 0))
    once, again = (plant.advance(bodies, state, inputs, 0.1) for _ in range(2))
    assert once[0] == again[0] and once[1].tobytes() == again[1].tobytes()
    np.testing.assert_array_equal(state, before)


def test_a_wheel_carried_backwards_has_no_answer_and_says_so():
    plant = MultiBody(load("bmw_320i"), DRY)
    bodies, state = plant.start(1.0)
    turning = list(bodies)
    turning[multibody.YAW_RATE] = 3.0  # at 1 m/s the inner wheels go backwards
    after = plant.advance(tuple(turning), state, p.Inputs(0.0, NOTHING, NOTHING), 0.01)
    assert after[0] is None and after[1] is state


def test_a_wheel_under_a_negative_load_comes_back_to_rolling():
    # The library's tyre would drive it away, ever faster, and the car with it.
    plant = MultiBody(load("vw_vanagon"), DRY)
    bodies, state = plant.start(20.0)
    leaning = list(bodies)
    leaning[multibody.LEAN_FRONT] = 0.05  # the front axle leans left: its right wheel, the library's left, is up
    assert np.sign(loads(plant.library, leaning)).tolist() == [-1, 1, 1, 1]
    rolling = leaning[multibody.SPIN]
    for spin in (0.9 * rolling, 1.1 * rolling):
        leaning[multibody.SPIN : multibody.SPIN + 2] = spin, spin
        after = plant.advance(tuple(leaning), state, p.Inputs(0.0, NOTHING, NOTHING), 0.01)[1][p.WHEEL_SPEEDS]
        assert np.all(np.abs(after[:2] - rolling) < 0.05 * rolling)


@every_car
def test_free_wheels_roll_in_a_turn_that_takes_the_load_off_the_inner_ones(name):
    car, plant = load(name), MultiBody(load(name), DRY)
    bodies, state = plant.start(80 / 3.6)
    lightest = np.inf
    for k in range(140):
        steer = math.radians(100 / 16) * math.sin(2 * np.pi * 0.7 * 0.01 * k)
        bodies, state = plant.advance(bodies, state, p.Inputs(steer, NOTHING, NOTHING), 0.01)
        lightest = min(lightest, *loads(plant.library, bodies))
        y = 0.5 * np.array([car.track_front, -car.track_front, car.track_rear, -car.track_rear])
        x = np.array([car.lf, car.lf, -car.lr, -car.lr])
        angle = np.array([steer, steer, 0.0, 0.0])
        along = (state[p.VX] - state[p.YAW_RATE] * y) * np.cos(angle)
        along += (state[p.VY] + state[p.YAW_RATE] * x) * np.sin(angle)
        # tyres that corner this hard roll some per cent off; a wheel that runs away is 6 % off and more by now
        np.testing.assert_allclose(state[p.WHEEL_SPEEDS] * car.wheel_radius, along, rtol=0.05)
    assert lightest < 0 or name == "bmw_320i"  # low and wide: it stays on the road this long


def test_a_car_that_differs_from_its_file_takes_the_difference_along():
    car = load("vw_vanagon")
    tyres = {
        axle: t._replace(cornering_stiffness=0.9 * t.cornering_stiffness, peak_x=1.1 * t.peak_x)
        for axle, t in (("front_tyre", car.front_tyre), ("rear_tyre", car.rear_tyre))
    }
    changed = car._replace(mass=1.1 * car.mass, lf=car.lf + 0.1, lr=car.lr - 0.1, steering_offset=0.01, **tyres)
    plain, q = parameters(car), parameters(changed)
    assert q.m == pytest.approx(1.1 * plain.m) and q.m - q.m_s == pytest.approx(plain.m - plain.m_s)
    assert (q.a - plain.a, q.b - plain.b) == pytest.approx((0.1, -0.1))
    assert q.tire.p_ky1 == pytest.approx(0.9 * plain.tire.p_ky1)
    assert q.tire.p_dx1 == pytest.approx(1.1 * plain.tire.p_dx1)
    same = replace(q, m=plain.m, m_s=plain.m_s, a=plain.a, b=plain.b, tire=plain.tire)
    assert same == plain


@every_car
def test_a_heavier_car_still_starts_at_rest_on_its_springs(name):
    car = load(name)
    states = drive(MultiBody(car._replace(mass=1.3 * car.mass, height=1.1 * car.height), DRY), 20.0, 100)
    assert np.abs(states[:, [p.AX, p.AY]]).max() < 0.02


def softer(tyre):
    return tyre._replace(cornering_stiffness=0.9 * tyre.cornering_stiffness)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _: load("qin2014"), "knows ford_escort, bmw_320i, vw_vanagon"),
        (lambda c: c._replace(front_transfer=0.5, load_lag=0.1), "cannot change front_transfer, load_lag of bmw_320i"),
        (lambda c: c._replace(radius_error=p.PerWheel(0.01)), "cannot change radius_error"),
        (lambda c: c._replace(front_tyre=softer(c.front_tyre)), "front and rear alike"),
        (lambda c: c._replace(rear_tyre=c.rear_tyre._replace(shape_y=1.2)), "cannot change shape_y"),
        (lambda c: c._replace(rear_tyre=p.LinearTyre(6e4, 5e4)), "the tyre law of its file"),
        (lambda c: c._replace(mass=100.0), "leaves nothing to the body"),
    ],
)
def test_refuses_a_car_that_it_cannot_be(change, words):
    with pytest.raises(ValueError, match=words):
        MultiBody(change(load("bmw_320i")), DRY)


@pytest.mark.parametrize(
    ("road", "words"),
    [
        (DRY._replace(friction_left=np.array([0.3])), "no friction split"),
        (p.road((0.0, 0.8), slope=0.1), "no slope"),
        (p.road((0.0, 0.8), bank=0.1), "no bank"),
    ],
)
def test_refuses_a_road_that_it_cannot_drive(road, words):
    with pytest.raises(ValueError, match=words):
        MultiBody(load("bmw_320i"), road)


def test_refuses_to_start_from_a_standstill():
    with pytest.raises(ValueError, match=r"starts at 1\.0 m/s or more"):
        MultiBody(load("bmw_320i"), DRY).start(0.0)
