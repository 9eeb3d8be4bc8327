"""What the battery says of estimators that were made worse on purpose, from tables that are known."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from vse_gym.estimators.anchors import Truth
from vse_gym.evaluation import Cell, Randomise, Study, evaluate
from vse_gym.report.statistics import Cube, cube, ranked

PROGRAM = Path(__file__).parent.parent / "benchmarks" / "known_bad.py"


@pytest.fixture(scope="module")
def known_bad():
    spec = importlib.util.spec_from_file_location("known_bad", PROGRAM)
    module = sys.modules["known_bad"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["known_bad"]


@pytest.fixture
def runs(known_bad):
    """Regrets over 12 seeds and two cells: children 1 worse than their parent in the first cell, and 0.5 better."""
    names = tuple(sorted(known_bad.contenders()))
    noise = np.random.default_rng(0).uniform(0, 0.1, (len(names), 12, 2))
    child = np.array([name not in known_bad.PARENTS for name in names], dtype=float)
    return Cube(names, tuple(range(12)), ("a", "b"), 3 + noise + child[:, None, None] * np.array([1.0, -0.5]))


def test_every_parent_is_followed_by_its_children(known_bad):
    names = list(known_bad.contenders())
    assert len(names) == 2 * (1 + len(known_bad.WORSE))
    assert {known_bad.parent_of(name) for name in names} == set(known_bad.PARENTS)
    assert known_bad.contenders()["truth, 100 ms late"] == Truth(delay=0.1)


def test_a_child_that_is_worse_over_all_is_called_worse_and_its_exceptions_are_listed(known_bad, runs):
    heads, rows = known_bad.against_parents(runs)
    verdicts = {row[0]: row[heads.index("verdict")] for row in rows}
    assert len(rows) == len(runs.estimators)
    assert all(verdicts[name] == ("" if name in known_bad.PARENTS else "worse") for name in runs.estimators)
    without = known_bad.against_parents(runs, benign=["b"])[1]
    assert all(row[-1].startswith(("0.9", "1.0")) for row in without if row[0] not in known_bad.PARENTS)
    lines = known_bad.exceptions(runs)
    assert len(lines) == 2 * len(known_bad.WORSE)
    assert all(": b: -0." in line and line.endswith("*") for line in lines)


def test_one_that_is_no_worse_is_not_called_so(known_bad, runs):
    level = runs._replace(values=np.random.default_rng(1).uniform(0, 1, runs.values.shape))
    verdicts = [row[3] for row in known_bad.against_parents(level)[1]]
    # 10 intervals of 95 %: four at once beyond 0 would be less likely than 1 %, were they independent
    assert verdicts.count("not apart") >= 7
    better = runs._replace(values=6 - runs.values)
    assert [row[3] for row in known_bad.against_parents(better)[1]].count("better") == 2 * len(known_bad.WORSE)


def test_on_the_road_everything_that_truth_loses_costs_something(known_bad):
    settings = {"speed_kmh": 80, "amplitude_deg": 270, "friction": 0.4, "duration": 4.0}
    cell = Cell("short", "sine_with_dwell", controller="sideslip_esc", sensors="clean", settings=settings)
    study = Study("short", 1, (cell,), randomise=Randomise(mass=(1.0, 1.25)))
    truths = {name: made for name, made in known_bad.contenders().items() if known_bad.parent_of(name) == "truth"}
    found = cube(ranked(evaluate(study, truths, seeds=3)))
    regret = dict(zip(found.estimators, found.by_seed.mean(axis=1), strict=True))
    assert regret.pop("truth") == 0
    # sideslip decides under this controller: each is worth more than a tiny disturbance, and blindness most
    assert min(regret.values()) > 0.5
    assert max(regret, key=regret.__getitem__) == "truth, zero sideslip"
