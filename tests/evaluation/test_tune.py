"""The search for a tuning: it finds what is known, repeats itself, stops what is hopeless, survives being stopped."""

import math
from collections import Counter

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vse_gym.catalogue import ESTIMATORS
from vse_gym.evaluation import Cell, Randomise, Study, evaluate, study_names, tune
from vse_gym.evaluation.tunings import Tuning, ranges

LIMITS = {"a": (0.01, 10.0), "b": (0.0, 1.0)}
START = {"a": 5.0, "b": 0.0}
BEST = {"a": 0.3, "b": 0.6}
TRAINING = Study.load(tune.TRAINING)


def bowl(values, part):
    """Least at BEST, and higher for every part alike."""
    return 1.0 + part + math.log(values["a"] / BEST["a"]) ** 2 + (values["b"] - BEST["b"]) ** 2


def small(**changes):
    settings = {"speed_kmh": 80, "amplitude_deg": 120, "friction": 0.5, "duration": 2.0}
    cells = tuple(
        Cell(f"swerve, {sensors}", "sine_with_dwell", sensors=sensors, settings=settings)
        for sensors in ("loud", "biased")
    )
    randomise = Randomise(speed=1.0, steer=0.1, mass=(1.0, 1.25))
    return Study(
        **{"name": "small", "version": 1, "cells": cells, "seeds": 3, "first_seed": 5000} | changes, randomise=randomise
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_known_optimum_of_a_bowl_is_found(seed):
    trials, whole = tune.search(bowl, START, LIMITS, parts=2, budget=60, seed=seed)
    assert whole and len(trials) == 60
    best = min((t for t in trials if len(t.scores) == 2), key=lambda t: np.mean(t.scores))
    # 60 points at random in this plane come within 0.3 in ln a and 0.1 in b with a chance of 0.8 alone
    assert abs(math.log(best.values["a"] / BEST["a"])) < 0.3
    assert abs(best.values["b"] - BEST["b"]) < 0.25  # where the bowl is flatter


def test_the_default_comes_first_and_nothing_leaves_its_range():
    trials, _ = tune.search(bowl, START, LIMITS, parts=1, budget=20)
    assert trials[0] == tune.Trial(START, (bowl(START, 0),))
    for trial in trials:
        assert all(low <= trial.values[name] <= high for name, (low, high) in LIMITS.items())


def test_every_trial_meets_the_same_parts_in_the_same_order_and_hopeless_ones_are_stopped():
    asked = []

    def noted(values, part):
        asked.append(part)
        return bowl(values, part)

    trials, _ = tune.search(noted, START, LIMITS, parts=4, budget=40)
    assert asked == [part for trial in trials for part in range(len(trial.scores))]
    lengths = Counter(len(trial.scores) for trial in trials)
    assert lengths.keys() == {2, 4}  # in a bowl whoever is behind is so at the second part already
    best = min(np.mean(t.scores[:2]) for t in trials)
    assert all(np.mean(t.scores) > best for t in trials if len(t.scores) < 4)


def test_the_same_seed_searches_alike_and_another_does_not():
    first, again, other = (tune.search(bowl, START, LIMITS, 2, 15, seed)[0] for seed in (1, 1, 2))
    assert first == again != other


@pytest.mark.parametrize("call", [0, 1, 5, 10])
def test_a_search_that_is_stopped_hands_out_the_trials_that_were_whole(call):
    calls = iter(range(100))

    def stopped(values, part):
        if next(calls) == call:
            raise KeyboardInterrupt
        return bowl(values, part)

    trials, whole = tune.search(stopped, START, LIMITS, parts=2, budget=20)
    assert not whole
    assert sum(len(t.scores) for t in trials) == call - call % 2  # the first five trials have both parts


def test_progress_is_told_after_every_trial():
    told = []
    tune.search(bowl, START, LIMITS, 2, 4, progress=lambda *what: told.append(what))
    assert [(done, total) for _, done, total in told] == [(k, 4) for k in (1, 2, 3, 4)]
    assert told[0][0] == f"best {bowl(START, 0.5):.2f}, default {bowl(START, 0.5):.2f}"


def test_the_interval_of_a_score_is_student_s():
    regrets = [2.0, 3.5, 1.0, 4.0]
    interval = stats.ttest_1samp(regrets, 0).confidence_interval()
    np.testing.assert_allclose(tune.score_of(regrets), (np.mean(regrets), *interval))
    assert tune.score_of([2.0]) == (2.0, -math.inf, math.inf)


# -- in the loop ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tuned():
    return tune.tune("kinematic", 8, small())


def test_its_figures_are_those_of_a_study_on_the_same_seeds(tuned):
    rows = {"default": "kinematic", "tuned": tuned.make()}
    for name, seeds in (("training", range(5000, 5003)), ("validation", range(5003, 5013))):
        runs = evaluate(small(first_seed=seeds.start, seeds=len(seeds)), rows)
        said = tuned.origin[name]
        assert (said["first_seed"], said["seeds"]) == (seeds.start, len(seeds))
        for row in rows:
            by_seed = runs.filter(pl.col("estimator") == row).group_by("seed").agg(pl.col("regret").mean())
            np.testing.assert_allclose(tuple(said[row].values()), tune.score_of(by_seed["regret"].to_list(), 0.0))


def test_it_is_no_worse_than_the_default_where_it_was_chosen(tuned):
    assert tuned.origin["validation"]["difference"]["mean"] <= 0
    assert tuned.origin["finished"] + tuned.origin["stopped_early"] == tuned.origin["budget"] == 8


def test_only_what_is_tunable_was_changed(tuned):
    default = ESTIMATORS.make("kinematic")
    assert {k for k, v in tuned.settings.items() if v != getattr(default, k)} <= ranges(default).keys()


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_same_seed_writes_the_same_file_on_any_number_of_processes(tuned, tmp_path, jobs):
    tuned.save(tmp_path / "first.toml")
    tune.tune("kinematic", 8, small(), jobs=jobs).save(tmp_path / "again.toml")
    assert (tmp_path / "again.toml").read_bytes() == (tmp_path / "first.toml").read_bytes()


def interrupt(monkeypatch, after):
    """Ctrl-C after so many drives."""
    drives, real = iter(range(10_000)), tune.regret

    def regret(drawn, estimator):
        if next(drives) == after:
            raise KeyboardInterrupt
        return real(drawn, estimator)

    monkeypatch.setattr(tune, "regret", regret)


# The default alone takes 6 drives, 3 trials take 18; then every finalist is driven 20 times.
@pytest.mark.parametrize(("after", "finished"), [(6, 1), (13, 2), (18, 3), (40, 3)])
def test_a_search_that_is_stopped_leaves_the_best_so_far(monkeypatch, tmp_path, after, finished):
    interrupt(monkeypatch, after)
    stopped = tune.tune("kinematic", 3, small())
    assert stopped.origin["interrupted"]
    assert stopped.origin["finished"] == finished
    assert "validation" not in stopped.origin
    assert stopped.origin["training"]["difference"]["mean"] <= 0
    stopped.save(tmp_path / "a.toml")
    assert Tuning.load(tmp_path / "a.toml") == stopped


def test_stopped_before_the_default_was_driven_there_is_nothing_to_write(monkeypatch):
    interrupt(monkeypatch, 3)
    with pytest.raises(KeyboardInterrupt):
        tune.tune("kinematic", 3, small())


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_can_be_tuned_or_says_that_there_is_nothing_to_tune(name, monkeypatch):
    interrupt(monkeypatch, 0)
    if ranges(ESTIMATORS.make(name)):
        with pytest.raises(KeyboardInterrupt):  # it begins to drive
            tune.tune(name, 1, small(seeds=1))
    else:
        with pytest.raises(ValueError, match="has nothing to tune: no field of it"):
            tune.tune(name, 1, small(seeds=1))
    alone = ("truth", "truth_velocity", "zero", "gru", "kalman_gru")  # a net's settings are its weights
    assert bool(ranges(ESTIMATORS.make(name))) == (name not in alone)


REFUSED = {
    "unknown estimator": (("eckf", 3), {}, "no estimator named 'eckf'; known: truth"),
    "no budget": (("ekf", 0), {}, "budget and seeds must be at least 1"),
    "no seeds": (("ekf", 1), {"seeds": 0}, "budget and seeds must be at least 1"),
    "unknown study": (("ekf", 1, "trainning"), {}, "no study named 'trainning'; known: "),
    "a table's study": (("ekf", 1, "demo"), {}, "'demo' is not for tuning: its seeds begin at 0"),
}


@pytest.mark.parametrize(("words", "settings", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_searched_is_refused_with_a_sentence(words, settings, sentence):
    with pytest.raises((KeyError, ValueError), match=sentence):
        tune.tune(*words, **settings)


def combination(cell):
    return cell.manoeuvre, tuple(sorted(cell.settings.items())), cell.sensors, cell.vehicle


@pytest.mark.parametrize("name", sorted(set(study_names()) - {tune.TRAINING}))
def test_tuning_shares_no_cell_and_no_seed_with_any_other_study(name):
    other = Study.load(name)
    assert not {c.name for c in TRAINING.cells} & {c.name for c in other.cells}
    assert not set(map(combination, TRAINING.cells)) & set(map(combination, other.cells))
    used = {*range(TRAINING.first_seed, TRAINING.first_seed + TRAINING.seeds), *tune.validation_seeds(TRAINING)}
    assert not used & set(range(other.first_seed, other.first_seed + other.seeds))
    assert other.first_seed + other.seeds <= tune.FIRST_SEED <= min(used)
