"""Tables beside the one that ranks: differences to the truth, consistency, gain and price, attribution, tunings."""

import polars as pl

from vse_gym.report import statistics
from vse_gym.report.statistics import POTENTIAL, Cube, complete, cube, whole
from vse_gym.report.tables import order
from vse_gym.report.text import Sheet, figure_with, number

TRUTH = "truth"
PARTS = {
    "whole": "whole estimate",
    "velocity": "only vx, vy estimated",
    "yaw": "only yaw rate, ax, ay estimated",
    "acceleration": "only ax, ay estimated",
}

# column of the table of runs, head, format: every one is a difference to the drive with true states of the same seed
DIFFERENCES = (
    ("regret", "regret", ".2f"),
    ("loop_peak_sideslip_deg_diff", "peak sideslip deg", "+.2f"),
    ("loop_brake_energy_kJ_diff", "brake energy kJ", "+.1f"),
    ("loop_speed_lost_mps_diff", "speed lost m/s", "+.2f"),
    ("loop_heading_absdiff_deg", "heading deg, to either side", ".1f"),
    ("loop_path_deviation_m", "path m, to either side", ".2f"),
)
# column of the summary, head, format
CONSISTENCY = (
    ("sideslip_rmse_deg", "sideslip RMSE deg", ".2f"),
    ("vx_rmse_mps", "vx RMSE m/s", ".3f"),
    ("nees", "NEES, median", ".3g"),
    ("nis", "NIS", ".3g"),
    ("coverage_percent", "truth in the 95 % band %", ".0f"),
    ("effective_size", "effective sample size", ".0f"),
)
# what some estimators find beside the motion: column of the table of runs without what is scored, unit, format
FOUND = (
    ("roll", "deg", ".2f"),
    ("roll_rate", "degps", ".2f"),
    ("mass", "kg", ".0f"),
    ("stiffness_front", "percent", ".1f"),
    ("stiffness_rear", "percent", ".1f"),
    ("friction", "abs", ".3f"),
)
UNITS = {"degps": "deg/s", "percent": "%", "abs": "-"}
# column of the table of runs, head, format
PRICE = (
    ("loop_peak_sideslip_deg", "peak sideslip deg", ".1f"),
    ("loop_brake_energy_kJ", "brake energy kJ", ".1f"),
    ("loop_speed_lost_mps", "speed lost m/s", ".1f"),
)
NEEDLESS = (
    ("intervened", "drives with any %", ".0f"),
    ("loop_intervention_s", "time s", ".2f"),
    ("loop_brake_energy_kJ_diff", "brake energy kJ, more than with true states", "+.2f"),
)


def differences(runs: pl.DataFrame) -> Sheet:
    """Mean paired differences to the drive with true states, each with its interval."""
    texts = [_texts(cube(whole(runs), column), spec) for column, _, spec in DIFFERENCES]
    return Sheet(["estimator", *_heads(DIFFERENCES)], [[e, *_row(texts, e)] for e in order(runs) if e != TRUTH])


def consistency(summarised: pl.DataFrame) -> Sheet:
    """How an estimator errs beside the drive with true states, and whether it knows."""
    judged = summarised.filter(~pl.col("estimator").is_in([POTENTIAL, TRUTH])).iter_rows(named=True)
    rows = [[row["estimator"], *(number(row[key], spec) for key, _, spec in CONSISTENCY)] for row in judged]
    return Sheet(["estimator", *_heads(CONSISTENCY)], rows)


def gain_and_price(runs: pl.DataFrame) -> Sheet | None:
    """What stability control changes against the same drive without it, by controller; benign cells apart.

    None if the table has no drive without control, or benign ones alone.
    """
    runs = _with_bad(whole(runs).filter(~pl.col("benign")))
    if POTENTIAL not in runs["estimator"]:
        return None
    rows = []
    for controller, mine in _by_controller(runs):
        bad = _shares(cube(mine, "bad"))
        more = [_texts(_against(cube(mine, column), POTENTIAL), f"+{spec}") for column, _, spec in PRICE]
        named = [e for e in order(mine) if e != POTENTIAL]
        rows += [[e, controller, bad[e], bad[POTENTIAL], *_row(more, e)] for e in named]
    heads = ["estimator", "controller", "ended badly %", "without control %"]
    return Sheet([*heads, *(f"{head}, more" for head in _heads(PRICE))], rows)


def gain_by_cell(runs: pl.DataFrame) -> Sheet:
    """Share of drives that ended badly and mean peak sideslip, by cell."""
    return _two_by_cell(_with_bad(runs), ("bad", ".0f", "%"), ("loop_peak_sideslip_deg", ".1f", "deg"))


def price_by_cell(runs: pl.DataFrame) -> Sheet:
    """Mean brake energy and speed lost, by cell."""
    return _two_by_cell(runs, ("loop_brake_energy_kJ", ".0f", "kJ"), ("loop_speed_lost_mps", ".1f", "m/s"))


def false_interventions(runs: pl.DataFrame) -> Sheet | None:
    """What stability control does in drives that need no help; None if the study has no such cell."""
    benign = whole(runs).filter(pl.col("benign") & (pl.col("estimator") != POTENTIAL))
    if benign.is_empty():
        return None
    benign = benign.with_columns(intervened=100.0 * (pl.col("loop_intervention_s") > 0))
    texts = [_texts(cube(benign, column), spec) for column, _, spec in NEEDLESS]
    early = dict(benign.group_by("estimator").agg(pl.col("loop_ended").ne("").sum()).iter_rows())
    rows = [[e, *_row(texts, e), str(early[e])] for e in order(benign)]
    return Sheet(["estimator", *_heads(NEEDLESS), "drives that ended early"], rows)


def attribution(runs: pl.DataFrame) -> Sheet | None:
    """Mean regret if the controller sees only a part of the estimate and the rest is true; None without such rows."""
    if "part" not in runs.columns or not set(runs["part"]) & (PARTS.keys() - {"whole"}):
        return None
    owner = pl.when(pl.col("part") == "whole").then("estimator").otherwise("parent")
    runs = complete(runs).with_columns(estimator=owner)
    groups = _by_controller(runs)
    rows = []
    for controller, mine in [("all", runs), *groups] if len(groups) > 1 else groups:
        driven = [mine.filter(pl.col("part") == part) for part in PARTS]
        texts = [_texts(cube(part), ".2f") if len(part) else {} for part in driven]
        parents = {e for text in texts[1:] for e in text}
        named = [e for e in order(runs) if e in parents]
        rows += [[e, controller, *_row(texts, e)] for e in named + sorted(parents - set(named))]
    return Sheet(["estimator", "controller", *PARTS.values()], rows)


def found(runs: pl.DataFrame) -> Sheet | None:
    """What estimators find beside the motion, a row for each; None if nobody finds anything."""
    runs, rows = complete(whole(runs)), []
    for name, unit, spec in FOUND:
        columns = [f"shadow_{name}_{what}_{unit}" for what in ("rmse", "sheet_rmse", "final")]
        columns += [f"shadow_{name}_coverage_percent"]
        if not set(columns) <= set(runs.columns):
            continue
        means = runs.group_by("estimator").agg(pl.col(c).cast(pl.Float64).fill_nan(None).mean() for c in columns)
        of = {e: figures for e, *figures in means.iter_rows() if figures[0] is not None}
        specs = (spec, spec, "+" + spec, ".0f")
        for e in order(runs):
            if e in of:
                texts = [number(x, s) for x, s in zip(of[e], specs, strict=True)]
                rows.append([e, f"{name.replace('_', ' ')} {UNITS.get(unit, unit)}", *texts])
    heads = ["estimator", "finds", "RMSE", "RMSE of the data sheet", "error at the end", "truth in the 95 % band %"]
    return Sheet(heads, rows) if rows else None


def ended_early(runs: pl.DataFrame) -> Sheet | None:
    """Why drives ended before their time, the most frequent first; None if none did."""
    ended = whole(runs).filter(pl.col("loop_ended") != "")
    if ended.is_empty():
        return None
    counts = ended.group_by("estimator", "loop_ended").agg(pl.len(), pl.col("cell").unique().sort())
    counts = counts.sort("len", "estimator", "loop_ended", descending=[True, False, False])
    return Sheet(
        ["estimator", "drives", "why", "in"],
        [[name, str(count), why, ", ".join(cells)] for name, why, count, cells in counts.iter_rows()],
    )


def tunings(runs: pl.DataFrame) -> Sheet | None:
    """Which tuning each row used; None if the table does not say."""
    if "tuning" not in runs.columns:
        return None
    used = whole(runs).group_by("estimator").agg(pl.col("tuning").drop_nulls().unique().sort())
    named = {e: ", ".join(all_of) for e, all_of in used.iter_rows()}
    return Sheet(["estimator", "tuning"], [[e, named[e]] for e in order(runs) if e != POTENTIAL])


# -- helpers ----------------------------------------------------------------------------------------------------------


def _with_bad(runs: pl.DataFrame) -> pl.DataFrame:
    return runs.with_columns(bad=100.0 * (pl.col("loop_ended") != ""))


def _by_controller(runs: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    return [(str(name), runs.filter(pl.col("controller") == name)) for name in runs["controller"].unique().sort()]


def _against(of: Cube, reference: str) -> Cube:
    """Paired differences to a row."""
    return of._replace(values=of.values - of.values[of.estimators.index(reference)])


def _heads(columns: tuple[tuple[str, str, str], ...]) -> list[str]:
    return [head for _, head, _ in columns]


def _row(texts: list[dict[str, str]], estimator: str) -> list[str]:
    return [text.get(estimator, "-") for text in texts]


def _texts(of: Cube, spec: str) -> dict[str, str]:
    """Mean and interval by estimator."""
    figures = zip(of.estimators, *(end.tolist() for end in statistics.mean(of)), strict=True)
    return {e: figure_with(value, low, high, spec) for e, value, low, high in figures}


def _shares(of: Cube) -> dict[str, str]:
    return {e: number(share, ".0f") for e, share in zip(of.estimators, statistics.means(of).tolist(), strict=True)}


def _two_by_cell(runs: pl.DataFrame, *columns: tuple[str, str, str]) -> Sheet:
    """Two means in each field; columns are name, format, unit."""
    runs = complete(whole(runs))
    cells = runs["cell"].unique().sort().to_list()
    controllers = dict(runs.select("cell", "controller").unique().iter_rows())
    means = runs.group_by("estimator", "cell").agg(pl.col(column).mean() for column, _, _ in columns)
    texts = {
        (e, c): ", ".join(f"{number(x, spec)} {unit}" for x, (_, spec, unit) in zip(figures, columns, strict=True))
        for e, c, *figures in means.iter_rows()
    }
    heads = [f"{cell} ({controllers[cell]})" for cell in cells]
    return Sheet(["estimator", *heads], [[e, *(texts.get((e, c), "-") for c in cells)] for e in order(runs)])
