"""The search for the highest clean entry speed, on drives whose limit is known beforehand."""

import math
from dataclasses import dataclass, fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import Criterion, Manoeuvre, Verdict
from vse_gym.manoeuvres.sine_with_dwell import SineWithDwell
from vse_gym.physics import parameters as p
from vse_gym.procedures import entry_speed
from vse_gym.registry import UnknownNameError
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Driver


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
