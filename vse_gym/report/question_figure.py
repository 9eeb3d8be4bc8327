"""The picture of the question: shadow error against regret, of the means and in single cells."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vse_gym.report.question import ALL, Answer

MOST = 3  # misleading pairs that are drawn in a cell
COLUMNS = 4  # of single cells
LINE = 0.052  # between labels, of a panel's height
MARKERS = "osD^vP"
MISLEADS = "crimson"
ERROR_LABEL = "shadow: sideslip RMSE [deg]"
REGRET_LABEL = "regret (0 to 14)"


def question_figure(found: Answer, path: Path) -> None:
    """Draw the answer of a table of runs; needs the extra [report].

    Above, a panel for each controller: means of the estimators over cells and seeds with 95 % intervals of both. Below,
    one for each cell, in which a line joins the pairs that mislead most: its upper end has less error, more regret.

    Raises:
        ModuleNotFoundError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    looks = _looks(found)
    panels = found.overall.filter(pl.col("controller") != ALL)
    cells = found.by_cell
    rows = -(-len(cells) // COLUMNS)
    heights = (max(5.4, 0.25 * len(looks) + 1.2), 3 * rows + 0.6)  # above, room for a label of each estimator
    figure = Figure(figsize=(max(14, 6 * len(panels)), sum(heights)), layout="constrained")
    halves = figure.add_gridspec(2, 1, height_ratios=heights)
    top, bottom = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    top.suptitle("Does a small error make a good drive? Means over cells and seeds, with 95 % intervals over seeds")
    for axes, row in zip(np.ravel(top.subplots(1, len(panels))), panels.iter_rows(named=True), strict=True):
        _means(axes, found, row, looks)
    bottom.suptitle("Single cells; a line joins pairs that mislead: the one named first errs less and has more regret")
    bottom.supxlabel(ERROR_LABEL, fontsize=9)
    bottom.supylabel(REGRET_LABEL, fontsize=9)
    grid = np.ravel(bottom.subplots(rows, min(COLUMNS, len(cells))))
    for axes, row in zip(grid, cells.iter_rows(named=True), strict=False):
        _cell(axes, found, row, looks)
    for axes in grid[len(cells) :]:
        axes.set_axis_off()
    figure.savefig(path, dpi=110)


def _looks(found: Answer) -> dict[str, dict[str, Any]]:
    """A colour and a marker for each estimator, the same in all panels."""
    names = found.means["estimator"].unique().sort().to_list()
    return {name: {"color": f"C{k % 10}", "marker": MARKERS[k // 10 % len(MARKERS)]} for k, name in enumerate(names)}


def _means(axes: Any, found: Answer, row: dict[str, Any], looks: dict[str, dict[str, Any]]) -> None:
    mine = found.means.filter(pl.col("controller") == row["controller"]).sort("regret", "estimator")
    for r in mine.iter_rows(named=True):
        spread = [_reach(r, "error"), _reach(r, "regret")]
        look = looks[r["estimator"]]
        axes.errorbar(r["error"], r["regret"], spread[1], spread[0], lw=1, capsize=2, ms=5, **look)
    _frame(axes, mine["error"].to_numpy())
    axes.set_xlabel(ERROR_LABEL)
    axes.set_ylabel(REGRET_LABEL)
    ends = f"{row['spearman_low']:.2f} to {row['spearman_high']:.2f} over seeds"
    if row["spearman_cells_low"] == row["spearman_cells_low"]:
        ends += f", {row['spearman_cells_low']:.2f} to {row['spearman_cells_high']:.2f} over cells too"
    axes.set_title(f"{row['controller']}: rank correlation {row['spearman']:.2f}\n({ends})", fontsize=10)
    bottom, top = axes.get_ylim()
    heights = spread_out((mine["regret"].to_numpy() - bottom) / (top - bottom))
    for height, r in zip(heights, mine.iter_rows(named=True), strict=True):
        axes.annotate(
            r["estimator"],
            (r["error"], r["regret"]),
            (1.03, height),
            textcoords="axes fraction",
            va="center",
            fontsize=8,
            color=looks[r["estimator"]]["color"],
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": looks[r["estimator"]]["color"], "alpha": 0.5},
        )


def _reach(row: dict[str, Any], what: str) -> list[list[float]]:
    """From the value to the ends of its interval, as error bars want it; nothing where there is no interval."""
    ends = np.array([row[what] - row[f"{what}_low"], row[f"{what}_high"] - row[what]])
    return [[max(0.0, float(end))] for end in np.nan_to_num(ends)]


def spread_out(heights: np.ndarray) -> np.ndarray:
    """Ascending heights of labels in [0, 1], moved as little as keeps them from overlapping.

    Least squares under an order with gaps, by pooling adjacent violators (Barlow et al., 1972).
    """
    line = min(LINE, 1 / len(heights))
    steps = line * np.arange(len(heights))
    pooled: list[list[float]] = []
    for wish in heights - steps:
        pooled.append([float(wish)])
        while len(pooled) > 1 and np.mean(pooled[-2]) > np.mean(pooled[-1]):
            last = pooled.pop()
            pooled[-1] += last
    blocks = np.concatenate([np.full(len(block), np.mean(block)) for block in pooled])
    return np.asarray(np.clip(blocks, 0, 1 - steps[-1]) + steps)


def _cell(axes: Any, found: Answer, row: dict[str, Any], looks: dict[str, dict[str, Any]]) -> None:
    points = found.cell_means.filter(pl.col("cell") == row["cell"])
    at = {r["estimator"]: (r["error"], r["regret"]) for r in points.iter_rows(named=True)}
    pairs = found.misleading.filter(pl.col("cell") == row["cell"])
    for less, more in pairs.select("less_error", "more_error").head(MOST).iter_rows():
        axes.plot(*zip(at[less], at[more], strict=True), "-", color=MISLEADS, lw=1, alpha=0.6, zorder=1)
    for name, point in at.items():
        axes.plot(*point, ms=5, ls="", **looks[name])
    _frame(axes, points["error"].to_numpy())
    rho = "not defined" if row["spearman"] != row["spearman"] else f"{row['spearman']:.2f}"
    lines = [f"{row['cell']} ({row['controller']})", f"rank correlation {rho}"]
    if len(pairs):
        less, more = pairs.select("less_error", "more_error").row(0)
        lines[1] += f", pairs that mislead: {len(pairs)}"
        lines.append(f"most: {less}, {more}")
    axes.set_title("\n".join(lines), fontsize=8)
    axes.tick_params(labelsize=7)


def _frame(axes: Any, errors: np.ndarray) -> None:
    """Errors are compared by their ratio: a logarithmic axis with plain numbers, where there is no error of zero."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    axes.grid(alpha=0.3)
    axes.set_ylim(-0.4, max(1.0, axes.get_ylim()[1]))
    if errors.min() > 0:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if errors.max() > 5 * errors.min() else range(1, 10)))
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_minor_locator(NullLocator())
