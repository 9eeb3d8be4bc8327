"""The table that ranks, and the one beside it: regret, who is tied with whom, and regret by cell."""

import numpy as np
import polars as pl

from vse_gym.report import statistics
from vse_gym.report.ranks import ranks
from vse_gym.report.statistics import POTENTIAL, Interval, complete, cube, ranked, whole
from vse_gym.report.text import Sheet, figure_with, number, span

BASELINE = "ekf"  # what everybody knows; the row that others are compared with, where it is there

# column of the table of runs, column of the summary: plain means over runs that have the figure
MEANS = (
    ("loop_peak_sideslip_deg", "peak_sideslip_deg"),
    ("loop_brake_energy_kJ", "brake_energy_kJ"),
    ("shadow_sideslip_rmse_deg", "sideslip_rmse_deg"),
    ("shadow_vx_rmse_mps", "vx_rmse_mps"),
    ("shadow_coverage_percent", "coverage_percent"),
    ("shadow_nis", "nis"),
    ("shadow_effective_size", "effective_size"),
    ("shadow_update_us", "update_us"),
)


def summary(runs: pl.DataFrame) -> pl.DataFrame:
    """One row per estimator, least regret first; ``none``, which is no estimator, last and without rank or group.

    Each cell counts alike, and seeds that some cell lacks do not count. Columns ``low`` and ``high`` are about the
    seeds drawn, ``low_cells`` and ``high_cells`` also about which cells a study has; both 95 %.
    """
    runs = complete(whole(runs))
    regret = cube(runs)
    table = pl.DataFrame({"estimator": regret.estimators})
    table = _with(table, statistics.mean(regret), "regret", "low", "high")
    wider = statistics.mean_over_other_cells(regret)
    table = table.with_columns(low_cells=wider.low, high_cells=wider.high)
    table = _with(table, statistics.interquartile_mean(regret), "iqm", "iqm_low", "iqm_high")
    table = table.join(_places(ranked(runs)), on="estimator", how="left").join(_plain(runs), on="estimator")
    return pl.DataFrame({"estimator": order(runs)}).join(table, on="estimator", how="left", maintain_order="left")


def _with(table: pl.DataFrame, of: Interval, *names: str) -> pl.DataFrame:
    return table.with_columns(**dict(zip(names, of, strict=True)))


def _places(runs: pl.DataFrame) -> pl.DataFrame:
    """Group, rank and the comparison with the baseline, of what is ranked."""
    regret = cube(runs)
    best, worst, group = ranks(regret)
    table = pl.DataFrame({"estimator": regret.estimators, "group": group, "rank_best": best, "rank_worst": worst})
    better = statistics.improvement(regret)
    to = regret.estimators.index(BASELINE) if BASELINE in regret.estimators else None
    column = Interval(*(end[:, to] if to is not None else np.full(len(best), np.nan) for end in better))
    return _with(table, column, "improvement", "improvement_low", "improvement_high")


def _plain(runs: pl.DataFrame) -> pl.DataFrame:
    """Shares, means and medians over runs that have the figure, by estimator."""

    def known(column: str) -> pl.Expr:
        here = pl.col(column) if column in runs.columns else pl.lit(None)
        return here.cast(pl.Float64).fill_nan(None)

    return runs.group_by("estimator").agg(
        (pl.col("loop_ended") != "").sum().alias("ended_badly"),
        pl.len().alias("drives"),
        (100 * known("loop_passed").mean()).alias("passed_percent"),
        known("shadow_nees").median().alias("nees"),  # one collapsed filter makes a mean meaningless
        *(known(column).mean().alias(name) for column, name in MEANS),
        *([pl.col("tuning").first()] if "tuning" in runs.columns else []),
    )


# column of the summary, head on a narrow screen, head on paper, format
COLUMNS: tuple[tuple[str, str, str, str], ...] = (
    ("passed_percent", "pass\n%", "verdict passed %", ".0f"),
    ("sideslip_rmse_deg", "RMSE\ndeg", "shadow: sideslip RMSE deg", ".2f"),
    ("update_us", "us", "us per update", ".0f"),
)
LEGEND = (
    "regret: what it costs to drive by the estimate, not by true states (0 to 14);\n"
    "tied: those of one letter are not worse than its best by more than chance;\n"
    "bad: number of drives that ended early; pass: the manoeuvre's verdict;\n"
    "RMSE: of sideslip, listening to the truth's drive; us: microseconds per update."
)


def cells_of(summarised: pl.DataFrame, narrow: bool = False) -> Sheet:
    """The summary as text; ``narrow`` fits 80 columns."""
    heads = ["estimator", "regret", "95 %" if narrow else "95 % interval", "tied"]
    if narrow:
        heads += ["bad"]
    else:
        heads += ["rank", "ended badly", "95 %, other cells too", "interquartile mean", f"better than {BASELINE} %"]
    rows = []
    for row in summarised.iter_rows(named=True):
        name = row["estimator"] + (" (potential)" if row["estimator"] == POTENTIAL else "")
        texts = [name, number(row["regret"], ".2f"), span(row["low"], row["high"], ".2f"), row["group"] or ""]
        if narrow:
            texts += [str(row["ended_badly"])]
        else:
            share, low, high = (row[k] and 100 * row[k] for k in ("improvement", "improvement_low", "improvement_high"))
            texts += [
                "-" if row["rank_best"] is None else f"{row['rank_best']} to {row['rank_worst']}",
                f"{row['ended_badly']} of {row['drives']}",
                span(row["low_cells"], row["high_cells"], ".2f"),
                figure_with(row["iqm"], row["iqm_low"], row["iqm_high"], ".2f"),
                figure_with(share, low, high, ".0f"),
            ]
        rows.append(texts + [number(row[key], spec) for key, _, _, spec in COLUMNS])
    return Sheet([*heads, *(short if narrow else long for _, short, long, _ in COLUMNS)], rows)


def order(runs: pl.DataFrame) -> list[str]:
    """Whole estimators as the summary has them: least regret first, ``none`` last."""
    regret = cube(whole(runs))
    places = zip(regret.estimators, statistics.means(regret), strict=True)
    return [
        name for name, _ in sorted(places, key=lambda p: (p[0] == POTENTIAL, np.nan_to_num(p[1], nan=np.inf), p[0]))
    ]


def by_cell(runs: pl.DataFrame) -> Sheet:
    """Mean regret per estimator and cell as text, in the summary's order."""
    runs = complete(whole(runs))
    cells = runs["cell"].unique().sort().to_list()
    mean = {(e, c): r for e, c, r in runs.group_by("estimator", "cell").agg(pl.col("regret").mean()).iter_rows()}
    return Sheet(["estimator", *cells], [[e, *(number(mean.get((e, c)), ".2f") for c in cells)] for e in order(runs)])


def reasons(runs: pl.DataFrame) -> list[str]:
    """Why drives ended early, a line for each estimator and reason, the most frequent first; spins apart."""
    ended = runs.filter((pl.col("loop_ended") != "") & (pl.col("loop_ended") != "spin"))
    counts = ended.group_by("estimator", "loop_ended").len().sort("len", "estimator", descending=[True, False])
    return [f"{name}: {count} drives ended early, {why}" for name, why, count in counts.iter_rows()]
