"""How far the shadow's error predicts regret: planted answers are found, and intervals mean what they say."""

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vse_gym.report.question import ALL, ERROR, IN_LOOP, Pair, _by_cell, _misleading, answer
from vse_gym.report.question_figure import question_figure
from vse_gym.report.question_text import answer_text
from vse_gym.report.statistics import Cube

RNG = np.random.default_rng


def table(error, regret, controllers=None, **columns):
    """A table of runs of arrays (E, S, C); estimators are e0, e1, ..., cells c0, c1, ..."""
    size, seeds, cells = error.shape
    controllers = controllers or ["esc"] * cells
    return pl.DataFrame(
        [
            {"cell": f"c{c}", "seed": s, "estimator": f"e{e}", "controller": controllers[c], "regret": regret[e, s, c]}
            | {ERROR: error[e, s, c], IN_LOOP: error[e, s, c] + regret[e, s, c]}
            | {name: values[e, s, c] for name, values in columns.items()}
            for e in range(size)
            for s in range(seeds)
            for c in range(cells)
        ]
    )


def noisy(means, seeds, cells, noise, rng):
    """Runs (E, S, C) about the means of estimators."""
    return np.asarray(means, float)[:, None, None] + noise * rng.normal(size=(len(means), seeds, cells))


def pair(*values):
    """Errors and regrets (E, S, C) as the answer has them."""
    size, seeds, cells = values[0].shape
    names = [tuple(f"{what}{k}" for k in range(n)) for what, n in (("e", size), ("c", cells))]
    return Pair(*(Cube(names[0], tuple(range(seeds)), names[1], v) for v in values))


@pytest.mark.parametrize("sign", [1, -1])
def test_an_error_that_orders_regret_perfectly_has_a_rank_correlation_of_1_reversed_of_minus_1(sign):
    error = noisy([1, 2, 3, 4, 5], 8, 3, 0.01, RNG(0))
    found = answer(table(error, 7 + sign * np.sqrt(error)))
    row = found.overall.row(0, named=True)
    for name in ("spearman", "kendall"):
        for end in ("", "_low", "_high", "_cells_low", "_cells_high"):
            assert row[f"{name}{end}"] == pytest.approx(sign)
    assert found.by_cell["spearman"].to_list() == pytest.approx([sign] * 3)
    assert found.repeats["rank_correlation"][0] == pytest.approx(sign)
    assert found.by_cell["same"].to_list() == found.by_cell["tied"].to_list() == [sign == 1] * 3
    assert len(found.misleading) == (0 if sign == 1 else 3 * 10)  # every pair in every cell


def test_an_answer_without_rank_correlation_holds_0_and_one_with_it_does_not():
    for regret, holds in (([1, 4, 2, 0, 3, 2.5], True), ([0, 1, 2, 4, 3, 5], False)):
        runs = table(*(noisy(means, 10, 2, 1.0, RNG(k)) for k, means in enumerate(([0, 1, 2, 3, 4, 5], regret))))
        row = answer(runs).overall.row(0, named=True)
        assert (row["spearman_low"] <= 0 <= row["spearman_high"]) == holds


def test_the_interval_narrows_with_seeds_and_holds_the_value():
    error = noisy(np.arange(6), 40, 2, 2.0, RNG(2))
    regret = noisy(np.arange(6), 40, 2, 2.0, RNG(3))
    widths = []
    for seeds in (5, 40):
        row = answer(table(error[:, :seeds], regret[:, :seeds])).overall.row(0, named=True)
        assert row["spearman_low"] <= row["spearman"] <= row["spearman_high"]
        widths.append(row["spearman_high"] - row["spearman_low"])
    assert widths[1] < widths[0]


def test_cells_that_disagree_widen_the_interval_over_cells_and_not_that_over_seeds():
    error = np.tile(np.arange(1.0, 7.0)[:, None, None], (1, 8, 4)) + 0.01 * RNG(0).normal(size=(6, 8, 4))
    regret = error.copy()
    regret[:, :, 0] = 40 - 5 * regret[:, :, 0]  # strong enough to turn the mean when it is drawn often
    row = answer(table(error, regret)).overall.row(0, named=True)
    assert row["spearman_high"] - row["spearman_low"] < 0.1
    assert row["spearman_cells_low"] == pytest.approx(-1) and row["spearman_cells_high"] == pytest.approx(1)


def test_one_cell_or_one_seed_has_no_interval_over_it():
    error = noisy([1, 2, 3], 6, 1, 0.1, RNG(0))
    row = answer(table(error, error)).overall.row(0, named=True)
    assert np.isnan(row["spearman_cells_low"]) and row["spearman_low"] == pytest.approx(1)
    row = answer(table(error[:, :1], error[:, :1])).overall.row(0, named=True)
    assert np.isnan(row["spearman_low"]) and row["spearman"] == pytest.approx(1)


def planted():
    """Errors that order regret, but in cell c1 e0 has the less error and the more regret than e1."""
    error, regret = noisy([1, 2, 3, 4], 12, 3, 0.1, RNG(4)), noisy([1, 2, 3, 4], 12, 3, 0.1, RNG(5))
    regret[0, :, 1] = 6 + 0.1 * RNG(6).normal(size=12)
    return error, regret


def test_a_planted_misleading_pair_is_found_and_the_largest_is_first():
    found = answer(table(*planted())).misleading
    assert set(found["cell"]) == {"c1"} and set(found["less_error"]) == {"e0"}
    assert found["more_error"].to_list() == ["e1", "e2", "e3"]
    first = found.row(0, named=True)
    assert first["error"] == pytest.approx(-1, abs=0.2) and first["regret"] == pytest.approx(4, abs=0.2)
    assert first["error_high"] < 0 < first["regret_low"]


@pytest.mark.parametrize("which", ["error", "regret"])
def test_a_pair_whose_difference_is_not_significant_does_not_mislead(which):
    error, regret = planted()
    noise = np.tile([-8.0, 8.0], 6)  # a mean of 0, and far more than any difference
    (error if which == "error" else regret)[0, :, 1] += noise
    assert answer(table(error, regret)).misleading.is_empty()


@pytest.mark.parametrize("differ", [0.0, 1.0])
def test_few_pairs_mislead_by_chance(differ):
    # regret has no differences; errors have none, or clear ones
    found, trials = 0, 40
    for k in range(trials):
        error, regret = noisy(differ * np.arange(8), 10, 1, 0.3, RNG(2 * k)), noisy(8 * [5], 10, 1, 1, RNG(2 * k + 1))
        found += not _misleading([("esc", pair(error, regret))]).is_empty()
    # 5 % of cells have a pair that differs in regret: 2 of 40 expected, more than 6 once in 300
    assert found <= 6


def test_the_least_error_is_told_from_the_least_regret_as_rarely_as_is_said():
    told, trials = 0, 60
    for k in range(trials):
        error, regret = RNG(k).normal(5, 1, size=(2, 8, 10, 1))
        told += not _by_cell("esc", pair(error, regret))[0]["tied"]
    assert told <= 8  # 3 of 60 expected at most, more than 8 once in 200


@pytest.mark.parametrize("seeds", [1, 2, 5])
def test_with_few_seeds_nothing_is_told_from_chance(seeds):
    error, regret = planted()
    found = answer(table(error[:, :seeds], regret[:, :seeds], ["esc"] * 3))
    assert found.misleading.is_empty() and found.by_cell["tied"].null_count() == 3
    assert np.isnan(found.repeats["low"][0])
    text = answer_text(found)
    assert "With fewer than 6 seeds no pair that misleads can be told from chance." in text
    assert ("One seed gives no intervals." in text) == (seeds == 1) != ("rough" in text)
    for wrong in ("which seed has", "significantly more than", "No pair misleads", "nan", "- over seeds", " 0 such"):
        assert wrong not in text


def test_one_cell_is_spoken_of_once_and_in_the_singular():
    text = answer_text(answer(table(*(part[:, :, :1] for part in planted()))))
    assert "In a single cell the rank" not in text and "1 cells" not in text and "of 1 cell" in text


def test_where_all_regrets_are_equal_nothing_is_made_of_them():
    error, regret = planted()
    text = answer_text(answer(table(error, np.zeros_like(regret))))
    assert "there is no rank correlation: all have the same mean regret" in text
    for wrong in ("nan", "(- ", " 0 such", "over 0 cells", "not defined in 3"):
        assert wrong not in text


def test_renaming_and_reordering_change_nothing():
    error, regret = planted()
    runs = table(error, regret, ["esc", "esc", "other"])
    new = {"e0": "z", "e1": "b", "e2": "y", "e3": "a"}
    shuffled = runs.with_columns(pl.col("estimator").replace(new)).sample(fraction=1, shuffle=True, seed=3)
    own, other = answer(runs), answer(shuffled)
    for name in ("overall", "by_cell", "means", "cell_means", "repeats", "misleading", "predictors", "in_loop"):
        frame = getattr(own, name)
        named = [
            c for c in frame.columns if frame[c].dtype == pl.String and c not in ("controller", "predictor", "cell")
        ]
        renamed = frame.with_columns(pl.col(named).replace(new)) if named else frame
        order = [c for c in frame.columns if frame[c].dtype == pl.String]
        got, want = (f.sort(order) for f in (getattr(other, name), renamed))
        for column in frame.columns:
            if frame[column].dtype == pl.Float64:
                np.testing.assert_allclose(got[column], want[column], atol=1e-9, err_msg=f"{name}.{column}")
            else:
                assert got[column].to_list() == want[column].to_list()


def test_controllers_are_answered_apart_and_together():
    error, regret = (noisy([1, 2, 3, 4], 6, 4, 0.01, RNG(k)) for k in (0, 1))
    regret[:, :, 2:] = 5 - regret[:, :, 2:]
    found = answer(table(error, regret, ["esc", "esc", "lqr", "lqr"])).overall
    assert dict(found.select("controller", "spearman").iter_rows())["esc"] == pytest.approx(1)
    assert dict(found.select("controller", "spearman").iter_rows())["lqr"] == pytest.approx(-1)
    assert found["controller"].to_list() == [ALL, "esc", "lqr"] and found["cells"].to_list() == [4, 2, 2]


def test_anchors_are_left_out_by_name_and_by_an_error_of_zero():
    error, regret = (noisy([1, 2, 3, 4, 5, 6], 5, 2, 0.1, RNG(k)) for k in (0, 1))
    error[5] = 0.0
    names = {"e3": "truth", "e4": "none"}
    runs = table(error, regret).with_columns(pl.col("estimator").replace(names))
    runs = runs.with_columns(pl.when(pl.col("estimator") == "none").then(None).otherwise(pl.col(ERROR)).alias(ERROR))
    found = answer(runs)
    assert found.left_out == ("e5", "none", "truth")
    assert set(found.means["estimator"]) == {"e0", "e1", "e2"}
    assert set(answer(runs, leave_out=()).means["estimator"]) == {"e0", "e1", "e2", "e5", "truth"}
    text = answer_text(found)
    assert "Left out: `e5`, `none` and `truth`" in text and "inflate" in text


def test_an_estimator_that_broke_off_counts_with_the_largest_error_of_its_cell():
    error, regret = (noisy([1, 2, 3], 5, 2, 0.1, RNG(k)) for k in (0, 1))
    runs = table(error, regret)
    broke = (pl.col("estimator") == "e0") & (pl.col("seed") == 2) & (pl.col("cell") == "c1")
    found = answer(runs.with_columns(pl.when(broke).then(None).otherwise(pl.col(ERROR)).alias(ERROR)))
    error[0, 2, 1] = error[:, :, 1].max()
    want = {f"e{k}": value for k, value in enumerate(error.mean(axis=(1, 2)))}
    assert dict(found.means.select("estimator", "error").iter_rows()) == pytest.approx(want)


def test_an_estimator_that_always_broke_off_is_no_anchor_and_the_worst():
    error, regret = (noisy([1, 2, 3], 5, 2, 0.1, RNG(k)) for k in (0, 1))
    runs = table(error, regret)
    never = pl.when(pl.col("estimator") == "e0").then(None).otherwise(pl.col(ERROR)).alias(ERROR)
    found = answer(runs.with_columns(never))
    assert found.left_out == ()
    assert found.means.sort("error")["estimator"].to_list() == ["e1", "e2", "e0"]


def test_a_better_predictor_is_told_from_the_error_and_counts_its_own_estimators():
    regret = noisy([1, 2, 3, 4, 5], 12, 2, 0.1, RNG(0))
    error = noisy([2, 1, 5, 3, 4], 12, 2, 0.1, RNG(1))
    nees = regret**2
    nees[4] = np.nan  # it gives no covariance
    found = answer(table(error, regret, shadow_vx_rmse_mps=regret**2, shadow_nees=nees)).predictors
    rows = {row["predictor"]: row for row in found.iter_rows(named=True)}
    assert rows["shadow_vx_rmse_mps"]["spearman"] == pytest.approx(1)
    rho = stats.spearmanr([2, 1, 5, 3, 4], [1, 2, 3, 4, 5]).statistic
    assert rows[ERROR]["spearman"] == pytest.approx(rho) and rows[ERROR]["gain"] == 0
    assert rows["shadow_vx_rmse_mps"]["gain"] == pytest.approx(1 - rho) and rows["shadow_vx_rmse_mps"]["gain_low"] > 0
    assert rows["shadow_nees"]["estimators"] == 4
    of_four = stats.spearmanr([2, 1, 5, 3], [1, 2, 3, 4]).statistic
    assert rows["shadow_nees"]["gain"] == pytest.approx(1 - of_four)
    assert np.isnan(rows["shadow_vy_rmse_mps"]["spearman"])  # a column that the table lacks
    text = answer_text(answer(table(error, regret, shadow_nees=nees)))
    assert "`shadow_nees`" in text and "shadow_vy" not in text and "nan" not in text


def test_a_cell_in_which_all_have_the_same_regret_has_no_rank_correlation():
    error, regret = (noisy([1, 2, 3], 6, 2, 0.1, RNG(k)) for k in (0, 1))
    regret[:, :, 0] = 0.0
    found = answer(table(error, regret))
    assert np.isnan(found.by_cell["spearman"][0]) and found.by_cell["same"][0] and found.by_cell["tied"][0]
    assert "not defined in 1 of 2" in answer_text(found)


def test_seeds_that_not_everybody_has_are_left_out():
    error, regret = planted()
    runs = table(error, regret)
    stopped = runs.filter(~((pl.col("seed") == 11) & (pl.col("cell") == "c2") & (pl.col("estimator") == "e3")))
    assert answer(stopped).overall.equals(answer(runs.filter(pl.col("seed") < 11)).overall, null_equal=True)


def test_rows_of_a_part_of_the_estimate_are_no_estimators():
    error, regret = planted()
    runs = table(error, regret).with_columns(part=pl.lit("whole"))
    part = runs.with_columns(pl.col("estimator") + ":yaw", part=pl.lit("yaw"))
    assert answer(pl.concat([runs, part])).overall.equals(answer(runs).overall, null_equal=True)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda runs: runs.drop("regret", ERROR), r"lacks the columns \['regret', 'shadow_sideslip_rmse_deg'\]"),
        (lambda runs: pl.concat([runs, runs]), "two rows"),
        (lambda runs: runs.filter(pl.col("estimator") < "e2"), "three estimators"),
        (lambda runs: runs.clear(), "empty"),
    ],
)
def test_a_table_without_an_answer_is_refused_with_a_sentence(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        answer(change(table(*planted())))


def test_the_text_says_the_numbers_and_keeps_the_loop_s_error_apart():
    found = answer(table(*planted(), ["esc", "esc", "other"]))
    text = answer_text(found)
    row = found.overall.row(0, named=True)
    assert f"is {row['spearman']:.2f} ({row['spearman_low']:.2f} to {row['spearman_high']:.2f} over seeds" in text
    assert "In 3 of 18 pairs in a cell the error misleads" in text
    assert "The largest: in the cell 'c1' `e0` errs" in text
    before, after = text.split("**No explanation**")
    assert IN_LOOP not in before and IN_LOOP in after
    assert "harder to estimate" in after


def test_the_figure_is_drawn_for_one_cell_and_for_many(tmp_path):
    for cells, controllers in ((1, ["esc"]), (6, ["esc"] * 2 + ["lqr"] * 4)):
        error, regret = (noisy([1, 2, 3, 4], 4, cells, 0.5, RNG(k)) for k in (0, 1))
        question_figure(answer(table(np.abs(error), np.abs(regret), controllers)), tmp_path / f"{cells}.png")
        assert (tmp_path / f"{cells}.png").stat().st_size > 20_000
