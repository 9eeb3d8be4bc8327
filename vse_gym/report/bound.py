"""How many times the least possible error estimators make: a table and a figure from the rows of a matched study."""

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vse_gym.report.statistics import Array, seed_interval
from vse_gym.report.text import markdown

ERRORS = (("sideslip", "shadow_sideslip_rmse_deg", "bound_sideslip_deg"), ("vx", "shadow_vx_rmse_mps", "bound_vx_mps"))
LEGEND = (
    "times the bound: root mean square error over the least that any estimator can have (posterior Cramer-Rao bound),\n"
    "1 is perfect; the interval is about the seeds. Drives are drawn from the estimator's own model and its noise,\n"
    "named by `model`; `kf` and `kinematic` have none of these and hear the single track's as they are."
)


def _multiple(errors: Array, least: Array) -> list[float]:
    """Root mean square over seeds, (S,) each, over that of the bounds, and its 95 % interval; NaN where it has none.

    The interval is that of the mean square. A drive given up has no error, and leaving it out would flatter.
    """
    squares = seed_interval(errors[None] ** 2 / np.mean(least**2))
    return [float(np.sqrt(np.maximum(end[0], 0))) for end in squares]


def multiples(runs: pl.DataFrame) -> pl.DataFrame:
    """One row per cell and estimator, in each cell the nearest to the sideslip's bound first.

    Columns: cell, estimator, model; ``sideslip``, ``sideslip_low``, ``sideslip_high`` [times the bound] and the same of
    ``vx``, NaN for who gave up a drive; ``bound_sideslip_deg``, ``bound_vx_mps``, root mean squares over seeds;
    ``bound_error_percent``, the largest; ``nees``, ``coverage_percent``, ``update_us``, means over seeds; ``seeds``;
    ``ended``, how many drives were given up.
    """
    rows: list[dict[str, Any]] = []
    for (cell, name, model), mine in runs.group_by("cell", "estimator", "model", maintain_order=True):
        row: dict[str, Any] = {"cell": cell, "estimator": name, "model": model}
        for error, column, least in ERRORS:
            errors, bounds = (mine[key].cast(pl.Float64).fill_null(math.nan).to_numpy() for key in (column, least))
            row |= dict(zip((error, f"{error}_low", f"{error}_high"), _multiple(errors, bounds), strict=True))
            row[least] = float(np.sqrt(np.mean(bounds**2)))
        row["bound_error_percent"] = mine["bound_error_percent"].max()
        for key in ("nees", "coverage_percent", "update_us"):
            row[key] = mine[f"shadow_{key}"].cast(pl.Float64).mean()
        row |= {"seeds": len(mine), "ended": int((mine["shadow_ended"] != "").sum())}
        rows.append(row)
    return pl.DataFrame(rows).sort("cell", "sideslip", "estimator")


def bound_cells(times: pl.DataFrame, narrow: bool = False) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of :func:`multiples` as text; ``narrow``, of one cell, is shorter and fits 80 columns."""
    heads = ["cell", "estimator", "model", "sideslip: times the bound", "95 % interval", "vx: times the bound"]
    heads += ["95 % interval", "bound: sideslip deg", "vx m/s", "NEES", "truth in the 95 % band %", "us per update"]
    if narrow:
        heads = ["estimator", "model", "side-\nslip", "95 %", "vx", "bound\ndeg", "NEES", "us"]
    rows = []
    for row in times.iter_rows(named=True):
        own, other = (
            [_text(row[error], ".2f"), " to ".join(_text(row[f"{error}_{end}"], ".2f") for end in ("low", "high"))]
            for error, *_ in ERRORS
        )
        bounds = [f"{row['bound_sideslip_deg']:.4f}", f"{row['bound_vx_mps']:.4f}"]
        nees, band, time = (
            _text(row[k], s) for k, s in (("nees", ".2f"), ("coverage_percent", ".0f"), ("update_us", ".0f"))
        )
        given_up = f"({row['ended']} of {row['seeds']} drives given up)" if row["ended"] else ""
        if narrow:
            model = row["model"].removesuffix("Track").lower()
            rows.append([f"{row['estimator']}\n{given_up}".strip(), model, *own, other[0], bounds[0], nees, time])
        else:
            name = f"{row['estimator']} {given_up}".strip()
            rows.append([row["cell"], name, row["model"], *own, *other, *bounds, nees, band, time])
    return heads, rows


def write_bound(runs: pl.DataFrame, folder: Path, command: str) -> None:
    """The table of multiples as Markdown, ``bound.md``; with the extra [report] a figure too, ``bound.png``."""
    times = multiples(runs)
    seeds, cells = runs["seed"].n_unique(), runs["cell"].n_unique()
    text = [f"`{command}`: {cells} cells, {seeds} seeds.\n", f"{LEGEND}\n", markdown(*bound_cells(times))]
    (folder / "bound.md").write_text("\n".join(text), encoding="utf-8")
    with suppress(ModuleNotFoundError):
        bound_figure(times, folder / "bound.png")


def _text(value: float | None, spec: str) -> str:
    return "-" if value is None or math.isnan(value) else format(value, spec)


def bound_figure(times: pl.DataFrame, path: Path) -> None:
    """Multiples of the sideslip's bound with their intervals, a frame per cell; needs the extra [report].

    Raises:
        ModuleNotFoundError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    cells = times["cell"].unique().sort().to_list()
    order = (
        times.group_by("estimator").agg(pl.col("sideslip").mean()).sort("sideslip", descending=True, nulls_last=True)
    )
    names = order["estimator"].to_list()
    figure = Figure(figsize=(3.2 * len(cells) + 1.5, 0.38 * len(names) + 1.6), layout="constrained")
    frames = np.atleast_1d(figure.subplots(1, len(cells), sharey=True))
    for k, (cell, axes) in enumerate(zip(cells, frames, strict=True)):
        for row in times.filter(pl.col("cell") == cell).iter_rows(named=True):
            at = names.index(row["estimator"])
            axes.plot([row["sideslip_low"], row["sideslip_high"]], [at, at], color="C0", linewidth=2)
            axes.plot(row["sideslip"], at, "o", color="C0", markersize=5)
        axes.axvline(1.0, color="k", linewidth=1)
        axes.axvline(1.2, color="0.5", linewidth=1, linestyle=":")
        axes.set_xscale("log")
        axes.set_title(cell, fontsize=9)
        axes.grid(axis="x", alpha=0.3)
        if k == 0:
            axes.set_yticks(range(len(names)), names)
    figure.supxlabel("sideslip: root mean square error over its bound (line: 1, dots: 1.2), 95 % intervals", fontsize=9)
    figure.savefig(path, dpi=130)
