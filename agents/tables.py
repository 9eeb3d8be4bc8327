"""What a table of drives under several controllers says: figures of the drive, paired differences, and the matrix."""

from typing import NamedTuple

import numpy as np
import polars as pl

from vse_gym.report.statistics import Interval, seed_interval
from vse_gym.report.text import Sheet, number

MOST = 30.0  # the largest sideslip that counts, and that of a drive that ended early [deg]


class Figure(NamedTuple):
    """A column of the tables."""

    name: str
    of: pl.Expr
    spec: str


ENDED = pl.col("loop_ended") != ""
FIGURES = (
    Figure("slide deg", pl.when(ENDED).then(MOST).otherwise(pl.col("loop_peak_sideslip_deg").clip(0, MOST)), ".2f"),
    Figure("yaw error deg/s", pl.col("loop_yaw_error_degps"), ".2f"),
    Figure("ended early %", 100.0 * ENDED.cast(pl.Float64), ".1f"),
    Figure("brakes kJ", pl.col("loop_brake_energy_kJ"), ".0f"),
    Figure("passed %", 100.0 * pl.col("loop_passed").cast(pl.Float64), ".0f"),
    Figure("regret", pl.col("regret"), ".2f"),
)
SLIDE, REGRET = FIGURES[0], FIGURES[-1]
LEGEND = (
    f"slide: largest sideslip of a drive, at most {MOST:.0f} deg, and that if it ended early;\n"
    "yaw error: mean, to what the driver wants and the road bears; brakes: heat, the\n"
    "driver's own too; passed: the manoeuvre's verdict; regret: against the same controller\n"
    "with true states, - where those drives end early. Means over cells, seeds and\n"
    "estimators; 95 % intervals draw the seeds anew."
)


def cube(runs: pl.DataFrame, figure: Figure, estimators: list[str] | None = None) -> tuple[list[str], np.ndarray]:
    """Controllers, and a figure of theirs, (controllers, seeds, cells), mean over the estimators; NaN where unknown."""
    some = runs if estimators is None else runs.filter(pl.col("estimator").is_in(estimators))
    axes = [some[key].unique().sort().to_list() for key in ("controller", "seed", "cell")]
    means = some.group_by("controller", "seed", "cell").agg(value=figure.of.mean())
    values = np.full([len(axis) for axis in axes], np.nan)
    for controller, seed, cell, value in means.iter_rows():
        at = tuple(axis.index(key) for axis, key in zip(axes, (controller, seed, cell), strict=True))
        values[at] = np.nan if value is None else value
    return axes[0], values


def differences(runs: pl.DataFrame, figure: Figure, reference: str) -> tuple[list[str], Interval]:
    """Each controller's paired difference to a reference, with intervals over the seeds."""
    names, values = cube(runs, figure)
    by_seed = np.nanmean(values, axis=2) if np.isnan(values).any() else values.mean(axis=2)
    return names, seed_interval(by_seed - by_seed[names.index(reference)])


def summary(runs: pl.DataFrame, order: list[str]) -> Sheet:
    """All figures of every controller, with intervals."""
    columns = []
    for figure in FIGURES:
        names, values = cube(runs, figure)
        columns.append(seed_interval(values.mean(axis=2)))
    rows = []
    for name in order:
        k = names.index(name)
        rows.append([name, *(_told(of, k, figure.spec) for figure, of in zip(FIGURES, columns, strict=True))])
    return Sheet(["controller", *(figure.name for figure in FIGURES)], rows)


def against(runs: pl.DataFrame, order: list[str], references: list[str]) -> Sheet:
    """Paired differences to each of the references."""
    heads, columns = ["controller"], []
    for reference in references:
        for figure in FIGURES[:-1]:
            heads.append(f"{figure.name} less {reference}'s")
            columns.append((figure, *differences(runs, figure, reference)))
    rows = [
        [name, *(_told(of, names.index(name), "+" + figure.spec) for figure, names, of in columns)] for name in order
    ]
    return Sheet(heads, rows)


def matrix(runs: pl.DataFrame, order: list[str], figure: Figure = SLIDE) -> Sheet:
    """Who controls (rows) by which estimator (columns)."""
    estimators = runs["estimator"].unique().sort().to_list()
    rows: dict[str, list[str]] = {name: [name] for name in order}
    for estimator in estimators:
        names, values = cube(runs, figure, [estimator])
        for name in order:
            rows[name].append(number(float(values[names.index(name)].mean()), figure.spec))
    return Sheet(["controller", *estimators], list(rows.values()))


def _told(of: Interval, k: int, spec: str) -> str:
    value, low, high = (float(end[k]) for end in of)
    ends = "" if low != low else f" [{number(low, spec)}, {number(high, spec)}]"
    return number(value, spec) + ends
