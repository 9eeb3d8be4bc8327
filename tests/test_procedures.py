"""Whole procedures: the series of FMVSS 126 and the search for the highest clean entry speed."""

import math
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import Criterion, Manoeuvre, Verdict
from vse_gym.manoeuvres.sine_with_dwell import SineWithDwell
from vse_gym.manoeuvres.slowly_increasing_steer import steer_at_0_3g
from vse_gym.physics import parameters as p
from vse_gym.procedures import entry_speed, fmvss126, measure_steer_at_0_3g, series_amplitudes
from vse_gym.registry import UnknownNameError
from vse_gym.simulation import rollout, scenario
from vse_gym.types import Driver
from vse_gym.vehicles import load, names

DEG = math.pi / 180


@pytest.mark.parametrize(
    ("a", "steps", "last"),
    [
        (20.0, 25, 270.0),  # 1.5 A = 30, ..., 260 and 270
        (30.0, 16, 270.0),  # 30 A is 9 A: the last step meets 270 itself
        (44.0, 11, 286.0),  # 6.5 A, between 270 and 300
        (300 / 6.5, 11, 300.0),
        (50.0, 10, 300.0),  # 6.5 A = 325 is too much: 75, ..., 275 = 5.5 A are 9, 300 itself is 6 A
        (250.0, 1, 300.0),  # 1.5 A alone is too much
    ],
)
def test_the_series_rises_by_half_an_a_to_what_the_standard_ends_with(a, steps, last):
    series = np.array(series_amplitudes(a * DEG)) / DEG
    assert series[-1] == pytest.approx(last, rel=1e-12)
    assert len(series) == steps
    np.testing.assert_allclose(series[:-1], a * (1.5 + 0.5 * np.arange(steps - 1)), rtol=1e-12)


@given(st.floats(2.0, 400.0))
def test_no_series_repeats_or_passes_its_last_amplitude(a):
    series = series_amplitudes(a * DEG)
    assert all(after - before > 1e-9 for before, after in pairwise(series))
    assert all(after - before <= 0.5 * a * DEG * (1 + 1e-9) for before, after in pairwise(series))
    assert 270 * DEG - 1e-9 <= series[-1] <= 300 * DEG + 1e-9


@pytest.mark.parametrize("car", names())
def test_a_of_both_directions_is_that_of_one_for_a_symmetric_car(car):
    # Another program path to the same drive: the loop here, the bare plant there.
    assert measure_steer_at_0_3g(car) == pytest.approx(steer_at_0_3g(load(car)), rel=1e-9)


def test_a_steering_offset_cancels_in_the_mean_of_both_directions():
    # 2 deg of hand wheel would move a single direction's A by as much. What is left is of second order: the offset car
    # begins to turn before the hand wheel does, so that its speed and its transient differ a little.
    car = load("qin2014_understeer")
    crooked = car._replace(steering_offset=2 * DEG / car.steering_ratio)
    assert measure_steer_at_0_3g(crooked) == pytest.approx(measure_steer_at_0_3g(car), abs=0.1 * DEG)


def test_a_car_that_cannot_corner_at_0_375_g_is_refused_with_the_reason():
    car = load("qin2014_understeer")
    slow = car._replace(steering_ratio=200.0)
    with pytest.raises(ValueError, match=r"no A: .* 0\.375"):
        fmvss126(slow, "truth")


@pytest.mark.parametrize("car", names())
def test_every_car_passes_the_largest_sine_with_control_and_fails_it_without(car):
    amplitude = series_amplitudes(measure_steer_at_0_3g(car))[-1]
    for law, passes in (("esc", True), ("none", False)):
        cell = scenario("sine_with_dwell", car, "clean", amplitude=amplitude)
        log = rollout(cell, "truth", law, 0)
        assert cell.manoeuvre.judge(log, cell.nominal).passed == passes


@pytest.fixture(scope="module", params=["qin2014", "qin2014_understeer"])
def both_ways(request):
    """The whole procedure with stability control and true states, and without control."""
    return request.param, *(fmvss126(request.param, "truth", law, "clean") for law in ("esc", "none"))


def test_the_series_is_passed_with_production_control_and_true_states(both_ways):
    _, controlled, _ = both_ways
    assert controlled.passed
    # 9.5 deg was the most on an earlier implementation of this law.
    assert controlled.peak_sideslip < 9.5 * DEG


def test_without_control_large_amplitudes_fail_and_an_understeering_car_passes_small_ones(both_ways):
    car, _, alone = both_ways
    assert not alone.passed
    assert not any(run.passed for run in alone.runs[-2:])
    assert all(run.brake_energy == 0 for run in alone.runs)
    if load(car).understeer_gradient > 0:
        assert all(run.passed for run in alone.runs[:2])


def test_runs_come_by_amplitude_to_both_sides_and_mirror_each_other(both_ways):
    _, controlled, _ = both_ways
    amplitudes = series_amplitudes(controlled.steer_at_0_3g)
    assert [run.amplitude for run in controlled.runs] == [s * a for a in amplitudes for s in (1, -1)]
    assert controlled.runs[0].multiple == pytest.approx(1.5)
    for left, right in zip(controlled.runs[::2], controlled.runs[1::2], strict=True):
        assert left.passed == right.passed
        np.testing.assert_allclose(left.yaw_rate, -right.yaw_rate, atol=1e-6)  # rounding, fed back


def test_the_lateral_displacement_counts_from_5_a_on(both_ways):
    for result in both_ways[1:]:
        for run in result.runs:
            (shift,) = [c for c in run.criteria if c.name.startswith("lateral displacement")]
            assert shift.judged == (run.multiple >= 5 - 1e-9)


def test_a_row_is_the_drive_that_run_shows(both_ways):
    car, controlled, _ = both_ways
    run = controlled.runs[-1]
    cell = scenario("sine_with_dwell", car, "clean", amplitude=run.amplitude)
    log = rollout(cell, "truth", "esc", 0)
    assert run.criteria == cell.manoeuvre.verdict(log, cell.nominal).criteria
    assert run.peak_sideslip == log.peak_sideslip


def test_the_noise_is_the_seeds_and_progress_is_told():
    heard, car = [], "qin2014_understeer"
    result = fmvss126(car, "zero", "esc", "loud", seed=3, progress=lambda *done: heard.append(done))
    run = result.runs[-1]
    cell = scenario("sine_with_dwell", car, "loud", amplitude=run.amplitude)
    peaks = [rollout(cell, "zero", "esc", seed).peak_sideslip for seed in (3, 4)]
    assert run.peak_sideslip == peaks[0] != peaks[1]
    total = len(result.runs)
    assert heard == [(k, total) for k in range(1, total + 1)]


def test_a_run_that_ended_early_fails_whatever_its_figures():
    run = fmvss126("qin2014_understeer", "truth", "none", "clean").runs[-1]
    assert run.ended == "spin"
    assert not run.passed


# -- highest clean entry speed ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CleanUpTo(Manoeuvre):
    """A drive of 20 ms that is clean up to a speed, and again in a window above it; the noise shifts the limit."""

    duration: float = 0.02
    limit: float = 20.0  # [m/s]
    island_from: float = math.pi * 1e3  # [m/s]
    island_to: float = math.pi * 1e3  # [m/s]
    by_noise: float = 0.0  # of the first reading of ay, on the limit [s]

    def drive(self, state, time, car):
        return Driver(), None

    def verdict(self, log, nominal):
        limit = self.limit + self.by_noise * log.readings[0, 1]
        island = self.island_from <= self.speed <= self.island_to
        return Verdict((Criterion("too fast", self.speed, self.speed if island else limit, "m/s"),))


def search(limit, low=10.0, high=40.0, tolerance=0.1, scan=3.0, **others):
    test = CleanUpTo(limit=limit, **{f.name: others.pop(f.name) for f in fields(CleanUpTo) if f.name in others})
    return entry_speed(
        test, "qin2014", "truth", "none", others.pop("sensors", "clean"), low, high, tolerance, scan, **others
    )


@settings(max_examples=25)
@given(st.floats(10.0, 39.9), st.floats(0.01, 2.0), st.floats(0.5, 50.0))
def test_bisection_finds_a_single_limit_to_its_tolerance(limit, tolerance, scan):
    found = search(limit, tolerance=tolerance, scan=scan)
    assert limit - tolerance * (1 + 1e-6) <= found.speed <= limit
    (only,) = found.searches
    assert only.clean <= limit < only.fails <= only.clean + tolerance * (1 + 1e-6)
    assert found.bounded
    assert not only.islands


def test_the_number_of_drives_is_that_of_a_scan_and_of_bisection():
    # 11 speeds 3 m/s apart; 3/2^5 = 0.094 is the first below 0.1.
    assert len(search(21.7).searches[0].attempts) == 11 + 5
    assert len(search(50.0).searches[0].attempts) == 11


def test_a_car_that_fails_at_the_lowest_speed_has_no_entry_speed():
    found = search(5.0)
    assert math.isnan(found.speed)
    assert not found.bounded
    assert found.searches[0].fails == 10.0


def test_a_car_that_never_fails_has_the_highest_speed_as_a_lower_bound():
    found = search(100.0)
    assert found.speed == 40.0
    assert not found.bounded
    assert found.searches[0].fails == math.inf


def test_the_answer_is_below_the_first_failure_and_an_island_above_is_reported():
    found = search(17.3, island_from=24.0, island_to=29.0)
    assert found.speed == pytest.approx(17.3, abs=0.1)
    # of the scan's 10, 13, ..., 40
    assert found.searches[0].islands == (25.0, 28.0)


def test_seeds_are_searched_each_alone_and_the_share_picks_among_them():
    # Quiet sensors: the reading of ay has 0.05 m/s2; 40 s make +/- 2 m/s of it.
    seeds = range(8)
    whole = search(25.0, by_noise=40.0, sensors="gaussian", seeds=seeds)
    limits = []
    for seed in seeds:
        log = rollout(scenario(CleanUpTo(), "qin2014", "gaussian"), "truth", "none", seed)
        limits.append(25.0 + 40 * log.readings[0, 1])
    for one, limit in zip(whole.searches, limits, strict=True):
        assert one.clean <= limit < one.fails
    falling = sorted((s.clean for s in whole.searches), reverse=True)
    assert whole.speed == falling[-1] == whole.spread[0]
    assert whole.spread[1] == falling[0] > falling[-1] + 0.5
    half = search(25.0, by_noise=40.0, sensors="gaussian", seeds=seeds, share=0.5)
    assert half.speed == falling[3]


def test_a_seed_that_fails_at_once_leaves_the_others_their_share():
    found = search(12.0, by_noise=80.0, sensors="gaussian", seeds=range(8), share=0.25)
    assert any(math.isnan(s.clean) for s in found.searches)
    assert math.isnan(found.spread[0])
    assert found.speed > 10
    assert math.isnan(search(12.0, by_noise=80.0, sensors="gaussian", seeds=range(8)).speed)


def test_progress_ends_with_the_drives_that_were_driven():
    heard = []
    found = search(21.7, seeds=(0, 1), progress=lambda *done: heard.append(done))
    total = sum(len(s.attempts) for s in found.searches)
    assert [done for done, _ in heard] == list(range(1, total + 1))
    assert heard[-1] == (total, total)


def test_a_real_manoeuvre_is_clean_below_its_answer_and_not_above():
    found = entry_speed(
        "held_steer", "qin2014_understeer", "truth", "none", "clean", 15.0, 35.0, 0.5, 5.0, friction=0.4
    )
    assert found.bounded
    (one,) = found.searches
    for speed, clean in ((one.clean, True), (one.fails, False)):
        cell = scenario("held_steer", "qin2014_understeer", "clean", speed=speed, friction=0.4)
        log = rollout(cell, "truth", "none", 0)
        assert cell.manoeuvre.judge(log, cell.nominal).passed == clean


def test_a_course_of_cones_is_cleared_slowly_and_not_fast():
    # From 30 km/h, for which the drive must last long enough, to well beyond the standard's speed.
    car, ends = "qin2014_understeer", {"low": 30 / 3.6, "high": 130 / 3.6, "scan": 30.0, "tolerance": 15.0}
    found = entry_speed("double_lane_change", car, "truth", "none", "clean", **ends)
    (one,) = found.searches
    assert one.clean == pytest.approx(80 / 3.6)
    assert one.fails == pytest.approx(130 / 3.6)


@dataclass(frozen=True)
class AsFarAs(CleanUpTo):
    """Clean if the drive covers 20 m, which takes 1 s at its own speed."""

    speed: float = 20.0
    duration: float = 1.01

    def verdict(self, log, nominal):
        return Verdict((Criterion("way", log.truth[-1, p.DISTANCE], 20.0, "m", at_least=True),))


def test_an_instance_begun_more_slowly_covers_the_same_way():
    found = entry_speed(AsFarAs(), "qin2014", "truth", "none", "clean", 5.0, 30.0, 1.0, 10.0)
    assert found.searches[0].fails == math.inf


class Raises(Estimator):
    def init(self, nominal, rng):
        return None

    def update(self, state, reading, rng):
        raise RuntimeError("out of ideas")

    def estimate(self, state):
        raise AssertionError


def test_an_estimator_that_raises_fails_with_its_reason():
    found = entry_speed(SineWithDwell(), "qin2014", Raises(), "none", "clean", 10.0, 20.0)
    assert math.isnan(found.speed)
    assert "out of ideas" in " ".join(found.searches[0].attempts[0].failed)


@pytest.mark.parametrize(
    "wrong",
    [
        {"low": 40.0, "high": 10.0},
        {"low": 0.0},
        {"high": math.inf},
        {"tolerance": 0.0},
        {"scan": math.nan},
        {"share": 0.0},
        {"share": math.nan},
        {"seeds": ()},
        {"seeds": (1, 1)},
    ],
)
def test_a_search_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        search(20.0, **wrong)


def test_names_are_checked_before_anything_is_driven():
    with pytest.raises(UnknownNameError, match="known: sine_with_dwell"):
        entry_speed("sine")
    with pytest.raises(UnknownNameError, match="known: truth"):
        fmvss126("qin2014", "ekff")
