"""Tables and figures from the table of runs, and from nothing else."""

from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rich.table import Table

POTENTIAL = "none"
RESAMPLES = 2000


def _interval(regrets: list[np.ndarray]) -> tuple[float, float, float]:
    """Mean over cells of the mean over seeds, and its bootstrap 95 % interval; seeds are drawn anew in each cell."""
    rng = np.random.default_rng(0)
    means = np.mean([r.mean() for r in regrets])
    draws = np.mean([r[rng.integers(r.size, size=(RESAMPLES, r.size))].mean(axis=1) for r in regrets], axis=0)
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(means), float(low), float(high)


def _share(column: str) -> pl.Expr:
    return 100 * pl.col(column).cast(pl.Float64).mean()


def _known(frame: pl.DataFrame, column: str) -> float:
    """Mean of what is a number; NaN where nothing is."""
    values = frame[column].cast(pl.Float64).drop_nulls().drop_nans() if column in frame.columns else pl.Series([])
    return float(values.mean()) if len(values) else float("nan")  # type: ignore[arg-type]


def summary(runs: pl.DataFrame) -> pl.DataFrame:
    """One row per estimator, least regret first; ``none``, which is no estimator, last.

    Each cell counts alike. The interval is about the seeds drawn, not about which cells a study has.
    """
    rows: list[dict[str, Any]] = []
    for (name,), mine in runs.group_by("estimator"):
        cells = [part["regret"].to_numpy() for _, part in mine.group_by("cell", maintain_order=True)]
        mean, low, high = _interval(cells)
        rows.append(
            {
                "estimator": name,
                "regret": mean,
                "low": low,
                "high": high,
                "ended_badly_percent": 100 * float((mine["loop_ended"] != "").mean()),  # type: ignore[arg-type]
                "passed_percent": _known(mine.with_columns(p=_share("loop_passed")), "p"),
                "peak_sideslip_deg": _known(mine, "loop_peak_sideslip_deg"),
                "brake_energy_kJ": _known(mine, "loop_brake_energy_kJ"),
                "sideslip_rmse_deg": _known(mine, "shadow_sideslip_rmse_deg"),
                "vx_rmse_mps": _known(mine, "shadow_vx_rmse_mps"),
                "coverage_percent": _known(mine, "shadow_coverage_percent"),
                "update_us": _known(mine, "shadow_update_us"),
            }
        )
    ranked = pl.DataFrame(rows).with_columns(potential=pl.col("estimator") == POTENTIAL)
    return ranked.sort("potential", "regret", "estimator").drop("potential")


# column of the summary, head on a narrow screen, head on paper, format
COLUMNS: tuple[tuple[str, str, str, str], ...] = (
    ("ended_badly_percent", "bad %", "ended badly %", ".0f"),
    ("passed_percent", "pass %", "verdict passed %", ".0f"),
    ("peak_sideslip_deg", "", "peak sideslip deg", ".1f"),
    ("brake_energy_kJ", "", "brake energy kJ", ".0f"),
    ("sideslip_rmse_deg", "RMSE deg", "shadow: sideslip RMSE deg", ".2f"),
    ("vx_rmse_mps", "", "shadow: vx RMSE m/s", ".3f"),
    ("coverage_percent", "band %", "shadow: truth in the 95 % band %", ".0f"),
    ("update_us", "us", "us per update", ".0f"),
)
LEGEND = (
    "regret: what it costs to drive by the estimate, not by true states (0 to 14);\n"
    "bad: drives that ended early; pass: the manoeuvre's verdict; RMSE: of sideslip,\n"
    "listening to the truth's drive; band: truth inside the 95 % band of sideslip;\n"
    "us: microseconds per update."
)


def cells_of(summarised: pl.DataFrame, narrow: bool = False) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the summary as text; ``narrow`` fits 80 columns."""
    columns = [(key, short if narrow else long, spec) for key, short, long, spec in COLUMNS if short or not narrow]
    heads = ["estimator", "regret", "95 %" if narrow else "95 % interval", *(head for _, head, _ in columns)]
    rows = []
    for row in summarised.iter_rows(named=True):
        name = row["estimator"] + (" (potential)" if row["estimator"] == POTENTIAL else "")
        numbers = [_text(row[key], spec) for key, _, spec in columns]
        rows.append([name, _text(row["regret"], ".2f"), f"{row['low']:.2f} to {row['high']:.2f}", *numbers])
    return heads, rows


def by_cell(runs: pl.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of mean regret per estimator and cell, as text, in the summary's order."""
    order = summary(runs)["estimator"].to_list()
    cells = runs["cell"].unique().sort().to_list()
    mean = {(e, c): r for e, c, r in runs.group_by("estimator", "cell").agg(pl.col("regret").mean()).iter_rows()}
    return ["estimator", *cells], [[e, *(_text(mean.get((e, c)), ".2f") for c in cells)] for e in order]


def reasons(runs: pl.DataFrame) -> list[str]:
    """Why drives ended early, a line for each estimator and reason, the most frequent first; spins apart."""
    ended = runs.filter((pl.col("loop_ended") != "") & (pl.col("loop_ended") != "spin"))
    counts = ended.group_by("estimator", "loop_ended").len().sort("len", "estimator", descending=[True, False])
    return [f"{name}: {count} drives ended early, {why}" for name, why, count in counts.iter_rows()]


def _text(value: float | None, spec: str) -> str:
    return "-" if value is None or value != value else format(value, spec)


def on_screen(heads: list[str], rows: list[list[str]], title: str, whole: int = 1) -> Table:
    """A table for rich; the first ``whole`` columns are never wrapped."""
    out = Table(title=title, title_justify="left")
    for k, head in enumerate(heads):
        out.add_column(head, justify="left" if k == 0 else "right", no_wrap=k < whole)
    for row in rows:
        out.add_row(*row)
    return out


def markdown(heads: list[str], rows: list[list[str]]) -> str:
    """The same as Markdown."""
    lines = [heads, ["---"] + ["---:"] * (len(heads) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def regret_figure(runs: pl.DataFrame, path: Path) -> None:
    """Regret per cell and estimator, every seed a dot; needs the extra [report].

    Raises:
        ModuleNotFoundError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    order = [e for e in summary(runs)["estimator"].to_list() if e != "truth"][::-1]
    cells = runs["cell"].unique().sort().to_list()
    figure = Figure(figsize=(3.2 * len(cells) + 1.5, 0.38 * len(order) + 1.4), layout="constrained")
    frames = np.atleast_1d(figure.subplots(1, len(cells), sharey=True))
    for k, (cell, axes) in enumerate(zip(cells, frames, strict=True)):
        for at, name in enumerate(order):
            values = runs.filter((pl.col("cell") == cell) & (pl.col("estimator") == name))["regret"].to_numpy()
            colour = "0.6" if name == POTENTIAL else "C0"
            axes.barh(at, values.mean(), color=colour, alpha=0.35)
            axes.plot(values, np.full(values.size, at), ".", color=colour, markersize=4)
        axes.set_title(cell, fontsize=9)
        axes.set_xlim(0, 14.3)
        axes.grid(axis="x", alpha=0.3)
        if k == 0:
            axes.set_yticks(range(len(order)), order)
    figure.supxlabel("regret against the drive with true states (0 to 14); dots are seeds, bars their mean", fontsize=9)
    figure.savefig(path, dpi=130)


def page(runs: pl.DataFrame, path: Path, command: str) -> None:
    """The tables and two figures to move about in, as a web page that needs no network; needs the extra [report].

    Raises:
        ModuleNotFoundError: If plotly is not installed.
    """
    import plotly.graph_objects as go

    order = summary(runs)["estimator"].to_list()
    mean = runs.group_by("estimator", "cell").agg(pl.col("regret", "shadow_sideslip_rmse_deg").mean()).sort("cell")
    bars, dots = go.Figure(), go.Figure()
    for name in (e for e in order if e != "truth"):
        mine = mean.filter(pl.col("estimator") == name)
        cells, regret = mine["cell"].to_list(), mine["regret"].to_list()
        bars.add_bar(name=name, x=cells, y=regret)
        if name != POTENTIAL:
            rmse = mine["shadow_sideslip_rmse_deg"].to_list()
            dots.add_scatter(name=name, x=rmse, y=regret, text=cells, mode="markers", marker={"size": 10})
    bars.update_layout(title="Regret by cell, mean over seeds", yaxis_title="regret (0 to 14)")
    dots.update_layout(
        title="Does a small error make a good drive? One dot per estimator and cell",
        xaxis_title="shadow: sideslip RMSE [deg]",
        yaxis_title="loop: regret (0 to 14)",
    )
    texts = [
        f"<h1>{runs['study'][0]}, version {runs['version'][0]}</h1>",
        f"<p><code>{escape(command)}</code>: {len(runs)} runs.</p>",
        f"<p>{escape(LEGEND)}</p>",
        _html(*cells_of(summary(runs))),
        "<h2>Regret by cell</h2>",
        _html(*by_cell(runs)),
        bars.to_html(full_html=False, include_plotlyjs="directory"),
        dots.to_html(full_html=False, include_plotlyjs=False),
    ]
    script = path.parent / "plotly.min.js"
    if not script.exists():
        script.write_text(_plotly_script(), encoding="utf-8")
    path.write_text(HEAD + "\n".join(texts), encoding="utf-8")


HEAD = """<!doctype html><meta charset="utf-8"><title>vse-gym</title><style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #ddd; text-align: right }
td { white-space: nowrap }
th:first-child, td:first-child { text-align: left }
</style>
"""


def _plotly_script() -> str:
    from plotly.offline import get_plotlyjs

    script: str = get_plotlyjs()
    return script


def _html(heads: list[str], rows: list[list[str]]) -> str:
    top = "".join(f"<th>{escape(head)}</th>" for head in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def write(runs: pl.DataFrame, folder: Path, command: str) -> None:
    """The table of runs, and what :func:`write_tables` writes."""
    folder.mkdir(parents=True, exist_ok=True)
    runs.write_parquet(folder / "runs.parquet")
    write_tables(runs, folder, command)


def write_tables(runs: pl.DataFrame, folder: Path, command: str) -> None:
    """The summary as Markdown; with the extra [report] a figure and a page too."""
    seeds, cells = runs["seed"].n_unique(), runs["cell"].n_unique()
    text = [
        f"`{command}`: {cells} cells, {seeds} seeds.\n",
        markdown(*cells_of(summary(runs))),
        "Regret by cell:\n",
        markdown(*by_cell(runs)),
    ]
    (folder / "table.md").write_text("\n".join(text), encoding="utf-8")
    with suppress(ModuleNotFoundError):  # without the extra [report], tables alone
        regret_figure(runs, folder / "regret.png")
        page(runs, folder / "report.html", command)
