"""The sine with dwell: its hand wheel, and verdicts on drives whose figures are known beforehand."""

import math

import numpy as np
import pytest

from vse_gym.manoeuvres.sine_with_dwell import SineWithDwell
from vse_gym.manoeuvres.slowly_increasing_steer import steer_at_0_3g
from vse_gym.physics import parameters as p

DEG = math.pi / 180
DT = 0.01
EITHER_WAY = pytest.mark.parametrize("side", [1, -1])


@EITHER_WAY
@pytest.mark.parametrize(("amplitude", "frequency", "dwell"), [(270 * DEG, 0.7, 0.5), (1.0, 0.5, 0.3)])
def test_the_sine_has_its_amplitude_frequency_and_dwell(amplitude, frequency, dwell, side):
    test = SineWithDwell(amplitude=side * amplitude, frequency=frequency, dwell=dwell, begin=0.5)
    time = np.linspace(0, 6, 60001)
    angle = side * test.hand_wheel(time)
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
    steps = np.abs(np.diff(test.hand_wheel(1e-4 * np.arange(60000))))
    assert steps.max() <= 1e-4 * test.amplitude * 2 * math.pi * test.frequency * (1 + 1e-6)


def test_without_its_dwell_the_sine_sums_to_nothing_and_with_it_to_the_dwell():
    time = np.linspace(0, 6, 60001)
    for dwell in (0.0, 0.5):
        test = SineWithDwell(dwell=dwell)
        total = np.trapezoid(test.hand_wheel(time), time)
        assert total == pytest.approx(-test.amplitude * dwell, abs=1e-5)  # trapezium at 0.1 ms: 1e-8 of the curvature


def test_one_direction_is_the_other_in_a_mirror():
    left, right = SineWithDwell(amplitude=2.0), SineWithDwell(amplitude=-2.0)
    times = 0.01 * np.arange(600)
    np.testing.assert_array_equal(left.hand_wheel(times), -right.hand_wheel(times))


@pytest.fixture
def after_a_sine(log_of):
    """A drive whose yaw rate peaks at -0.5 rad/s and is at these shares of it 1.00 and 1.75 s after completion."""

    def drive(test, rests, side=1, shift=5.0):
        time = DT * np.arange(601)
        reverses = test.begin + 0.5 / test.frequency
        marks = [reverses, reverses + 0.4, *(test.complete + w for w in (0.8, 0.9, 1.1, 1.65, 1.85))]
        shares = [0.0, 1.0, 0.99, rests[0], rests[0], rests[1], rests[1]]
        yaw_rate, first = -0.5 * side * np.interp(time, marks, shares), time < reverses
        yaw_rate[first] = 0.6 * side * np.sin(2 * np.pi * test.frequency * (time[first] - test.begin))
        return log_of(time, YAW_RATE=yaw_rate, Y=side * shift * (time - test.begin) / 1.07)

    return drive


def cut(log, rows, ended):
    """The first rows of a drive that came to an early end."""
    short = {k: v[:rows] for k, v in log._asdict().items() if isinstance(v, np.ndarray)}
    return log._replace(**short, ended=ended)


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
def test_the_sine_fails_above_the_yaw_rates_that_the_standard_leaves(
    rests, passes, side, nominal, figure, after_a_sine
):
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
def test_a_yaw_rate_that_dies_away_at_a_known_rate_passes_or_fails_by_it(left, passes, side, nominal, log_of, figure):
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


def test_the_first_peak_after_the_hand_wheel_reverses_counts(nominal, figure, after_a_sine):
    test = SineWithDwell()
    log = after_a_sine(test, (0.3, 0.1))
    later = (log.time > test.begin + 0.5 / test.frequency + 0.5) & (log.time < test.complete)
    log.truth[later, p.YAW_RATE] = -0.8 * np.sin(np.pi * np.linspace(0.5, 1, later.sum())) - 0.4
    verdict = test.verdict(log, nominal)  # a second, greater peak does not make what is left look less
    assert figure(verdict, "yaw rate left after 1.00 s").figure == pytest.approx(30, rel=0.025)


@EITHER_WAY
@pytest.mark.parametrize(("shift", "passes"), [(1.831, True), (1.829, False), (-2.0, False)])
def test_the_car_must_have_gone_aside_at_large_amplitudes(shift, passes, side, nominal, figure, after_a_sine):
    large, small = (SineWithDwell(amplitude=side * factor * steer_at_0_3g(nominal.vehicle)) for factor in (5, 4.9))
    log = after_a_sine(large, (0.1, 0.1), side, shift)
    assert large.verdict(log, nominal).passed == passes
    assert figure(large.verdict(log, nominal), "lateral displacement").figure == pytest.approx(shift, rel=1e-9)
    assert small.verdict(log, nominal).passed


@pytest.mark.parametrize("end", [0.0, 0.3, 1.0, 2.0, 3.3, 4.1])
def test_a_sine_that_ended_before_it_could_be_judged_fails(end, nominal, after_a_sine):
    test = SineWithDwell()  # judged 4.18 s after the start
    log = after_a_sine(test, (0.1, 0.1))
    assert test.verdict(log, nominal).passed
    assert not test.verdict(cut(log, 1 + round(end / DT), "spin"), nominal).passed
