"""What changed between two results: planted changes are recovered, and nothing is made of nothing."""

import json

import numpy as np
import polars as pl
import pytest

from vse_gym.report.compare import compare_results, sections, unchanged
from vse_gym.report.results import read_results

RNG = np.random.default_rng


def runs(rng=None, estimators=("ekf", "pf", "none"), cells=("curve", "lane change"), seeds=12):
    """Rows as a study has them, a seed's luck shared by all estimators."""
    rng = rng or RNG(0)
    luck = rng.normal(0, 1, seeds)
    return pl.DataFrame(
        [
            {"cell": cell, "seed": seed, "estimator": name, "regret": 5 + luck[seed] + 0.3 * rng.normal()}
            | {"loop_ended": "spin" if rng.random() < 0.2 else "", "study": "demo", "commit": "abc"}
            | {"shadow_sideslip_rmse_deg": None if name == "none" else rng.random()}
            | {
                "shadow_coverage_percent": None
                if name == "none"
                else float("nan")
                if name == "pf"
                else 90 + rng.random()
            }
            for cell in cells
            for seed in range(seeds)
            for name in estimators
        ],
        infer_schema_length=None,
    )


def folder(path, table, times=None, **told):
    """A folder of results on disk, read again."""
    path.mkdir(parents=True)
    table.write_parquet(path / "runs.parquet")
    if times is not None:
        times.write_parquet(path / "times.parquet")
    if told:
        (path / "run.json").write_text(json.dumps(told))
    return read_results(path)


def times(table, update, machine="one"):
    keys = table.filter(pl.col("estimator") != "none").select("cell", "seed", "estimator")
    return keys.with_columns(shadow_update_us=pl.lit(update), machine=pl.lit(machine))


def test_a_folder_and_itself_are_bit_equal_without_any_difference(tmp_path):
    a = folder(tmp_path / "a", runs(), study="demo", study_digest="d1")
    found = compare_results(a, a)
    assert found.origin == []
    assert found.equality.startswith("The 72 common runs are bit-equal in all ")
    for frame in (found.changes, found.by_cell):
        assert (frame["difference"].drop_nans() == 0).all() and set(frame["verdict"]) <= {"same", "-"}
    assert sections(found) == [] and "mean regret" in unchanged(found)


def test_other_commits_and_times_are_no_difference_of_the_runs_and_the_last_bit_is(tmp_path):
    table = runs()
    a = folder(tmp_path / "a", table, times(table, 5.0), commit="abc")
    other = table.with_columns(commit=pl.lit("def"), tuning=pl.lit("tuned"))
    b = folder(tmp_path / "b", other.sample(fraction=1, shuffle=True, seed=1), times(table, 7.0), commit="def")
    found = compare_results(a, b)
    assert "bit-equal in all" in found.equality and "not" not in found.equality
    assert "commit: abc in A, def in B" in found.origin
    nudged = table.with_row_index().with_columns(
        regret=pl.when(pl.col("index") == 7).then(pl.col("regret") * (1 + 2**-52)).otherwise("regret")
    )
    found = compare_results(a, folder(tmp_path / "c", nudged.drop("index")))
    assert "not bit-equal: 1 differ, in regret." in found.equality


def test_what_is_not_a_number_in_both_is_equal_and_what_is_in_one_is_not(tmp_path):
    table = runs()
    filled = table.with_columns(pl.col("shadow_coverage_percent").fill_nan(50.0))
    a, b = folder(tmp_path / "a", table), folder(tmp_path / "b", filled)
    assert "bit-equal in all" in compare_results(a, a).equality
    assert "24 differ, in shadow_coverage_percent." in compare_results(a, b).equality
    changes = compare_results(a, b).changes.filter(measure="shadow_coverage_percent", estimator="pf")
    assert np.isnan(changes["difference"][0]) and changes["verdict"][0] == "-"


def test_a_planted_shift_is_recovered_in_its_interval_and_marked(tmp_path):
    a = folder(tmp_path / "a", runs(RNG(1)))
    noise = pl.Series(0.5 + 0.2 * RNG(2).normal(size=len(a.runs)))
    worse = a.runs.with_columns(
        regret=pl.when(pl.col("estimator") == "pf").then(pl.col("regret") + noise).otherwise("regret")
    )
    b = folder(tmp_path / "b", worse)
    changes = compare_results(a, b).changes.filter(measure="regret")
    row = changes.filter(estimator="pf").row(0, named=True)
    assert row["low"] <= 0.5 <= row["high"] and row["verdict"] == "worse"
    # 24 pairs of noise 0.2: a standard error of 0.04, though the seeds' luck scatters by 1
    assert row["difference"] == pytest.approx(0.5, abs=0.15) and row["high"] - row["low"] < 0.4
    assert row["b"] - row["a"] == pytest.approx(row["difference"], abs=1e-5)
    assert changes.filter(estimator="ekf")["verdict"][0] == "same"
    back = compare_results(b, a).changes.filter(measure="regret", estimator="pf").row(0, named=True)
    assert back["verdict"] == "better" and back["difference"] == pytest.approx(-row["difference"])


def test_the_interval_of_a_shift_covers_about_as_often_as_it_says(tmp_path):
    a = folder(tmp_path / "a", runs(estimators=("ekf",)).select("cell", "seed", "estimator", "regret"))
    inside, trials = 0, 60
    for k in range(trials):
        noise = pl.Series(0.5 + RNG(k).normal(size=len(a.runs)))
        b = a._replace(runs=a.runs.with_columns(pl.col("regret") + noise))
        row = compare_results(a, b).changes.filter(measure="regret").row(0, named=True)
        inside += row["low"] <= 0.5 <= row["high"]
    assert inside / trials >= 0.86  # 60 trials of 95 % scatter by 2.8 %


def test_the_cell_that_changed_is_the_first_of_those_shown(tmp_path):
    a = folder(tmp_path / "a", runs())
    where = (pl.col("cell") == "curve") & (pl.col("estimator") == "ekf")
    b = folder(
        tmp_path / "b", a.runs.with_columns(regret=pl.when(where).then(pl.col("regret") - 2).otherwise("regret"))
    )
    found = compare_results(a, b)
    most = next(part for part in sections(found) if part.title == "where regret changed most")
    assert [row[:2] for row in most.rows] == [["curve", "ekf"]] and most.rows[0][-1] == "better"
    every = next(part for part in sections(found, by_cell=True) if part.title == "regret in all cells")
    assert len(every.rows) == 2 * 3


def test_only_what_both_have_is_compared_and_the_rest_is_named(tmp_path):
    a = folder(tmp_path / "a", runs(), study_digest="d1")
    other = runs(estimators=("ekf", "ukf", "none"), cells=("curve", "slalom"), seeds=15).filter(pl.col("seed") > 2)
    found = compare_results(a, folder(tmp_path / "b", other.drop("study"), study_digest="d2"))
    said = "\n".join(found.origin)
    assert "The studies differ: the drives are not the same" in said
    for line in ("cells only in A: lane change", "cells only in B: slalom", "seeds only in A: 0 to 2"):
        assert line in found.origin
    for line in ("seeds only in B: 12 to 14", "estimators only in A: pf", "estimators only in B: ukf"):
        assert line in found.origin
    assert "The 18 common runs" in found.equality and "Columns that only one has: " not in found.equality
    assert set(found.changes["estimator"]) == {"ekf", "none"}


def test_without_digests_it_is_not_known_whether_the_drives_are_the_same(tmp_path):
    a = folder(tmp_path / "a", runs())
    assert any("not known" in line for line in compare_results(a, a).origin)


def test_columns_and_types_that_differ_are_said(tmp_path):
    a = folder(tmp_path / "a", runs())
    b = folder(tmp_path / "b", a.runs.with_columns(extra=1, loop_ended=pl.lit(0)).with_columns(pl.col("regret") + 1))
    said = compare_results(a, b._replace(runs=b.runs.with_columns(pl.col("loop_ended").cast(pl.String)))).equality
    assert "72 differ, in loop_ended, regret" in said or "72 differ, in regret, loop_ended" in said
    assert "Columns that only one has: extra." in said


def test_runs_of_unfinished_seeds_are_left_out_and_that_is_said(tmp_path):
    table = runs()
    stopped = table.filter(~((pl.col("seed") == 11) & (pl.col("cell") == "curve")))
    found = compare_results(folder(tmp_path / "a", table), folder(tmp_path / "b", stopped))
    assert any(line.startswith("3 common runs are of seeds that not every cell has") for line in found.origin)
    want = table.filter((pl.col("seed") < 11) & (pl.col("estimator") == "ekf"))["regret"].mean()
    assert found.changes.filter(measure="regret", estimator="ekf")["a"][0] == pytest.approx(want)


def test_one_seed_has_a_difference_and_no_interval(tmp_path):
    a = folder(tmp_path / "a", runs(seeds=1))
    changes = compare_results(a, a).changes.filter(measure="regret")
    assert set(changes["verdict"]) == {"same"}
    b = a._replace(runs=a.runs.with_columns(pl.col("regret") + 1))
    row = compare_results(a, b).changes.filter(measure="regret", estimator="ekf").row(0, named=True)
    assert row["difference"] == pytest.approx(1) and np.isnan(row["low"]) and row["verdict"] == "?"


def test_tunings_that_differ_are_named_with_their_digests(tmp_path):
    a = folder(tmp_path / "a", runs(), tunings={"ekf": ["default", "1a"], "pf": ["default", "2b"]})
    columns = {"tuning": pl.lit("tuned"), "tuning_digest": pl.lit("3c")}
    b = folder(tmp_path / "b", runs().with_columns(**columns), tunings={"pf": ["default", "2b"]})
    said = [line for line in compare_results(a, b).origin if line.startswith("tuning")]
    assert said == ["tuning of ekf: default 1a in A, tuned 3c in B"]  # of B by its rows, for its manifest has none


def test_times_are_a_ratio_of_medians_and_other_machines_are_said(tmp_path):
    table = runs()
    a, b = (folder(tmp_path / m, table, times(table, us, m), commit="x") for m, us in (("one", 4.0), ("other", 6.0)))
    found = compare_results(a, b)
    assert found.times["estimator"].to_list() == ["ekf", "pf"] and found.times["ratio"].to_list() == [1.5, 1.5]
    assert found.machines == "The machines differ, so the ratio is of them too. A: one. B: other."
    assert compare_results(a, a).machines == "Both on one."
    assert compare_results(a, folder(tmp_path / "c", table)).times.is_empty()


def test_times_among_the_runs_themselves_are_times_too(tmp_path):
    table = runs().with_columns(shadow_update_us=3.0, loop_update_us=RNG(0).random())
    a = folder(tmp_path / "a", table)
    found = compare_results(a, folder(tmp_path / "b", table.with_columns(shadow_update_us=6.0)))
    assert "bit-equal in all" in found.equality and set(found.times["ratio"]) == {2.0}
    assert "Not known to be one machine" in found.machines


def test_a_parquet_file_alone_is_enough(tmp_path):
    a = folder(tmp_path / "a", runs(), commit="abc")
    assert "bit-equal" in compare_results(a, read_results(tmp_path / "a" / "runs.parquet")).equality


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: path.with_suffix(".other").touch(), "there is no "),
        (lambda path: path.mkdir(), "holds no runs.parquet: a folder that"),
        (lambda path: (path / "parts").mkdir(parents=True), "its run was not finished, which --resume does"),
        (lambda path: path.write_bytes(b"PAR1 and nothing more"), "cannot be read, it is damaged"),
        (lambda path: runs().drop("regret").write_parquet(path), "is no table of runs: it lacks regret"),
        (lambda path: runs().clear().write_parquet(path), "holds no run"),
        (lambda path: pl.concat([runs(), runs()]).write_parquet(path), "two rows of one cell, seed and estimator"),
    ],
)
def test_what_holds_no_results_is_refused_with_a_sentence(tmp_path, make, sentence):
    path = tmp_path / "results"
    make(path)
    with pytest.raises(ValueError, match=sentence):
        read_results(path)


@pytest.mark.parametrize("text", ["{", "[1]"])
def test_a_damaged_manifest_or_table_of_times_is_refused_with_a_sentence(tmp_path, text):
    folder(tmp_path / "a", runs())
    (tmp_path / "a" / "run.json").write_text(text)
    with pytest.raises(ValueError, match=r"run.json"):
        read_results(tmp_path / "a")
    folder(tmp_path / "b", runs())
    (tmp_path / "b" / "times.parquet").write_bytes(b"")
    with pytest.raises(ValueError, match=r"times.parquet cannot be read"):
        read_results(tmp_path / "b")


def test_a_truncated_table_is_refused_with_a_sentence(tmp_path):
    folder(tmp_path / "a", runs())
    whole = (tmp_path / "a" / "runs.parquet").read_bytes()
    (tmp_path / "a" / "runs.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="damaged"):
        read_results(tmp_path / "a")


def test_two_results_without_a_common_run_are_refused_and_say_what_each_has(tmp_path):
    a, b = folder(tmp_path / "a", runs()), folder(tmp_path / "b", runs(estimators=("ukf",)))
    with pytest.raises(ValueError, match=r"no run in common: .*estimators ekf, none, pf; estimators ukf"):
        compare_results(a, b)
