"""Means of paired runs and their intervals. Whole seeds are drawn anew, the same for all cells and all estimators.

The noise of one seed, and the car that it draws, are shared by all estimators and by all cells. So two runs of one seed
are not two independent facts, and the seed is the unit of every interval here.
"""

import warnings
from collections.abc import Callable
from math import ceil, floor, prod
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]

POTENTIAL = "none"  # the row of the car without stability control: what there is to gain; no estimator, never ranked
CONFIDENCE = 0.95
FEWEST = 6  # seeds; a bootstrap of fewer reaches from the least to the most and covers 50 to 89 %
FEWEST_CELLS = 4  # and seeds drawn with them; with 2 to 3 cells an interval about cells covers 63 to 83 %
RESAMPLES = 5000
BATCH = 500  # resamples held in memory at once
DIGITS = 6  # of a number of wins; what is less is rounding
DRAW = 0  # seed of the resampling: the same table gives the same intervals


class Cube(NamedTuple):
    """One column of the table of runs, paired: every estimator at every seed in every cell."""

    estimators: tuple[str, ...]  # E
    seeds: tuple[int, ...]  # S
    cells: tuple[str, ...]  # C
    values: Array  # (E, S, C); NaN where a run has no such figure

    @property
    def by_seed(self) -> Array:
        """Mean over cells, each counting alike, (E, S)."""
        return np.asarray(self.values.mean(axis=2))


class Interval(NamedTuple):
    """Figures with their 95 % intervals; the ends are NaN where there is no interval."""

    value: Array
    low: Array
    high: Array


# -- the table of runs as arrays --------------------------------------------------------------------------------------


def whole(runs: pl.DataFrame) -> pl.DataFrame:
    """Without the rows whose controller saw only a part of the estimate (attribution)."""
    return runs.filter(pl.col("part").fill_null("whole") == "whole") if "part" in runs.columns else runs


def ranked(runs: pl.DataFrame) -> pl.DataFrame:
    """Runs of what is ranked: whole estimators, not the car without stability control."""
    return whole(runs).filter(pl.col("estimator") != POTENTIAL)


def complete_seeds(runs: pl.DataFrame) -> list[int]:
    """Seeds that every estimator has in each of its cells; a study stopped early has others too."""
    pairs = runs.select("cell", "estimator").n_unique()
    per_seed = runs.group_by("seed").agg(known=pl.struct("cell", "estimator").n_unique())
    return sorted(per_seed.filter(pl.col("known") == pairs)["seed"])


def complete(runs: pl.DataFrame) -> pl.DataFrame:
    """Runs of the complete seeds; all runs if there are none."""
    seeds = complete_seeds(runs)
    return runs.filter(pl.col("seed").is_in(seeds)) if seeds else runs


def cube(runs: pl.DataFrame, column: str = "regret") -> Cube:
    """A column of the complete seeds, paired and sorted; all NaN if the table has no such column."""
    runs = complete(runs)
    axes = [runs[key].unique().sort().to_list() for key in ("estimator", "seed", "cell")]
    values = np.full([len(axis) for axis in axes], np.nan)
    if column in runs.columns:
        keys = zip(axes, ("estimator", "seed", "cell"), strict=True)
        at = tuple(np.searchsorted(axis, runs[key].to_list()) for axis, key in keys)
        values[at] = runs[column].cast(pl.Float64).to_numpy()
    names, seeds, cells = axes
    return Cube(tuple(names), tuple(seeds), tuple(cells), values)


# -- intervals --------------------------------------------------------------------------------------------------------


def seed_interval(values: Array, statistic: Callable[..., Any] = np.mean) -> Interval:
    """A statistic of pooled runs and its interval, by a bootstrap that draws the same seeds for every row.

    BCa (Efron, 1987), percentiles where that is not defined; the level is that of :func:`widened`. Below six seeds
    Student's interval of a mean, and none of another statistic. Where a run in a hundred is far worse than the rest,
    intervals of means cover 77 to 86 %, and what they miss lies above: no method sees a tail that was not drawn.

    Args:
        values: (E, S) or (E, S, C).
        statistic: Of pools (..., n) along ``axis``.

    Returns:
        Figures and ends, (E,). All are NaN where a value is missing, ends also where there are too few seeds. Where
        seeds do not differ the ends are the figure.
    """
    pools = values if values.ndim == 3 else values[:, :, None]
    value = np.asarray(statistic(pools.reshape(len(pools), prod(pools.shape[1:])), axis=-1))
    low, high = np.full((2, len(pools)), np.nan)
    if pools.shape[1] > 1:
        known = np.isfinite(pools).all(axis=(1, 2))
        same = known & (np.ptp(pools, axis=1) == 0).all(axis=1)
        low[same] = high[same] = value[same]
        differ = known & ~same
        if pools.shape[1] < FEWEST:
            if statistic is np.mean:
                low[differ], high[differ] = _student(pools[differ].mean(axis=2))
        elif differ.any():
            low[differ], high[differ] = _bootstrap(pools[differ], statistic)
    return Interval(value, low, high)


def widened(size: int) -> float:
    """The level at which percentiles of a bootstrap of ``size`` values are as wide as an interval of Student's t.

    A resample's variance is too small by (n - 1) / n, and a normal law's tails are too thin. Hesterberg, "What teachers
    should know about the bootstrap", The American Statistician 69 (2015): expanded intervals.
    """
    quantile = stats.t.ppf((1 + CONFIDENCE) / 2, size - 1) * np.sqrt(size / (size - 1))
    return float(1 - 2 * stats.norm.sf(quantile))


def _student(values: Array) -> tuple[Array, Array]:
    """Ends (E,) from (E, S)."""
    low, high = stats.t.interval(
        CONFIDENCE, values.shape[1] - 1, loc=values.mean(axis=1), scale=stats.sem(values, axis=1)
    )
    return low, high


def _bootstrap(pools: Array, statistic: Callable[..., Any]) -> tuple[Array, Array]:
    """Ends (E,) from (E, S, C)."""

    def drawn(seeds: NDArray[np.int64], axis: int) -> Any:
        return statistic(pools[:, seeds].reshape(len(pools), *seeds.shape[:-1], -1), axis=-1)

    seeds = (np.arange(pools.shape[1]),)
    settings: dict[str, Any] = {"vectorized": True, "confidence_level": widened(pools.shape[1])}
    with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # BCa is not defined: percentiles then
        best = stats.bootstrap(seeds, drawn, n_resamples=RESAMPLES, batch=BATCH, rng=DRAW, method="BCa", **settings)
    plain = stats.bootstrap(seeds, drawn, n_resamples=0, bootstrap_result=best, method="percentile", **settings)
    defined = np.isfinite(best.confidence_interval).all(axis=0)
    low, high = (
        np.where(defined, *ends) for ends in zip(best.confidence_interval, plain.confidence_interval, strict=True)
    )
    return low, high


# -- what is asked of a table -----------------------------------------------------------------------------------------


def means(of: Cube) -> Array:
    """Mean over cells, each counting alike, (E,); where single figures are missing, of those known in each cell."""
    known = np.isfinite(of.values)
    count, total = known.sum(axis=1), np.where(known, of.values, 0).sum(axis=1)
    per_cell = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    return np.asarray(per_cell.mean(axis=1))


def mean(of: Cube) -> Interval:
    """:func:`means` with an interval about the seeds; none where figures are missing."""
    return seed_interval(of.by_seed)._replace(value=means(of))


def mean_over_other_cells(of: Cube) -> Interval:
    """The same mean with an interval about seeds and cells: would it hold on other drives of this kind?

    Cells and seeds are both drawn anew (the pigeonhole bootstrap: Owen, Annals of Applied Statistics 1, 2007), and
    percentiles are widened for the smaller of the two numbers. Fewer than four of either give no interval. A study's
    cells are chosen, not drawn at random, so the interval is of cells such as these.
    """
    _, seeds, cells = of.values.shape
    if min(seeds, cells) < FEWEST_CELLS:
        return Interval(means(of), *np.full((2, len(of.values)), np.nan))
    rng = np.random.default_rng(DRAW)
    of_seeds, of_cells = (rng.multinomial(n, np.full(n, 1 / n), RESAMPLES) / n for n in (seeds, cells))
    drawn = np.einsum("bs,esc,bc->eb", of_seeds, of.values, of_cells, optimize=True)
    tail = (1 - widened(min(seeds, cells))) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail], axis=1)
    return Interval(means(of), low, high)


def interquartile_mean(of: Cube) -> Interval:
    """Mean of the middle half of all runs of an estimator, cells and seeds pooled, (E,).

    Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice" (rliable), NeurIPS 2021.
    """
    return seed_interval(of.values, lambda pool, axis: stats.trim_mean(pool, 0.25, axis=axis))


def improvement(of: Cube) -> Interval:
    """Probability that the row's estimator has less regret than the column's on a run of the same seed, (E, E).

    Mean over cells of the share of seeds; ties count half. After Agarwal et al. (2021), who compare every run with
    every other, for theirs are independent; ours are paired by seed, and so is this. Where all seeds have the same
    share the ends are those of as many wins among the seeds (Clopper & Pearson, 1934): a rare loss may not be drawn.
    """
    size = len(of.values)
    first, second = np.triu_indices(size, 1)
    wins = (1 + np.sign(of.values[second] - of.values[first])) / 2
    upper = seed_interval(wins.mean(axis=2))
    upper = upper._replace(low=np.maximum(upper.low, 0), high=np.minimum(upper.high, 1))
    seeds = of.values.shape[1]
    for k in np.flatnonzero(upper.low == upper.high):
        won = round(float(upper.value[k]) * seeds, DIGITS)
        upper.low[k] = stats.binomtest(floor(won), seeds).proportion_ci(CONFIDENCE).low
        upper.high[k] = stats.binomtest(ceil(won), seeds).proportion_ci(CONFIDENCE).high
    value, low, high = (np.full((size, size), end) for end in (0.5, np.nan, np.nan))
    value[first, second], low[first, second], high[first, second] = upper
    value[second, first], low[second, first], high[second, first] = 1 - upper.value, 1 - upper.high, 1 - upper.low
    return Interval(value, low, high)


def precision(runs: pl.DataFrame) -> float:
    """Largest half width, from the mean to the farther end, of the intervals of mean regret of what is ranked.

    To add seeds until it is small gives a fixed-width interval (Chow & Robbins, 1965). It covers less often than it
    says, for it stops more readily where the scatter looks small: about 93 % if begun with 20 seeds, 86 % where rare
    drives end badly, 58 % if begun with 3. NaN for one seed.
    """
    value, low, high = mean(cube(ranked(runs)))
    return float(np.maximum(value - low, high - value).max())
