"""What stability control does to a car, and when an estimate matters: the findings that the benchmark stands on."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vse_gym.catalogue import CONTROLLERS
from vse_gym.controllers.allocation import SLOWEST, SMALLEST, allocate, largest_moment, let_go
from vse_gym.estimators.anchors import Truth
from vse_gym.manoeuvres.slowly_increasing_steer import steer_at_0_3g
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import wheel_position
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET
from vse_gym.simulation import rollout
from vse_gym.types import Estimate, Reading
from vse_gym.vehicles import load

DEG = math.pi / 180
CARS = ("qin2014", "qin2014_understeer")  # the two that the findings were made with
NOMINAL = Nominal(load("qin2014"), QUIET, 80 / 3.6)
GEOMETRY = NOMINAL.vehicle.geometry
MIRRORED = [1, 0, 3, 2]
LAWS = [name for name in CONTROLLERS if name != "none"]

every_car = pytest.mark.parametrize("car", CARS)
every_law = pytest.mark.parametrize("name", LAWS)
some_examples = settings(deadline=None)  # the first example may have to compile a kernel

speeds = st.floats(5, 50)
moments = st.floats(-60e3, 60e3)
yaw_rates = st.floats(-1.5, 1.5)
steers = st.floats(-0.5, 0.5)


@cache
def drive(car, estimator, controller, amplitude=270 * DEG, sensors="clean", friction=0.9):
    """Sine with dwell at 80 km/h: whether it is passed, why it ended, its largest sideslip [deg]."""
    cell = scenario("sine_with_dwell", car, sensors, amplitude=amplitude, friction=friction)
    log = rollout(cell, estimator, controller, 0)
    passed = cell.manoeuvre.verdict(log, cell.nominal).passed and not log.ended
    return passed, log.ended, np.degrees(np.abs(log.sideslip).max())


def standard_series(car):
    """Amplitudes from 1.5 A in steps of 0.5 A to the greater of 6.5 A and 270 deg, or 300 deg; both directions."""
    a = steer_at_0_3g(load(car))
    last = 300 * DEG if 6.5 * a > 300 * DEG else max(6.5 * a, 270 * DEG)
    rising = [*np.arange(1.5 * a, last, 0.5 * a), last]
    return [side * amplitude for amplitude in rising for side in (1, -1)]


@every_car
def test_without_control_the_car_spins(car):
    passed, ended, _ = drive(car, "truth", "none")
    assert ended == "spin"
    assert not passed


@every_car
def test_without_control_most_of_the_series_fails(car):
    passes = [drive(car, "truth", "none", amplitude)[0] for amplitude in standard_series(car)]
    assert 0 < sum(passes) < len(passes) / 2


@every_car
def test_production_control_passes_the_whole_series_with_true_states(car):
    results = [drive(car, "truth", "esc", amplitude) for amplitude in standard_series(car)]
    assert all(passed for passed, _, _ in results)
    # 9.5 deg was the most on an earlier implementation of these laws; this one stays below it.
    assert max(sideslip for *_, sideslip in results) < 9.5


@every_car
@pytest.mark.parametrize("friction", [0.9, 0.4])
def test_every_controller_keeps_a_car_that_spins_without(car, friction):
    assert drive(car, "truth", "none", friction=friction)[1] == "spin"
    for controller in LAWS:
        passed, ended, sideslip = drive(car, "truth", controller, friction=friction)
        assert ended == ""
        assert passed or friction < 0.9  # no car gets 1.83 m aside on such a road
        assert sideslip < 15  # chosen; the widest band, the phase plane's, lets 10 deg be


@every_car
@pytest.mark.parametrize("controller", LAWS)
def test_a_drive_to_the_other_side_is_its_mirror_image(car, controller):
    left, right = (drive(car, "truth", controller, side * 270 * DEG) for side in (1, -1))
    assert left[:2] == right[:2]
    assert left[2] == pytest.approx(right[2], rel=1e-6)  # rounding, fed back through a controlled drive


@every_car
@pytest.mark.parametrize("sensors", ["clean", "gaussian"])
def test_under_production_control_no_sideslip_estimate_is_needed(car, sensors):
    # So this test alone cannot rank estimators of sideslip: none at all costs 4.4 deg at most, and no spin.
    _, ended, without = drive(car, "zero", "esc", sensors=sensors)
    assert ended == ""
    assert without < drive(car, "truth", "esc", sensors=sensors)[2] + 4.4


@every_car
@pytest.mark.parametrize("sensors", ["clean", "gaussian"])
def test_under_sideslip_control_the_estimate_decides(car, sensors):
    def sideslip(estimator):
        return drive(car, estimator, "sideslip_esc", sensors=sensors)[2]

    truth, late, later = sideslip("truth"), sideslip(Truth(delay=0.1)), sideslip(Truth(delay=0.2))
    assert truth < 9
    # An earlier implementation had 7.3, 12.7 and 35.4 deg, and 10.5 with half the gain, on the first car. A spin is
    # cut off at 80 deg.
    assert late > 1.5 * truth
    assert later > 1.5 * late
    assert sideslip(Truth(gain=0.5)) > 1.3 * truth
    assert drive(car, "zero", "sideslip_esc", sensors=sensors)[1] == "spin"


@every_car
def test_a_perfect_velocity_is_as_good_as_the_truth_with_quiet_sensors(car):
    # 0.1 deg/s of the gyro is nothing beside the band of 2.5 deg/s.
    for controller in LAWS:
        truth, velocity = (drive(car, e, controller, sensors="gaussian")[2] for e in ("truth", "truth_velocity"))
        assert velocity == pytest.approx(truth, abs=0.2)


def produced(torques, steer):
    """Yaw moment of brake torques that the road takes up whole [N m]."""
    moment = 0.0
    for i in range(4):
        x, y = wheel_position(NOMINAL.vehicle, i)
        angle = steer if i < 2 else 0.0
        back = -torques[i] / NOMINAL.vehicle.wheel_radius
        moment += x * back * math.sin(angle) - y * back * math.cos(angle)
    return moment


@some_examples
@given(moments, speeds, yaw_rates, steers)
def test_brakes_turn_the_car_as_they_are_asked_to(moment, vx, yaw_rate, steer):
    torques = allocate(GEOMETRY, moment, vx, yaw_rate, steer)
    assume(abs(moment) >= SMALLEST)
    assert produced(torques, steer) * moment > 0
    assert abs(produced(torques, steer)) <= abs(moment) * (1 + 1e-9)


@some_examples
@given(moments, speeds, yaw_rates, steers)
def test_brakes_stay_between_nothing_and_their_caps_and_on_one_side(moment, vx, yaw_rate, steer):
    torques = allocate(GEOMETRY, moment, vx, yaw_rate, steer)
    assert np.all(torques >= 0)
    assert np.all(torques <= NOMINAL.vehicle.brake_caps)
    assert not torques[[0, 2]].any() or not torques[[1, 3]].any()


@some_examples
@given(moments, speeds, yaw_rates, steers)
def test_allocation_is_the_same_to_either_side(moment, vx, yaw_rate, steer):
    torques = allocate(GEOMETRY, moment, vx, yaw_rate, steer)
    np.testing.assert_array_equal(allocate(GEOMETRY, -moment, vx, -yaw_rate, -steer), torques[MIRRORED])


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("steer", [-0.1, 0.0, 0.1])
def test_oversteer_brakes_the_outer_front_wheel_first_and_then_the_outer_rear(turn, steer):
    front, rear = (1, 3) if turn > 0 else (0, 2)  # in a left turn the right side is outside
    small = allocate(GEOMETRY, -turn * 2000.0, 20.0, turn * 0.3, steer)
    assert braked(small) == [front]
    assert produced(small, steer) == pytest.approx(-turn * 2000, rel=1e-9)
    large = allocate(GEOMETRY, -turn * 9000.0, 20.0, turn * 0.3, steer)
    assert braked(large) == [front, rear]
    assert large[front] == GEOMETRY.brake_cap_front
    assert produced(large, steer) == pytest.approx(-turn * 9000, rel=1e-9)
    most = allocate(GEOMETRY, -turn * 1e6, 20.0, turn * 0.3, steer)
    assert most[[front, rear]].tolist() == [GEOMETRY.brake_cap_front, GEOMETRY.brake_cap_rear]


@pytest.mark.parametrize("turn", [1, -1])
def test_understeer_brakes_the_inner_rear_wheel_alone(turn):
    rear = 2 if turn > 0 else 3
    for moment in (1000.0, 1e6):
        torques = allocate(GEOMETRY, turn * moment, 20.0, turn * 0.3, turn * 0.05)
        assert braked(torques) == [rear]
    assert torques[rear] == GEOMETRY.brake_cap_rear


@some_examples
@given(moments, st.floats(-5, SLOWEST, exclude_max=True), yaw_rates, steers)
def test_allocation_is_off_at_walking_pace(moment, vx, yaw_rate, steer):
    assert not allocate(GEOMETRY, moment, vx, yaw_rate, steer).any()


@some_examples
@given(st.floats(-SMALLEST, SMALLEST, exclude_min=True, exclude_max=True), speeds, yaw_rates, steers)
def test_allocation_lets_small_moments_be(moment, vx, yaw_rate, steer):
    assert not allocate(GEOMETRY, moment, vx, yaw_rate, steer).any()


@some_examples
@given(moments, st.floats(-5, 50))
def test_the_drivers_brake_is_let_go_on_the_other_side_in_proportion(moment, vx):
    release = let_go(moment, vx, 4e3)
    share = min(1.0, abs(moment) / 4e3) if vx >= SLOWEST and abs(moment) >= SMALLEST else 0.0
    assert release.tolist() == [share * (moment < 0), share * (moment > 0)] * 2
    assert not let_go(moment, vx, math.inf).any()


def test_the_largest_moment_is_what_one_side_gives_at_its_caps():
    most = allocate(GEOMETRY, 1e9, 20.0, -0.3, 0.0)
    assert largest_moment(GEOMETRY) == pytest.approx(produced(most, 0.0), rel=1e-12)


def braked(torques):
    """Which wheels brake, but for what rounding leaves."""
    return np.flatnonzero(torques > 1e-6).tolist()


def ask(controller, states, steers):
    """The torques that a controller adds over a sequence of (vx, vy, yaw rate, ay) and steering angles, (T, 4)."""
    memory, added = controller.init(NOMINAL), []
    for (vx, vy, yaw_rate, ay), steer in zip(states, steers, strict=True):
        inputs = np.zeros(9)
        inputs[0] = steer
        reading = Reading(0.0, inputs, np.zeros(7))
        demand, memory = controller.act(memory, Estimate(vx, vy, yaw_rate, 0.0, ay), reading)
        added.append(demand.added)
        assert not (demand.release[[0, 2]].any() and demand.release[[1, 3]].any())
        assert not demand.added[demand.release > 0].any()  # what brakes one side lets go of the other
    return np.array(added)


@every_law
@some_examples
@given(st.integers(0, 2**32 - 1))
def test_a_controller_treats_left_and_right_alike(name, seed):
    rng = np.random.default_rng(seed)
    states = rng.uniform([0, -8, -1, -10], [40, 8, 1, 10], (20, 4))
    steers = rng.uniform(-0.3, 0.3, 20)
    mirrored = ask(CONTROLLERS.make(name), states * [1, -1, -1, -1], -steers)
    np.testing.assert_array_equal(mirrored, ask(CONTROLLERS.make(name), states, steers)[:, MIRRORED])


@every_law
@pytest.mark.parametrize("steer", [0.0, 0.01, -0.02])
def test_a_car_that_does_what_is_wanted_is_left_alone(name, steer):
    # r = v steer/(l + K v^2) with the reference's K = 0.0020, followed with its lag of 60 ms; no sideslip.
    v, dt = 20.0, NOMINAL.dt
    wanted = v * steer / (NOMINAL.vehicle.wheelbase + 0.0020 * v**2)
    yaw_rate = wanted * -np.expm1(-np.arange(1, 201) * dt / 0.06)
    states = np.column_stack((np.full(200, v), np.zeros(200), yaw_rate, v * yaw_rate))
    assert not ask(CONTROLLERS.make(name), states, np.full(200, steer)).any()


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("steer", [0.0, 0.02])
def test_production_control_acts_where_the_yaw_rate_leaves_its_band_about_the_reference(steer, side):
    v = 20.0
    wanted = v * steer / (NOMINAL.vehicle.wheelbase + 0.0020 * v**2)
    for share, acts in ((0.95, False), (1.1, True)):  # 10 % beyond the band are 196 N m, above the least of 50
        yaw_rate = wanted + side * share * 2.5 * DEG
        states = np.tile([v, 0.0, yaw_rate, v * yaw_rate], (200, 1))
        assert ask(CONTROLLERS.make("esc"), states, np.full(200, steer))[-1].any() == acts


@pytest.mark.parametrize("friction", [0.9, 0.3])
def test_the_reference_asks_for_no_more_than_the_road_has_shown(friction):
    # |r| <= min(0.85 mu g, 1.2 ay + 2.5)/v: a car that corners at that and not at the geometric rate is left alone.
    v, ay = 20.0, 0.85 * friction * p.GRAVITY
    limit = min(0.85 * NOMINAL.friction * p.GRAVITY, 1.2 * ay + 2.5) / v
    states = np.tile([v, 0.0, limit, ay], (200, 1))
    # A lag of 60 ms leaves 5e-4 of the first error after 0.45 s.
    assert not ask(CONTROLLERS.make("esc"), states, np.full(200, 0.3))[45:].any()
    turning_in = states + [0.0, 0.0, 0.1, 0.0]
    assert ask(CONTROLLERS.make("esc"), turning_in, np.full(200, 0.3))[45:, 1].all()  # outer front


@pytest.mark.parametrize(("name", "band"), [("esc", 3.0), ("sideslip_esc", 1.5)])
@pytest.mark.parametrize("side", [1, -1])
def test_sideslip_is_let_be_within_its_band_and_braked_on_the_outer_front_beyond(name, band, side):
    # A car that slides outwards in a left turn has negative sideslip, and its outer side is the right one. The slide
    # is steady, ay = v r.
    v, yaw_rate = 20.0, side * 0.03
    for degrees, brakes in ((band - 0.1, []), (band + 1.0, [1 if side > 0 else 0])):
        vy = -side * v * math.tan(degrees * DEG)
        states = np.tile([v, vy, yaw_rate, v * yaw_rate], (100, 1))
        assert braked(ask(CONTROLLERS.make(name), states, np.zeros(100))[-1]) == brakes


def test_doing_nothing_asks_for_nothing():
    states = np.tile([20.0, 5.0, 1.0, 8.0], (5, 1))
    assert not ask(CONTROLLERS.make("none"), states, np.zeros(5)).any()
