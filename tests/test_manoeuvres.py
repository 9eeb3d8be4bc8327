"""The standard tests: what the driver does, and verdicts on drives whose figures are known beforehand."""

import math
from itertools import pairwise

import numpy as np
import pytest

from vse_gym.catalogue import MANOEUVRES
from vse_gym.manoeuvres.base import Criterion, Verdict
from vse_gym.manoeuvres.held_steer import HeldSteer
from vse_gym.manoeuvres.sine_with_dwell import SineWithDwell
from vse_gym.manoeuvres.slowly_increasing_steer import SlowlyIncreasingSteer, steer_at_0_3g
from vse_gym.manoeuvres.straight_driving import StraightDriving
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.procedures import measure_steer_at_0_3g
from vse_gym.sensors import QUIET
from vse_gym.types import Car, Log
from vse_gym.vehicles import load, names

DEG = math.pi / 180
DT = 0.01
EITHER_WAY = pytest.mark.parametrize("side", [1, -1])
every_manoeuvre = pytest.mark.parametrize("name", MANOEUVRES)


@pytest.fixture(scope="module")
def nominal():
    return Nominal(load("qin2014"), QUIET, 80 / 3.6)


def log_of(time, ended="", hand_wheel=0.0, **truth):
    """A drive of which only the named states of the car are known, the others 0 but for vx = 20 m/s."""
    rows = len(time)
    states = np.zeros((rows, p.STATE_SIZE))
    states[:, p.VX] = 20.0
    for state, values in truth.items():
        states[:, getattr(p, state)] = values
    blank = {field: np.zeros(rows) for field in Log._fields}
    blank |= {field: np.zeros((rows, 4)) for field in ("brake", "added", "release")}
    blank |= {"time": time, "truth": states, "hand_wheel": np.broadcast_to(hand_wheel, rows), "ended": ended}
    return Log(**blank | {"filled": (), "vehicle": None})


def figure(verdict, name):
    """The one criterion whose name begins so."""
    (found,) = [criterion for criterion in verdict.criteria if criterion.name.startswith(name)]
    return found


def cut(log, rows, ended):
    """The first rows of a drive that came to an early end."""
    short = {k: v[:rows] for k, v in log._asdict().items() if isinstance(v, np.ndarray)}
    return log._replace(**short, ended=ended)


@pytest.mark.parametrize(("value", "keeps"), [(1.0, True), (0.99, True), (1.01, False), (math.nan, False)])
def test_a_criterion_is_kept_up_to_its_limit(value, keeps):
    assert Criterion("figure", value, 1.0, "m").passed == keeps
    assert Criterion("figure", -value, -1.0, "m", at_least=True).passed == keeps


def test_a_verdict_asks_for_every_judged_criterion():
    good, bad = Criterion("good", 0.0, 1.0, "m"), Criterion("bad", 2.0, 1.0, "m")
    assert Verdict((good,)).passed
    assert not Verdict((good, bad)).passed
    assert Verdict((good, bad._replace(judged=False))).passed


@every_manoeuvre
def test_a_drive_begins_straight_at_its_speed_and_friction(name, nominal):
    manoeuvre = MANOEUVRES.make(name)
    state = np.zeros(p.STATE_SIZE)
    state[p.VX] = manoeuvre.speed
    driver, _ = manoeuvre.drive(manoeuvre.init(nominal), 0.0, Car(state))
    assert driver.hand_wheel == 0
    assert not driver.brake.any()
    assert manoeuvre.road().friction_left[0] == manoeuvre.friction
    assert manoeuvre.road().friction_right[0] == manoeuvre.friction


@EITHER_WAY
@pytest.mark.parametrize(("amplitude", "frequency", "dwell"), [(270 * DEG, 0.7, 0.5), (1.0, 0.5, 0.3)])
def test_the_sine_has_its_amplitude_frequency_and_dwell(amplitude, frequency, dwell, side):
    test = SineWithDwell(amplitude=side * amplitude, frequency=frequency, dwell=dwell, begin=0.5)
    time = np.linspace(0, 6, 60001)
    angle = side * np.array([test.hand_wheel(t) for t in time])
    # Sampled every 0.1 ms, a crest is missed by (2 pi 0.7 0.05e-3)^2/2 = 2e-8 at most.
    assert angle.max() == pytest.approx(amplitude, rel=1e-7)
    assert angle.min() == pytest.approx(-amplitude, rel=1e-7)
    assert time[np.argmax(angle)] == pytest.approx(0.5 + 0.25 / frequency, abs=1e-3)
    dwelling = time[angle < -amplitude * (1 - 1e-12)]
    assert dwelling[0] == pytest.approx(0.5 + 0.75 / frequency, abs=1e-3)
    assert np.ptp(dwelling) == pytest.approx(dwell, abs=1e-3)
    crossing = time[1:][(angle[:-1] > 0) & (angle[1:] <= 0)]
    np.testing.assert_allclose(crossing, [0.5 + 0.5 / frequency], atol=2e-4)
    assert test.complete == pytest.approx(0.5 + 1 / frequency + dwell, rel=1e-12)
    assert not np.any(angle[(time <= 0.5) | (time >= test.complete)])
    assert np.all(angle[(time > 0.5001) & (time < test.complete - 1e-3) & (angle == 0)] == crossing)


def test_the_hand_wheel_moves_without_jumps():
    test = SineWithDwell()
    steps = np.abs(np.diff([test.hand_wheel(1e-4 * k) for k in range(60000)]))
    assert steps.max() <= 1e-4 * test.amplitude * 2 * math.pi * test.frequency * (1 + 1e-6)


def test_without_its_dwell_the_sine_sums_to_nothing_and_with_it_to_the_dwell():
    time = np.linspace(0, 6, 60001)
    for dwell in (0.0, 0.5):
        test = SineWithDwell(dwell=dwell)
        total = np.trapezoid([test.hand_wheel(t) for t in time], time)
        assert total == pytest.approx(-test.amplitude * dwell, abs=1e-5)  # trapezium at 0.1 ms: 1e-8 of the curvature


def test_one_direction_is_the_other_in_a_mirror():
    left, right = SineWithDwell(amplitude=2.0), SineWithDwell(amplitude=-2.0)
    assert all(left.hand_wheel(0.01 * k) == -right.hand_wheel(0.01 * k) for k in range(600))


def after_a_sine(test, rests, side=1, shift=5.0):
    """A drive whose yaw rate peaks at -0.5 rad/s and is at these shares of it 1.00 and 1.75 s after completion."""
    time = DT * np.arange(601)
    reverses = test.begin + 0.5 / test.frequency
    marks = [reverses, reverses + 0.4, *(test.complete + w for w in (0.8, 0.9, 1.1, 1.65, 1.85))]
    shares = [0.0, 1.0, 0.99, rests[0], rests[0], rests[1], rests[1]]
    yaw_rate = -0.5 * side * np.interp(time, marks, shares)
    yaw_rate[time < reverses] = 0.6 * side * np.sin(2 * np.pi * test.frequency * (time[time < reverses] - test.begin))
    y = side * shift * (time - test.begin) / 1.07
    return log_of(time, YAW_RATE=yaw_rate, Y=y)


@EITHER_WAY
@pytest.mark.parametrize(
    ("rests", "passes"),
    [
        ((0.3499, 0.1999), True),
        ((0.3501, 0.1), False),
        ((0.1, 0.2001), False),
        ((0.0, 0.0), True),
        ((-0.9, -0.9), True),  # formally
    ],
)
def test_the_sine_fails_above_the_yaw_rates_that_the_standard_leaves(rests, passes, side, nominal):
    test = SineWithDwell(amplitude=side * 270 * DEG)
    verdict = test.verdict(after_a_sine(test, rests, side), nominal)
    assert verdict.passed == passes
    # The peak lies between two instants: 0.5 rad/s is missed by 0.01 s of a ramp of 0.4 s at most.
    assert figure(verdict, "yaw rate left after 1.00 s").figure == pytest.approx(100 * rests[0], rel=0.025)
    assert figure(verdict, "yaw rate left after 1.75 s").figure == pytest.approx(100 * rests[1], rel=0.025)
    magnitude = figure(verdict, "magnitude")
    assert magnitude.figure == pytest.approx(100 * abs(rests[1]), rel=0.025)
    assert not magnitude.judged


@EITHER_WAY
@pytest.mark.parametrize(("left", "passes"), [(0.348, True), (0.352, False)])
def test_a_yaw_rate_that_dies_away_at_a_known_rate_passes_or_fails_by_it(left, passes, side, nominal):
    # From its peak at completion the yaw rate decays as exp(-t/tau), tau such that this much is left after 1 s; of
    # 0.35, exp(1.75 ln 0.35) = 0.16 is left after 1.75 s, so that the first limit decides. The curve is sampled every
    # 10 ms and read by straight lines: (0.01/tau)^2/8 = 1e-5; the peak may be read 5 ms late: 0.5 %, which is why the
    # peak is a plateau.
    test = SineWithDwell(amplitude=side * 270 * DEG)
    time = DT * np.arange(601)
    tau = -1 / math.log(left)
    yaw_rate = -0.5 * side * np.exp(-np.maximum(time - test.complete, 0.0) / tau)
    yaw_rate[time < test.begin + 0.5 / test.frequency] *= -1
    log = log_of(time, YAW_RATE=yaw_rate, Y=5.0 * side)
    verdict = test.verdict(log, nominal)
    assert verdict.passed == passes
    assert figure(verdict, "yaw rate left after 1.00 s").figure == pytest.approx(100 * left, rel=1e-4)
    assert figure(verdict, "yaw rate left after 1.75 s").figure == pytest.approx(100 * left**1.75, rel=1e-4)


def test_the_first_peak_after_the_hand_wheel_reverses_counts(nominal):
    test = SineWithDwell()
    log = after_a_sine(test, (0.3, 0.1))
    later = (log.time > test.begin + 0.5 / test.frequency + 0.5) & (log.time < test.complete)
    log.truth[later, p.YAW_RATE] = -0.8 * np.sin(np.pi * np.linspace(0.5, 1, later.sum())) - 0.4
    verdict = test.verdict(log, nominal)  # a second, greater peak does not make what is left look less
    assert figure(verdict, "yaw rate left after 1.00 s").figure == pytest.approx(30, rel=0.025)


@EITHER_WAY
@pytest.mark.parametrize(("shift", "passes"), [(1.831, True), (1.829, False), (-2.0, False)])
def test_the_car_must_have_gone_aside_at_large_amplitudes(shift, passes, side, nominal):
    large, small = (SineWithDwell(amplitude=side * factor * steer_at_0_3g(nominal.vehicle)) for factor in (5, 4.9))
    log = after_a_sine(large, (0.1, 0.1), side, shift)
    assert large.verdict(log, nominal).passed == passes
    assert figure(large.verdict(log, nominal), "lateral displacement").figure == pytest.approx(shift, rel=1e-9)
    assert small.verdict(log, nominal).passed


@pytest.mark.parametrize("end", [0.0, 0.3, 1.0, 2.0, 3.3, 4.1])
def test_a_sine_that_ended_before_it_could_be_judged_fails(end, nominal):
    test = SineWithDwell()  # judged 4.18 s after the start
    log = after_a_sine(test, (0.1, 0.1))
    assert test.verdict(log, nominal).passed
    assert not test.verdict(cut(log, 1 + round(end / DT), "spin"), nominal).passed


@EITHER_WAY
@pytest.mark.parametrize("bend", [0.0, 0.02])
def test_a_is_read_off_a_straight_line_through_the_tenths_of_a_g(bend, side, nominal):
    # ay = 3 % of g a degree and an offset: 0.3 g is at 11 deg; what lies outside 0.1 to 0.375 g must not count.
    time = DT * np.arange(401)
    degrees = 13.5 * np.maximum(time - 0.5, 0)
    g = 0.03 * (degrees - 1)
    g = np.where(g < 0.1, g - bend * (0.1 - g), g)
    g = np.where(g > 0.375, 0.375 + (1 - 30 * bend) * (g - 0.375), g)
    log = log_of(time, hand_wheel=side * degrees * DEG, AY=side * g * p.GRAVITY)
    verdict = SlowlyIncreasingSteer(rate=side * 13.5 * DEG).verdict(log, nominal)
    assert figure(verdict, "hand-wheel angle").figure == pytest.approx(11, rel=1e-6)
    assert figure(verdict, "largest lateral").figure == pytest.approx(np.abs(g).max(), rel=1e-9)
    assert verdict.passed


def test_a_car_that_never_corners_at_0_375_g_has_no_a(nominal):
    time = DT * np.arange(401)
    log = log_of(time, hand_wheel=time, AY=0.37 * p.GRAVITY * time / time[-1])
    verdict = SlowlyIncreasingSteer().verdict(log, nominal)
    assert not verdict.passed
    assert math.isnan(figure(verdict, "hand-wheel angle").figure)


@EITHER_WAY
def test_the_slow_hand_wheel_turns_at_its_rate_until_half_a_g(side, nominal):
    test = SlowlyIncreasingSteer(rate=side * 13.5 * DEG)
    memory, angles = test.init(nominal), []
    for k in range(400):
        state = np.zeros(p.STATE_SIZE)
        state[p.VX], state[p.AY] = test.speed, side * (0.0 if k < 300 else 0.5 * p.GRAVITY)
        driver, memory = test.drive(memory, k * DT, Car(state))
        angles.append(driver.hand_wheel)
        assert not driver.drive.any()  # at its speed it needs no torque
    turning = np.diff(angles)[50:299]
    np.testing.assert_allclose(turning, side * 13.5 * DEG * DT, rtol=1e-9)
    assert not np.any(angles[:50])
    assert set(angles[300:]) == {angles[299]}


@pytest.mark.parametrize("front", [1.0, 0.0, 0.4])
def test_the_slow_steer_holds_its_speed_with_the_driven_wheels(front, nominal):
    told = Nominal(nominal.vehicle._replace(front_drive=front), QUIET, nominal.speed)
    test, drives = SlowlyIncreasingSteer(), []
    for off in (-1.0, 1.0):
        state = np.zeros(p.STATE_SIZE)
        state[p.VX] = test.speed + off
        drives.append(test.drive(test.init(told), 0.0, Car(state))[0].drive)
    slow, fast = drives
    np.testing.assert_allclose(slow / slow.sum(), 0.5 * np.array([front, front, 1 - front, 1 - front]), atol=1e-12)
    assert slow.sum() > 0 and not fast.any()  # and does not brake


@pytest.mark.parametrize(("car", "degrees"), [("qin2014", 16.3), ("qin2014_understeer", 22.4)])
def test_a_of_the_cars_is_as_measured_before(car, degrees):
    # Another implementation of the same car and tyre; how it held its speed and when it began is not known, and
    # 1 deg of hand wheel is 74 ms of turning.
    assert steer_at_0_3g(load(car)) / DEG == pytest.approx(degrees, abs=1)


def test_a_road_too_slippery_for_the_test_gives_no_a():
    assert math.isnan(steer_at_0_3g(load("qin2014_understeer"), friction=0.3))


@EITHER_WAY
def test_a_held_hand_wheel_turns_at_its_rate_to_its_angle_and_stays(side):
    test = HeldSteer(amplitude=side * 1.0, rate=4.0, begin=0.5)
    times = [0.0, 0.5, 0.6, 0.75, 0.8, 5.0]
    angles = [test.drive(None, time, Car(np.zeros(p.STATE_SIZE)))[0].hand_wheel for time in times]
    np.testing.assert_allclose(angles, side * np.array([0.0, 0.0, 0.4, 1.0, 1.0, 1.0]), atol=1e-12)


def test_a_car_at_the_start_speed_meets_the_other_friction_at_its_time():
    test = HeldSteer(speed=18.0, friction=0.9, friction_after=0.35, jump=1.8)
    road = test.road()
    assert road.start.tolist() == [0, 18.0 * 1.8]
    assert road.friction_left.tolist() == road.friction_right.tolist() == [0.9, 0.35]
    assert HeldSteer().road().start.tolist() == [0]


@pytest.mark.parametrize("setting", ["jump", "rate"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan])
def test_a_held_steer_that_cannot_be_is_refused(setting, wrong):
    with pytest.raises(ValueError, match=setting):
        HeldSteer(**{setting: wrong})


@EITHER_WAY
@pytest.mark.parametrize(("degrees", "passes"), [(14.9, True), (15.1, False)])
def test_a_held_steer_judges_the_largest_sideslip(degrees, passes, side, nominal):
    time = DT * np.arange(601)
    sideslip = side * degrees * DEG * np.sin(np.pi * time / 6)
    log = log_of(time, VX=20 * np.cos(sideslip), VY=20 * np.sin(sideslip))
    verdict = HeldSteer().verdict(log, nominal)
    assert verdict.passed == passes
    assert figure(verdict, "largest sideslip").figure == pytest.approx(degrees, rel=1e-9)


@EITHER_WAY
def test_straight_driving_ends_outside_its_lane(side, nominal):
    test = StraightDriving(half_lane=1.5)
    state = np.zeros(p.STATE_SIZE)
    for y, off in ((0.0, False), (1.49, False), (1.51, True)):
        state[p.Y] = side * y
        assert test.off_course(Car(state), nominal.vehicle) == off


@pytest.mark.parametrize("criterion", ["largest lateral offset", "largest sideslip", "needless brake energy"])
@pytest.mark.parametrize(("share", "passes"), [(0.99, True), (1.01, False)])
def test_straight_driving_fails_by_each_of_its_limits(criterion, share, passes, nominal):
    time = DT * np.arange(601)
    limits = {c.name: c.limit for c in StraightDriving().verdict(log_of(time), nominal).criteria}
    rise = share * limits[criterion] * time / time[-1]
    drive = {
        "largest lateral offset": {"Y": -rise},
        "largest sideslip": {"VY": -20 * np.tan(rise * DEG)},
        "needless brake energy": {"BRAKE_WORK": 5e3 + 1e3 * rise},
    }[criterion]
    verdict = StraightDriving().verdict(log_of(time, **drive), nominal)
    assert verdict.passed == passes
    assert figure(verdict, criterion).figure == pytest.approx(share * limits[criterion], rel=1e-6)


@pytest.mark.parametrize("car", names())
def test_the_more_friction_the_less_hand_wheel_for_0_3_g(car):
    # The tyre softens by 0.0668 of its normalised slip, which falls with friction.
    angles = [steer_at_0_3g(load(car), friction) for friction in (0.7, 0.9, 1.2)]
    signs = {math.copysign(1, b - a) for a, b in pairwise(angles)}
    assert len(signs) == 1


def test_a_of_two_tyre_laws_with_equal_numbers_is_not_mixed_up():
    car = load("qin2014_understeer")
    laws = []
    for law in (p.LinearTyre, p.DugoffTyre):
        tyres = {axle: law(*getattr(car, axle)[:2]) for axle in ("front_tyre", "rear_tyre")}
        laws.append(steer_at_0_3g(car._replace(**tyres)))
    assert laws[0] != laws[1]


def test_an_offset_of_the_steering_leaves_the_mean_of_left_and_right():
    # 0.01 rad at the road wheel are 9.17 deg of hand wheel, more to one side and less to the other.
    car = load("qin2014_understeer")
    straight, offset = (measure_steer_at_0_3g(car._replace(steering_offset=angle)) for angle in (0.0, 0.01))
    assert offset == pytest.approx(straight, rel=5e-3)
