"""The report as a web page that needs no network."""

import re
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vse_gym.report import statistics
from vse_gym.report.sections import Section
from vse_gym.report.statistics import POTENTIAL, complete, cube, ranked, whole
from vse_gym.report.tables import order
from vse_gym.report.text import html

HEAD = """<!doctype html><meta charset="utf-8"><title>vse-gym</title><style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 80rem; margin: 2rem auto; padding: 0 1rem }
p { max-width: 50rem }
div.table { overflow-x: auto }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #ddd; text-align: right }
th { vertical-align: bottom }
td { white-space: nowrap }
th:first-child, td:first-child { text-align: left }
</style>
"""


LINKS = (
    '<p>Beside this page: <a href="table.md">all tables</a>, '
    '<a href="question.md">does a small error make a good drive?</a> and <a href="question.png">its picture</a>, '
    '<a href="ranks.png">ranks</a>, <a href="regret.png">regret by cell</a>, '
    '<a href="improvement.png">who beats whom</a>.</p>'
)


def page(runs: pl.DataFrame, summarised: pl.DataFrame, sections: list[Section], path: Path, command: str) -> None:
    """All tables, and figures to move about in; needs the extra [report].

    Raises:
        ModuleNotFoundError: If plotly is not installed.
    """
    from plotly.offline import get_plotlyjs

    first, *rest = sections
    texts = [
        f"<h1>{escape(runs['study'][0])}, version {runs['version'][0]}</h1>",
        f"<p><code>{escape(command)}</code>: {len(runs)} runs.</p>",
        LINKS,
        *_html(first),
        *(figure.to_html(full_html=False, include_plotlyjs=False) for figure in figures(runs, summarised)),
        *(text for section in rest for text in _html(section)),
    ]
    script = path.parent / "plotly.min.js"
    if not script.exists():
        script.write_text(get_plotlyjs(), encoding="utf-8")
    path.write_text(HEAD + '<script src="plotly.min.js"></script>\n' + "\n".join(texts), encoding="utf-8")


def _html(section: Section) -> list[str]:
    table = f'<div class="table">{html(*section.sheet)}</div>'
    return [f"<h2>{escape(section.title)}</h2>", f"<p>{_marked(section.text)}</p>", table]


def _marked(text: str) -> str:
    """What stands between backticks as code."""
    return re.sub("`([^`]*)`", r"<code>\1</code>", escape(text))


def figures(runs: pl.DataFrame, summarised: pl.DataFrame) -> list[Any]:
    """Plotly figures: places, regret by cell, who beats whom, and shadow error against regret."""
    return [_places(summarised), _by_cell(runs), _improvement(runs), _dots(runs)]


def _places(summarised: pl.DataFrame) -> Any:
    import plotly.graph_objects as go

    table = summarised.filter(pl.col("estimator") != POTENTIAL)
    out = go.Figure()
    for (group,), part in table.group_by(["group"], maintain_order=True):
        ends = {"array": part["high"] - part["regret"], "arrayminus": part["regret"] - part["low"], "symmetric": False}
        said = [f"rank {best} to {worst}" for best, worst in part.select("rank_best", "rank_worst").iter_rows()]
        out.add_scatter(
            name=f"tied: {group}", x=part["regret"], y=part["estimator"], error_x=ends, text=said, mode="markers"
        )
    out.update_yaxes(autorange="reversed", categoryorder="array", categoryarray=table["estimator"].to_list())
    return _laid_out(out, len(table), "Mean regret with 95 % intervals over seeds", xaxis_title="regret (0 to 14)")


def _by_cell(runs: pl.DataFrame) -> Any:
    import plotly.graph_objects as go

    names, regret = order(runs), cube(whole(runs))
    mean = regret.values.mean(axis=1)[[regret.estimators.index(name) for name in names]]
    out = go.Figure(
        go.Heatmap(z=mean, x=regret.cells, y=names, zmin=0, zmax=14, texttemplate="%{z:.1f}", colorscale="Reds")
    )
    out.update_yaxes(autorange="reversed")
    return _laid_out(out, len(names), "Regret by cell, mean over seeds")


def _improvement(runs: pl.DataFrame) -> Any:
    import plotly.graph_objects as go

    names, regret = order(ranked(runs)), cube(ranked(runs))
    at = [regret.estimators.index(name) for name in names]
    share, low, high = (100 * end[np.ix_(at, at)] for end in statistics.improvement(regret))
    hover = "%{y} has less regret than %{x} in %{z:.0f} % of runs<br>"
    hover += "95 %: %{customdata[0]:.0f} to %{customdata[1]:.0f}<extra></extra>"
    drawn = {"zmin": 0, "zmax": 100, "colorscale": "RdBu", "texttemplate": "%{z:.0f}", "hovertemplate": hover}
    out = go.Figure(go.Heatmap(z=share, x=names, y=names, customdata=np.stack([low, high], axis=-1), **drawn))
    out.update_yaxes(autorange="reversed")
    return _laid_out(out, len(names), "Runs in which the row has less regret than the column, %")


def _dots(runs: pl.DataFrame) -> Any:
    import plotly.graph_objects as go

    runs = complete(whole(runs)).filter(~pl.col("estimator").is_in(["truth", POTENTIAL]))
    mean = runs.group_by("estimator", "cell").agg(pl.col("regret", "shadow_sideslip_rmse_deg").mean()).sort("cell")
    out = go.Figure()
    for name in order(runs):
        mine = mean.filter(pl.col("estimator") == name)
        x, y, cells = (mine[column].to_list() for column in ("shadow_sideslip_rmse_deg", "regret", "cell"))
        out.add_scatter(name=name, x=x, y=y, text=cells, mode="markers", marker={"size": 9})
    axes = {"xaxis_title": "shadow: sideslip RMSE [deg]", "yaxis_title": "loop: regret (0 to 14)"}
    return _laid_out(out, 12, "Does a small error make a good drive? One dot per estimator and cell", **axes)


def _laid_out(figure: Any, rows: int, title: str, **axes: str) -> Any:
    return figure.update_layout(title=title, height=200 + 26 * rows, template="simple_white", **axes)
