"""The agreement of two plants on an order, from tables that are known; and both drive the same cells."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from vse_gym.report.statistics import Cube

PROGRAM = Path(__file__).parent.parent / "benchmarks" / "plants.py"


@pytest.fixture(scope="module")
def plants():
    spec = importlib.util.spec_from_file_location("plants", PROGRAM)
    module = sys.modules["plants"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["plants"]


ORDER = np.arange(8.0)[:, None, None] + np.random.default_rng(0).uniform(0, 0.5, (8, 10, 3))


def test_the_same_order_agrees_and_its_reverse_disagrees_at_every_seed(plants):
    assert plants.agreement(ORDER, 10 * ORDER) == pytest.approx((1, 1, 1))
    assert plants.agreement(ORDER, -ORDER) == pytest.approx((-1, -1, -1))


def test_where_seeds_make_the_order_the_interval_says_that_nothing_is_known(plants):
    noise = np.random.default_rng(1).normal(0, 1, (2, 8, 10, 1))
    figure, low, high = plants.agreement(*noise)
    assert low < figure < high and low < 0 < high and high - low > 0.5


def test_both_plants_drive_the_same_draws(plants):
    ours, theirs = (plants.study_on(plant) for plant in plants.PLANTS)
    for own, other in zip(ours.cells, theirs.cells, strict=True):
        a, b = own.scenario(ours.randomise, 3), other.scenario(theirs.randomise, 3)
        assert (a.plant, b.plant) == plants.PLANTS
        assert (a.manoeuvre, a.vehicle, a.sensors, a.nominal) == (b.manoeuvre, b.vehicle, b.sensors, b.nominal)


def test_the_table_stands_in_the_order_of_our_plant(plants):
    names = tuple("hgfedcba")
    cubes = (Cube(names, tuple(range(10)), ("x", "y", "z"), values) for values in (ORDER, ORDER[::-1]))
    heads, rows = plants.side_by_side(*cubes)
    assert [row[0] for row in rows] == list(names) and heads[2:] == ["x", "y", "z"]
