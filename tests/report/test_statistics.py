"""Intervals cover as often as they say, and figures are what a hand computes."""

import math

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vse_gym.report.statistics import (
    Cube,
    complete_seeds,
    cube,
    improvement,
    interquartile_mean,
    mean,
    mean_over_other_cells,
    precision,
    seed_interval,
    widened,
)

TRIALS = 400
SCATTER = 3 * math.sqrt(0.05 * 0.95 / TRIALS)  # three standard deviations of a share of 5 %


def of(values):
    """A cube whose rows are trials or estimators."""
    size, seeds, cells = values.shape
    names = (tuple(f"{kind}{k:03d}" for k in range(n)) for kind, n in (("e", size), ("c", cells)))
    estimators, named = names
    return Cube(estimators, tuple(range(seeds)), named, values)


def clipped_mean(centre, spread):
    """Of max(0, a normal variable)."""
    return centre * stats.norm.cdf(centre / spread) + spread * stats.norm.pdf(centre / spread)


def skewed(rng, shape, centre):
    """Like regret: never below 0, half of it 0 in easy cells, and a seed is bad in all cells at once."""
    cells = shape[-1]
    hardness = np.linspace(0.3, 2.0, cells)
    shared, own = rng.normal(0, 1.0, (*shape[:-1], 1)), rng.normal(0, 1.5, shape)
    return np.maximum(0, hardness * (centre + shared + own)), float(
        clipped_mean(centre, math.hypot(1.0, 1.5)) * hardness.mean()
    )


def share_inside(interval, truth):
    return np.mean((interval.low <= truth) & (truth <= interval.high))


@pytest.mark.parametrize(("seeds", "expected"), [(6, 0.92), (10, 0.935), (20, 0.945)])
def test_the_interval_of_the_mean_covers_a_skewed_clipped_law_nearly_as_often_as_it_says(seeds, expected):
    # expected: measured with 3000 trials; BCa that is not widened covers 0.855, 0.89 and 0.93
    values, truth = skewed(np.random.default_rng(1), (TRIALS, seeds, 8), centre=0.3)
    assert share_inside(seed_interval(values.mean(axis=2)), truth) == pytest.approx(expected, abs=SCATTER)


@pytest.mark.parametrize("seeds", [2, 3, 5])
def test_with_few_seeds_the_interval_of_the_mean_is_students_and_covers(seeds):
    values = np.random.default_rng(10).normal(0, 1, (TRIALS, seeds))
    found = seed_interval(values)
    assert share_inside(found, 0.0) == pytest.approx(0.95, abs=SCATTER)
    oracle = stats.ttest_1samp(values[0], 0).confidence_interval(0.95)
    assert (found.low[0], found.high[0]) == pytest.approx(tuple(oracle))


def test_with_few_seeds_other_statistics_than_a_mean_have_no_interval():
    values = np.random.default_rng(11).normal(0, 1, (3, 6, 4))
    assert np.isnan(interquartile_mean(of(values[:, :5])).low).all()
    assert np.isfinite(interquartile_mean(of(values)).low).all()


def test_the_interval_of_paired_differences_covers_as_often_as_it_says():
    rng = np.random.default_rng(2)
    shared, first, second = (rng.normal(0, spread, (TRIALS, 20, 8)) for spread in (1.0, 0.5, 1.5))
    differences = np.maximum(0, shared + first + 0.5) - np.maximum(0, shared + second)
    truth = clipped_mean(0.5, math.hypot(1.0, 0.5)) - clipped_mean(0.0, math.hypot(1.0, 1.5))
    assert share_inside(mean(of(differences)), truth) == pytest.approx(0.945, abs=SCATTER)


def test_over_other_cells_only_the_wider_interval_covers():
    rng = np.random.default_rng(3)
    values = (
        rng.normal(0, 1, (TRIALS, 1, 10)) + rng.normal(0, 0.5, (TRIALS, 20, 1)) + rng.normal(0, 1, (TRIALS, 20, 10))
    )
    # the pigeonhole bootstrap counts the noise of single runs more than once: it covers a little more than 95 %
    assert share_inside(mean_over_other_cells(of(values)), 0.0) == pytest.approx(0.96, abs=SCATTER)
    assert share_inside(seed_interval(values.mean(axis=2)), 0.0) < 0.7


def test_intervals_are_those_of_scipy_for_each_row_by_itself():
    values, _ = skewed(np.random.default_rng(4), (5, 12, 3), centre=0.3)
    interval = seed_interval(values)
    for row, low, high in zip(values.mean(axis=2), interval.low, interval.high, strict=True):
        level = widened(12)
        alone = stats.bootstrap((row,), np.mean, n_resamples=5000, confidence_level=level, rng=1).confidence_interval
        # the scatter of a 0.8 % quantile of 5000 resamples is 6 % of a standard error; both have it
        assert (low, high) == pytest.approx((alone.low, alone.high), abs=0.3 * row.std() / math.sqrt(12))


def test_the_level_is_that_at_which_a_normal_bootstrap_is_as_wide_as_student_s():
    for size in (4, 20):
        spread = math.sqrt((size - 1) / size)  # of a resample's mean, in units of the standard error
        assert stats.norm.ppf((1 + widened(size)) / 2) * spread == pytest.approx(stats.t.ppf(0.975, size - 1))


def test_values_that_do_not_differ_have_an_interval_without_width_and_no_warning():
    values = np.zeros((3, 8, 2))
    values[1] += 14
    values[2, 0, 0] = 5  # one bad run in sixteen
    value, low, high = mean(of(values))
    assert (low[:2] == value[:2]).all() and (high[:2] == value[:2]).all()
    assert low[2] >= 0 and high[2] > value[2]
    trimmed = interquartile_mean(of(values))
    assert trimmed.value.tolist() == [0, 14, 0] and np.isfinite(trimmed.low).all()


@pytest.mark.parametrize(("seeds", "cells", "known"), [(8, 3, False), (3, 8, False), (4, 4, True)])
def test_fewer_than_four_cells_say_nothing_about_others(seeds, cells, known):
    values = np.random.default_rng(12).normal(0, 1, (2, seeds, cells))
    assert (np.isfinite(mean_over_other_cells(of(values)).low) == known).all()


def test_one_seed_or_one_cell_gives_no_interval():
    values = np.arange(6.0).reshape(2, 1, 3)
    for interval in (mean(of(values)), mean_over_other_cells(of(values)), interquartile_mean(of(values))):
        assert np.isfinite(interval.value).all() and np.isnan(interval.low).all() and np.isnan(interval.high).all()
    assert np.isnan(mean_over_other_cells(of(values.reshape(2, 3, 1))).low).all()


def test_the_interquartile_mean_is_that_of_the_middle_half_of_all_runs():
    values = np.array([[8.0, 1, 2, 100], [3, 4, 0, 7]])[None]  # two seeds, four cells: 0 1 2 3 4 7 8 100
    assert interquartile_mean(of(values)).value.tolist() == [(2 + 3 + 4 + 7) / 4]


def test_the_probability_of_improvement_counts_wins_and_half_the_ties_by_cell():
    first = np.array([[0.0, 1.0], [2.0, 1.0], [0.0, 3.0]])  # three seeds, two cells
    second = np.array([[1.0, 1.0], [1.0, 2.0], [1.0, 1.0]])
    share = improvement(of(np.stack([first, second]))).value
    assert share[0, 1] == pytest.approx((2 / 3 + 1.5 / 3) / 2)  # wins: 2 of 3; 1 and a tie of 3
    assert share[1, 0] == pytest.approx(1 - share[0, 1]) and share[0, 0] == 0.5


def test_without_pairing_the_probability_of_improvement_is_mann_and_whitney_s():
    first, second = np.random.default_rng(5).normal([0, 0.7], 1, (4000, 2)).T
    u = stats.mannwhitneyu(second, first).statistic / 4000**2
    # three standard deviations of a share among 4000 pairs
    assert improvement(of(np.stack([first, second])[:, :, None])).value[0, 1] == pytest.approx(u, abs=0.024)


def test_the_interval_of_improvement_mirrors_and_covers():
    rng, inside = np.random.default_rng(6), 0
    truth = stats.norm.cdf(0.5 / math.hypot(1, 1))
    values = np.moveaxis(rng.normal(0, 1, (TRIALS, 20, 4, 2)) + [0, 0.5], 3, 1)
    for trial in values[:100]:
        _, low, high = improvement(of(trial))
        inside += low[0, 1] <= truth <= high[0, 1]
        assert (low[1, 0], high[1, 0]) == pytest.approx((1 - high[0, 1], 1 - low[0, 1]))
    assert inside / 100 == pytest.approx(0.945, abs=2 * SCATTER)  # a quarter of the trials scatters twice as much


def test_a_share_of_wins_near_one_is_covered_though_no_loss_was_drawn():
    rng, inside, truth = np.random.default_rng(13), 0, 0.98
    for _ in range(200):
        wins = rng.random((10, 1)) < truth
        _, low, high = improvement(of(np.stack([np.zeros((10, 1)), np.where(wins, 1.0, -1.0)])))
        inside += low[0, 1] <= truth <= high[0, 1]
    assert inside / 200 >= 0.95 - 1.5 * SCATTER  # half of the trials


def test_where_every_seed_is_won_the_ends_are_those_of_clopper_and_pearson():
    values = np.zeros((3, 10, 2))
    values[1] += 1
    value, low, high = improvement(of(values))
    assert value[0, 1] == high[0, 1] == 1 and low[0, 1] == pytest.approx(0.025**0.1)
    assert low[1, 0] == 0 and high[1, 0] == pytest.approx(1 - 0.025**0.1)
    assert low[0, 2] < 0.5 < high[0, 2]  # always tied
    few = improvement(of(np.random.default_rng(14).normal(0, 1, (2, 2, 1)) + [[[0]], [[0.5]]]))
    assert np.nanmin(few.low) >= 0 and np.nanmax(few.high) <= 1


def test_the_shared_noise_of_a_seed_cancels_in_differences(table):
    rng = np.random.default_rng(7)
    values = rng.normal(10, 3, (1, 20, 1)) + rng.normal(0, 0.1, (2, 20, 4))
    alone, paired = mean(of(values)), mean(of(values[:1] - values[1:]))
    assert (paired.high - paired.low)[0] < 0.1 * (alone.high - alone.low)[0]


def test_a_cube_is_paired_whatever_the_order_of_the_rows(table):
    regret = np.arange(24.0).reshape(2, 3, 4)
    found = cube(table(regret).sample(fraction=1, shuffle=True, seed=1))
    np.testing.assert_array_equal(found.values, regret)
    assert (found.estimators, found.seeds, found.cells) == (("e0", "e1"), (0, 1, 2), ("c0", "c1", "c2", "c3"))
    assert np.isnan(cube(table(regret), "no such column").values).all()


def test_of_a_study_stopped_early_the_seeds_that_every_cell_has_count(table):
    runs = table(np.arange(24.0).reshape(2, 3, 4))
    ragged = runs.filter((pl.col("seed") < 2) | (pl.col("cell") != "c3"))
    assert complete_seeds(ragged) == [0, 1]
    np.testing.assert_array_equal(cube(ragged).values, cube(runs.filter(pl.col("seed") < 2)).values)


def test_without_a_complete_seed_there_is_a_mean_but_no_interval(table):
    runs = table(np.arange(8.0).reshape(2, 2, 2)).filter((pl.col("seed") == 0) == (pl.col("cell") == "c0"))
    value, low, high = mean(cube(runs))
    assert value.tolist() == [(0 + 3) / 2, (4 + 7) / 2] and np.isnan([low, high]).all()


def test_precision_is_the_widest_half_and_falls_with_the_root_of_the_seeds(table):
    values, _ = skewed(np.random.default_rng(8), (4, 400, 5), centre=0.3)
    value, low, high = mean(of(values))
    assert precision(table(values)) == pytest.approx(max((value - low).max(), (high - value).max()))
    # a quarter of the seeds; a spread estimated from 100 seeds is right to 7 %, and the widest of four is more so
    assert precision(table(values[:, :100])) == pytest.approx(2 * precision(table(values)), rel=0.25)
    assert math.isnan(precision(table(values[:, :1])))


def test_precision_is_about_what_is_ranked(table):
    regret = np.zeros((4, 10, 1))
    regret[2:] = np.random.default_rng(9).normal(5, 3, (2, 10, 1))
    part = pl.when(pl.col("estimator") == "a: yaw").then(pl.lit("yaw")).otherwise(pl.lit("whole"))
    assert precision(table(regret, ["truth", "a", "none", "a: yaw"], part=part)) == 0
