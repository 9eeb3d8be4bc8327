"""How far does the error of an estimate predict what it costs the drive, and where does it mislead?

The error is that of the shadow: the estimator listens to the drive that was made with true states, so that all
estimators hear the same. The error measured in the loop correlates better, partly because a car that slides is harder
to estimate: it is an effect of a bad drive as much as its cause. It is kept apart and offered as no explanation.
"""

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vse_gym.report.rank_correlation import Indices, kendall, resampled, spearman
from vse_gym.report.ranks import significance
from vse_gym.report.statistics import CONFIDENCE, FEWEST, POTENTIAL, Array, Cube, complete, cube, seed_interval, whole

ERROR = "shadow_sideslip_rmse_deg"
IN_LOOP = "loop_sideslip_rmse_deg"
PREDICTORS = (
    ERROR,
    "shadow_sideslip_max_abs_deg",
    "shadow_vx_rmse_mps",
    "shadow_vx_max_abs_mps",
    "shadow_vy_rmse_mps",
    "shadow_vy_max_abs_mps",
    "shadow_yaw_rate_rmse_degps",
    "shadow_yaw_rate_max_abs_degps",
    "shadow_nees",
)
ANCHORS = (POTENTIAL, "truth", "truth_velocity")
ALL = "all"
DIGITS = 6  # of a mean; what differs by less differs by rounding, which is no order


class Answer(NamedTuple):
    """The numbers, one frame each; ``controller`` is ``all`` where cells of several controllers are taken together."""

    left_out: tuple[str, ...]  # anchors: they see the truth, or nothing
    overall: pl.DataFrame  # per controller: rank correlation of the means, intervals over seeds, and over cells too
    means: pl.DataFrame  # per controller and estimator: mean error and regret, intervals over seeds
    by_cell: (
        pl.DataFrame
    )  # per cell: rank correlation; the least error's regret beside the least; tied: null if unknown
    cell_means: pl.DataFrame  # per cell and estimator: mean error and regret
    repeats: pl.DataFrame  # per controller: does a seed's error predict that seed's regret, one estimator, one cell
    misleading: pl.DataFrame  # pairs in a cell: less error, and significantly more regret among all pairs of the cell
    predictors: pl.DataFrame  # per controller and shadow metric: rank correlation, and how much above the sideslip's
    in_loop: pl.DataFrame  # the same for the error in the loop: no explanation


class Pair(NamedTuple):
    """Errors and regrets, paired."""

    error: Cube
    regret: Cube


def answer(runs: pl.DataFrame, leave_out: Collection[str] | None = None) -> Answer:
    """How far the shadow's error of sideslip predicts regret, by rank correlation over estimators.

    Intervals are by bootstrap over seeds, drawn alike for all cells and estimators; they say nothing about estimators
    that were not driven. An estimator that broke off counts with the largest error that anybody had in that cell.

    Args:
        runs: One row per cell, seed and estimator; incomplete seeds are left out.
        leave_out: Rows that are no estimators. None: the car without control, and every row that sees the truth,
            known by its name or by an error of sideslip that is zero in every run; they would inflate the correlation.

    Raises:
        ValueError: If a column is missing, a run is there twice or none at all, or fewer than three estimators remain.
    """
    missing = {"cell", "seed", "estimator", "controller", "regret", ERROR} - set(runs.columns)
    if missing:
        raise ValueError(f"the table of runs lacks the columns {sorted(missing)}")
    runs = whole(runs)
    if runs.is_empty():
        raise ValueError("the table of runs is empty")
    if runs.select("cell", "seed", "estimator").is_duplicated().any():
        raise ValueError("a cell, seed and estimator has two rows: hand in the runs of one study")
    left_out = {POTENTIAL} | (anchors(runs) if leave_out is None else set(leave_out))
    left_out &= set(runs["estimator"])
    scopes = list(_scopes(_with_worst(complete(runs.filter(~pl.col("estimator").is_in(list(left_out)))))))
    pairs = [(name, Pair(*_known(part, ERROR, "regret"))) for name, part in scopes]
    for name, pair in pairs:
        if len(names := pair.error.estimators) < 3:
            why = f"under {name!r} {sorted(names)} have a shadow error in every run and do not see the truth"
            raise ValueError(f"a rank correlation needs three estimators; {why}")
    cells = [(name, pair) for name, pair in pairs if name != ALL]
    return Answer(
        tuple(sorted(left_out)),
        pl.DataFrame([_overall(name, pair) for name, pair in pairs]),
        pl.DataFrame([row for name, pair in pairs for row in _means(name, pair)]),
        pl.DataFrame([row for name, pair in cells for row in _by_cell(name, pair)]),
        pl.DataFrame([row for name, pair in cells for row in _cell_means(name, pair)]),
        pl.DataFrame([_repeats(name, pair) for name, pair in pairs]),
        _misleading(cells),
        pl.DataFrame([_predictor(name, part, column) for name, part in scopes for column in PREDICTORS]),
        pl.DataFrame([_predictor(name, part, IN_LOOP) for name, part in scopes]),
    )


def anchors(runs: pl.DataFrame) -> set[str]:
    """Rows that see the truth, or nothing: by their names, and by an error of sideslip that is zero in every run."""
    exact = (
        runs.group_by("estimator").agg(exact=(pl.col(ERROR) == 0).fill_null(False).all()).filter("exact")["estimator"]
    )
    return set(ANCHORS) | set(exact)


def _with_worst(runs: pl.DataFrame) -> pl.DataFrame:
    """Nothing (null) where an estimator broke off becomes the cell's largest; NaN, a figure that it lacks, stays."""
    columns = [c for c in (*PREDICTORS, IN_LOOP) if c in runs.columns]
    worst = [pl.col(c).fill_null(pl.col(c).fill_nan(None).max().over("cell")) for c in columns]
    return runs.with_columns(worst)


def _scopes(runs: pl.DataFrame) -> Iterator[tuple[str, pl.DataFrame]]:
    parts = runs.partition_by("controller", as_dict=True)
    if len(parts) > 1:
        yield ALL, runs
    for (name,) in sorted(parts):
        yield str(name), parts[(name,)]


def _known(runs: pl.DataFrame, *columns: str) -> tuple[Cube, ...]:
    """Columns of the estimators that have all of them in every run."""
    cubes = [cube(runs, column) for column in columns]
    known = np.isfinite(sum(c.values for c in cubes)).all(axis=(1, 2))
    names = tuple(np.array(cubes[0].estimators)[known].tolist())
    return tuple(c._replace(estimators=names, values=c.values[known]) for c in cubes)


def _drawn(values: Array, seeds: Indices, cells: Indices) -> Array:
    """Means over drawn seeds (B, S) and cells (B, C) of values (E, S, C): (B, E)."""
    return np.asarray(np.round(values[:, seeds[:, :, None], cells[:, None, :]].mean(axis=(-2, -1)).T, DIGITS))


def _overall(name: str, pair: Pair) -> dict[str, Any]:
    estimators, seeds, cells = pair.error.values.shape

    def both(seeds: Indices, cells: Indices) -> Array:
        x, y = (_drawn(of.values, seeds, cells) for of in pair)
        return np.stack([spearman(x, y), kendall(x, y)], axis=-1)

    every = np.arange(cells)[None]
    over_seeds, over_cells = resampled(lambda drawn: both(drawn, every), seeds), resampled(both, seeds, cells)
    row: dict[str, Any] = {"controller": name, "estimators": estimators, "cells": cells, "seeds": seeds}
    for k, coefficient in enumerate(("spearman", "kendall")):
        row[coefficient] = over_seeds.value[k]
        row |= {f"{coefficient}_low": over_seeds.low[k], f"{coefficient}_high": over_seeds.high[k]}
        row |= {f"{coefficient}_cells_low": over_cells.low[k], f"{coefficient}_cells_high": over_cells.high[k]}
    return row


def _means(name: str, pair: Pair) -> list[dict[str, Any]]:
    ends = [seed_interval(of.by_seed) for of in pair]
    rows = []
    for k, estimator in enumerate(pair.error.estimators):
        row: dict[str, Any] = {"controller": name, "estimator": estimator}
        for what, interval in zip(("error", "regret"), ends, strict=True):
            row |= {what: interval.value[k], f"{what}_low": interval.low[k], f"{what}_high": interval.high[k]}
        rows.append(row)
    return rows


def _by_cell(name: str, pair: Pair) -> list[dict[str, Any]]:
    error, regret = (np.round(of.values.mean(axis=1), DIGITS).T for of in pair)
    rho, tau = spearman(error, regret), kendall(error, regret)
    of_error, of_regret = (np.lexsort(keys, axis=-1)[:, 0] for keys in ((regret, error), (error, regret)))
    at = np.arange(len(error))
    apart = _apart(pair.regret)[at, of_error, of_regret]
    names, told = pair.error.estimators, len(pair.error.seeds) >= FEWEST
    return [
        {
            "controller": name,
            "cell": cell,
            "spearman": rho[k],
            "kendall": tau[k],
            "least_error": names[of_error[k]],
            "its_regret": regret[k, of_error[k]],
            "least_regret_of": names[of_regret[k]],
            "least_regret": regret[k, of_regret[k]],
            "same": bool(regret[k, of_error[k]] == regret[k, of_regret[k]]),
            "tied": not apart[k] if told else None,
        }
        for k, cell in enumerate(pair.error.cells)
    ]


def _apart(of: Cube) -> NDArray[np.bool_]:
    """Whether two estimators differ in a cell by more than chance, all pairs of the cell together, (C, E, E)."""
    cells = np.moveaxis(of.values, 2, 0)
    return np.array([significance(np.round(values, DIGITS)) <= 1 - CONFIDENCE for values in cells])


def _cell_means(name: str, pair: Pair) -> list[dict[str, Any]]:
    error, regret = (of.values.mean(axis=1) for of in pair)
    return [
        {"controller": name, "cell": cell, "estimator": estimator, "error": error[e, c], "regret": regret[e, c]}
        for c, cell in enumerate(pair.error.cells)
        for e, estimator in enumerate(pair.error.estimators)
    ]


def _repeats(name: str, pair: Pair) -> dict[str, Any]:
    error, regret = (np.round(of.values, DIGITS) for of in pair)

    def mean(seeds: Indices) -> Array:
        rho = spearman(*(np.moveaxis(v[:, seeds], (1, 2), (0, 3)) for v in (error, regret)))
        known = np.isfinite(rho)
        total, count = np.where(known, rho, 0).sum(axis=(1, 2)), known.sum(axis=(1, 2))
        return np.asarray(total / np.where(count > 0, count, np.nan))[:, None]

    defined = int(np.isfinite(spearman(*(v.swapaxes(1, 2) for v in (error, regret)))).sum())
    interval = resampled(mean, error.shape[1])
    told = error.shape[1] >= FEWEST
    ends = {"low": interval.low[0] if told else np.nan, "high": interval.high[0] if told else np.nan}
    return {"controller": name, "rank_correlation": interval.value[0], **ends, "pairs": defined}


MISLEADING = {
    "controller": pl.String,
    "cell": pl.String,
    "less_error": pl.String,
    "more_error": pl.String,
    **{f"{what}{end}": pl.Float64 for what in ("error", "regret") for end in ("", "_low", "_high")},
}


def _misleading(cells: list[tuple[str, Pair]]) -> pl.DataFrame:
    """Differences of A to B in a cell, the largest regret first.

    A has less error, with an interval clear of 0, and more regret, significantly among all pairs of the cell.
    """
    rows = []
    for name, pair in cells:
        d_error, d_regret = (np.round(of.values[:, None] - of.values[None], DIGITS) for of in pair)  # (E, E, S, C)
        apart = np.moveaxis(_apart(pair.regret), 0, 2)
        found = np.argwhere(apart & (d_error.mean(axis=2) < 0) & (d_regret.mean(axis=2) > 0))
        if not len(found):
            continue
        a, b, c = found.T
        less, more = (seed_interval(d[a, b, :, c]) for d in (d_error, d_regret))
        for k in np.flatnonzero(less.high < 0):
            who = (pair.error.cells[c[k]], *(pair.error.estimators[end[k]] for end in (a, b)))
            rows.append((name, *who, *(end[k] for end in less), *(end[k] for end in more)))
    frame = pl.DataFrame(rows, schema=MISLEADING, orient="row")
    return frame.sort("regret", "cell", "less_error", "more_error", descending=[True, False, False, False])


def _predictor(name: str, runs: pl.DataFrame, column: str) -> dict[str, Any]:
    """Rank correlation of a metric's means with regret's, beside that of sideslip's RMSE over the same estimators."""
    own, usual, regret = _known(runs, column, ERROR, "regret")
    estimators, seeds, cells = own.values.shape
    every = np.arange(cells)[None]

    def beside(drawn: Indices) -> Array:
        x, usual_x, y = (_drawn(of.values, drawn, every) for of in (own, usual, regret))
        rho = spearman(x, y)
        return np.stack([rho, rho - spearman(usual_x, y)], axis=-1)

    row: dict[str, Any] = {"controller": name, "predictor": column, "estimators": estimators}
    known = estimators > 2
    ends = resampled(beside, seeds, largest=np.array([1, 2])) if known else [np.full(2, np.nan)] * 3
    for k, what in enumerate(("spearman", "gain")):
        row |= {what: ends[0][k], f"{what}_low": ends[1][k], f"{what}_high": ends[2][k]}
    all_seeds, each = np.arange(seeds)[None], np.arange(cells)[:, None]
    rho = spearman(*(_drawn(of.values, all_seeds, each) for of in (own, regret))) if known else np.empty(0)
    single = rho[np.isfinite(rho)]
    return row | {"cell_median": float(np.median(single)) if single.size else float("nan")}
