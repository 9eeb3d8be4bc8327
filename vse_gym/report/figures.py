"""Pictures of the table of runs; all need the extra [report]."""

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vse_gym.report import statistics
from vse_gym.report.statistics import POTENTIAL, complete, cube, ranked, whole
from vse_gym.report.tables import order

WIDE = 5  # cells in a row


def regret(runs: pl.DataFrame, path: Path) -> None:
    """Every run a dot, by cell and estimator, with the mean.

    Raises:
        ModuleNotFoundError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    runs = complete(whole(runs))
    names = [name for name in order(runs) if name != "truth"]
    regret = cube(runs)
    rows = ceil(len(regret.cells) / WIDE)
    columns = ceil(len(regret.cells) / rows)
    size = (1.9 * columns + 2.0, rows * (0.19 * len(names) + 0.8) + 0.5)
    figure = Figure(figsize=size, layout="constrained")
    frames = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes in frames[len(regret.cells) :]:
        axes.set_visible(False)
    for k, (cell, axes) in enumerate(zip(regret.cells, frames, strict=False)):
        for at, name in enumerate(names):
            values = regret.values[regret.estimators.index(name), :, k]
            colour = "0.5" if name == POTENTIAL else "C0"
            axes.plot(values, np.full(values.size, at), ".", color=colour, alpha=0.55, markersize=5, markeredgewidth=0)
            axes.plot(values.mean(), at, "|", color="k" if name != POTENTIAL else "0.4", markersize=9, mew=1.3)
        axes.set_title(cell, fontsize=8)
        axes.set_xlim(-0.4, 14.4)
        axes.set_xticks([0, 5, 10, 14])
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.grid(axis="both", alpha=0.25, linewidth=0.5)
        axes.tick_params(labelsize=8, length=2)
    figure.supxlabel("regret against the drive with true states, 0 to 14; a dot is a seed, a bar the mean", fontsize=9)
    figure.savefig(path, dpi=130)


def places(summarised: pl.DataFrame, path: Path) -> None:
    """Mean regret with its intervals; bands are the tied groups, numbers the intervals of the rank.

    Raises:
        ModuleNotFoundError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    table = summarised.filter(pl.col("estimator") != POTENTIAL)
    figure = Figure(figsize=(8, 0.26 * len(table) + 1.3), layout="constrained")
    axes = figure.subplots()
    groups = table["group"].unique(maintain_order=True).to_list()
    for at, row in enumerate(table.iter_rows(named=True)):
        colour = f"C{groups.index(row['group']) % 10}"
        axes.axhspan(at - 0.5, at + 0.5, color=colour, alpha=0.12, linewidth=0)
        axes.plot([row["low_cells"], row["high_cells"]], [at, at], color=colour, alpha=0.35, linewidth=1.5)
        axes.plot([row["low"], row["high"]], [at, at], color=colour, linewidth=4, solid_capstyle="butt")
        axes.plot(row["regret"], at, "|", color="k", markersize=9, mew=1.6)
        rank = f"{row['rank_best']} to {row['rank_worst']}"
        axes.text(1.01, at, row["group"], transform=axes.get_yaxis_transform(), va="center", fontsize=9, weight="bold")
        axes.text(1.05, at, rank, transform=axes.get_yaxis_transform(), va="center", fontsize=8)
    axes.text(1.01, -1, "tied  rank", transform=axes.get_yaxis_transform(), va="center", fontsize=8)
    axes.set_yticks(range(len(table)), table["estimator"], fontsize=9)
    axes.set_ylim(len(table) - 0.5, -0.5)
    furthest = np.nanmax(table.select("regret", "high", "high_cells").to_numpy())
    axes.set_xlim(-0.02 * furthest - 0.01, 1.02 * furthest + 0.01)
    axes.grid(axis="x", alpha=0.3)
    label = "mean regret over cells; thick: 95 % over seeds, thin: over other cells too"
    axes.set_xlabel(label, fontsize=9)
    figure.savefig(path, dpi=130)


def improvement(runs: pl.DataFrame, path: Path) -> None:
    """Probability that the row's estimator has less regret than the column's, in percent; grey where it may be even.

    Raises:
        ModuleNotFoundError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    names = order(ranked(runs))
    regret = cube(ranked(runs))
    better = statistics.improvement(regret)
    at = [regret.estimators.index(name) for name in names]
    share, low, high = (100 * end[np.ix_(at, at)] for end in better)
    side = 0.36 * len(names) + 2.2
    figure = Figure(figsize=(side + 1, side), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(share, cmap="RdBu", vmin=0, vmax=100)
    for i, j in np.ndindex(share.shape):
        if i != j:
            even = not (low[i, j] > 50 or high[i, j] < 50)
            strong = abs(share[i, j] - 50) > 35
            style: dict[str, Any] = {"color": "0.45"} if even else {"color": "w" if strong else "k", "weight": "bold"}
            axes.text(j, i, f"{share[i, j]:.0f}", ha="center", va="center", fontsize=7.5, **style)
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.set_title("Runs in which the row has less regret than the column, %", fontsize=9)
    axes.set_xlabel("bold: the 95 % interval is clear of 50 %", fontsize=8)
    figure.colorbar(image, shrink=0.6)
    figure.savefig(path, dpi=130)
