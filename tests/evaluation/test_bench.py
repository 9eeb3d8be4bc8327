"""Driving a study: how many seeds a precision takes, and the same rows from every kind of worker."""

import sys

import polars as pl
import pytest

from vse_gym.evaluation import TIMES, Bench, contenders, evaluate
from vse_gym.evaluation.bench import seeds_for
from vse_gym.evaluation.parallel import in_parallel
from vse_gym.report.statistics import precision


def square(x):
    return x * x


@pytest.mark.parametrize("backend", ["loky", "dask"])
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::FutureWarning")
def test_every_backend_gives_every_result_once(backend):
    calls = [(k,) for k in range(20)]
    assert sorted(in_parallel(square, calls, 2, backend)) == [k * k for k in range(20)]


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::FutureWarning")
def test_a_study_on_a_local_ray_gives_the_table_that_one_process_gives(short):
    pytest.importorskip("ray", reason="Ray has no build for this Python")
    work = Bench(short, contenders(["truth", "ekf"]), 2, jobs=2, backend="ray")
    work.drive()
    assert work.runs.drop(TIMES).equals(evaluate(short).drop(TIMES), null_equal=True)


def test_a_backend_whose_library_is_missing_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'vse-gym\[cluster\]'"):
        list(in_parallel(square, [(1,)], 1, "ray"))


def test_a_backend_that_does_not_exist_is_told_the_known():
    with pytest.raises(ValueError, match="loky, ray, dask"):
        list(in_parallel(square, [(1,)], 1, "spark"))


def test_progress_counts_every_cell_and_seed(short):
    told = []
    Bench(short, contenders(["truth"]), 2).drive(lambda done, total: told.append((done, total)))
    assert told == [(k, 4) for k in range(5)]


def test_seeds_grow_with_the_square_of_what_is_lacking_and_never_stand_still():
    assert seeds_for(0.1, 0.12, 20, 200) == 32  # 1.1 * 20 * 1.44
    assert seeds_for(0.1, 1.0, 20, 200) == 40  # at most twice as many at once: the first estimate is a rough one
    assert seeds_for(0.1, 0.1001, 1, 200) == 2
    assert seeds_for(0.1, float("nan"), 1, 200) == 2  # one seed says nothing of the spread
    assert seeds_for(0.01, 1.0, 150, 200) == 200


def test_seeds_are_added_until_the_interval_is_as_narrow_as_asked(short):
    judged = contenders(["truth", "ekf"])
    first = Bench(short, judged, 10)
    first.drive()
    wide = precision(first.runs)
    work = Bench(short, judged, 10).drive_until(wide / 3, most=14)
    assert precision(work.runs) <= wide / 3 or work.seeds == 14
    assert 10 < work.seeds == work.runs["seed"].n_unique()
    same = evaluate(short, seeds=work.seeds)
    assert work.runs.drop(TIMES).equals(same.drop(TIMES), null_equal=True)


def test_a_precision_that_is_reached_adds_none(short):
    assert Bench(short, contenders(["truth", "ekf"]), 12).drive_until(14.0).seeds == 12


def test_a_precision_is_not_believed_of_a_few_seeds(short):
    assert Bench(short, contenders(["truth", "zero"]), 2).drive_until(14.0).seeds == 10
    assert Bench(short, contenders(["truth", "zero"]), 2).drive_until(14.0, most=3).seeds == 3


def test_rows_of_parts_stand_beside_their_whole(short):
    from dataclasses import replace

    runs = evaluate(replace(short, attribution=True), ["truth", "ekf"], seeds=1)
    rows = runs.filter(pl.col("cell") == "short").select("estimator", "parent", "part")
    assert sorted(rows.rows()) == [
        ("ekf", "ekf", "whole"),
        ("ekf: acceleration", "ekf", "acceleration"),
        ("ekf: velocity", "ekf", "velocity"),
        ("ekf: yaw", "ekf", "yaw"),
        ("none", "none", "whole"),
        ("truth", "truth", "whole"),
    ]
