"""What changed between two folders of results, with intervals: B minus A, paired by cell and seed."""

from typing import NamedTuple

import numpy as np
import polars as pl

from vse_gym.report.results import KEYS, ORIGIN, TIMES, TUNING, UPDATE, Results
from vse_gym.report.statistics import complete, cube, seed_interval
from vse_gym.report.statistics import mean as seed_mean

MOST = 8  # cells that are shown
DIGITS = 6  # of a difference; less is rounding
BAD = "ended_badly_percent"


class Measure(NamedTuple):
    """What is compared."""

    column: str
    title: str
    spec: str  # of a number
    ranked: bool = True  # less is better


MEASURES = (
    Measure("regret", "mean regret", ".2f"),
    Measure("shadow_sideslip_rmse_deg", "shadow: RMSE of sideslip, deg", ".3f"),
    Measure(BAD, "drives that ended badly, %", ".1f"),
    Measure("shadow_coverage_percent", "shadow: truth in the 95 % band of sideslip, %", ".1f", ranked=False),
)


class Section(NamedTuple):
    """A table as text, for a screen or for paper."""

    title: str
    heads: list[str]
    rows: list[list[str]]


class Comparison(NamedTuple):
    """What changed; frames have one row per estimator, and cell or measure."""

    origin: list[str]  # sentences: what differs in where the rows come from
    equality: str  # a sentence: whether the common rows are the same
    changes: pl.DataFrame
    by_cell: pl.DataFrame
    times: pl.DataFrame
    machines: str  # a sentence; empty if there are no times


def compare_results(a: Results, b: Results) -> Comparison:
    """B against A over the runs that both have.

    Intervals are 95 % of the paired difference over seeds, the same seeds drawn for all cells; ``better`` and ``worse``
    are intervals clear of 0, ``same`` is one that is not. Nothing is adjusted for how many are looked at.

    Raises:
        ValueError: If no cell, seed and estimator is in both.
    """
    both = a.runs.with_columns(_bad(a.runs)).join(b.runs.with_columns(_bad(b.runs)), on=KEYS, suffix=" of B")
    if both.is_empty():
        parts = (f"{what}s {_some(x.runs[what])}" for what in KEYS for x in (a, b))
        raise ValueError(f"{a.path} and {b.path} have no run in common: {'; '.join(parts)}")
    both = both.sort(KEYS)
    measured = [m for m in MEASURES if {m.column, f"{m.column} of B"} <= set(both.columns)]
    names = both["estimator"].unique().sort().to_list()
    pairs = {(n, m): _paired(both.filter(pl.col("estimator") == n), m.column) for n in names for m in measured}
    changes = pl.DataFrame([_change(n, m, frame) for (n, m), frame in pairs.items()])
    cells = [row for n in names for row in _cells(n, pairs[n, MEASURES[0]])]
    times, machines = _times(a, b)
    origin = [*_origin(a, b), *filter(None, [_unpaired(both)])]
    return Comparison(origin, _equality(a, b, both), changes, pl.DataFrame(cells), times, machines)


def _bad(runs: pl.DataFrame) -> list[pl.Expr]:
    ended = pl.col("loop_ended") != ""
    return [(100 * ended.cast(pl.Float64)).alias(BAD)] if "loop_ended" in runs.columns else []


def _unpaired(both: pl.DataFrame) -> str:
    """A sentence if an interval over seeds cannot use all common runs."""
    used = sum(len(complete(mine)) for mine in both.partition_by("estimator"))
    left = f"{len(both) - used} common runs are of seeds that not every cell has: differences are without them."
    return left if used < len(both) else ""


# -- whence they come -------------------------------------------------------------------------------------------------


def _origin(a: Results, b: Results) -> list[str]:
    lines = [
        f"{key.replace('_', ' ')}: {a.origin.get(key) or 'unknown'} in A, {b.origin.get(key) or 'unknown'} in B"
        for key in ORIGIN
        if a.origin.get(key) != b.origin.get(key)
    ]
    digests = [x.origin.get("study_digest") for x in (a, b)]
    if None in digests:
        lines.append("Whether both drove the same cells and draws is not known: the study's digest is missing.")
    elif digests[0] != digests[1]:
        lines.append("The studies differ: the drives are not the same, and pairs are only as good as their seeds.")
    for name in sorted(a.tunings.keys() & b.tunings.keys()):
        if a.tunings[name] != b.tunings[name]:
            lines.append(f"tuning of {name}: {a.tunings[name]} in A, {b.tunings[name]} in B")
    for what in KEYS:
        own, other = set(a.runs[what]), set(b.runs[what])
        for only, where in ((own - other, "A"), (other - own, "B")):
            if only:
                lines.append(f"{what}s only in {where}: {_some(pl.Series(sorted(only)))}")
    return lines


def _some(values: pl.Series) -> str:
    """Values in few words: numbers without a gap as a range, names as they are."""
    kinds = values.unique().sort().to_list()
    if len(kinds) > 2 and all(isinstance(k, int) for k in kinds) and kinds[-1] - kinds[0] == len(kinds) - 1:
        return f"{kinds[0]} to {kinds[-1]}"
    return ", ".join(map(str, kinds))


def _equality(a: Results, b: Results, both: pl.DataFrame) -> str:
    """Whether common rows are equal, NaN to NaN, in the columns that do not say where a row comes from."""
    apart = {*KEYS, *ORIGIN, *TUNING, *TIMES}
    own, other = (set(x.runs.columns) - apart for x in (a, b))
    columns = sorted(own & other)
    alone = sorted(own ^ other)
    note = f" Columns that only one has: {', '.join(alone)}." if alone else ""
    alike = {c: both[c].eq_missing(both[f"{c} of B"]) for c in columns if a.runs[c].dtype == b.runs[c].dtype}
    changed = [c for c in columns if c not in alike or not alike[c].all()]
    rows = f"The {len(both)} common runs"
    if not changed:
        return f"{rows} are bit-equal in all {len(columns)} common columns.{note}"
    same = pl.DataFrame(alike).select(pl.all_horizontal(pl.all())).to_series() if alike else pl.Series([False])
    most = sorted(changed, key=lambda c: int(alike[c].sum()) if c in alike else 0)[:4]
    more = f" and {len(changed) - len(most)} more" if len(changed) > len(most) else ""
    return f"{rows} are not bit-equal: {(~same).sum()} differ, in {', '.join(most)}{more}.{note}"


# -- what changed -----------------------------------------------------------------------------------------------------


def _paired(mine: pl.DataFrame, column: str) -> pl.DataFrame:
    """A column of one estimator's runs in A and B, missing in both where it is in one."""
    a, b = (pl.col(c).cast(pl.Float64).fill_null(float("nan")) for c in (column, f"{column} of B"))
    known = a.is_finite() & b.is_finite()
    picked = [pl.when(known).then(value).otherwise(float("nan")).alias(name) for name, value in (("a", a), ("b", b))]
    return mine.select(*KEYS, *picked).with_columns(difference=(pl.col("b") - pl.col("a")).round(DIGITS))


def _change(name: str, measure: Measure, pairs: pl.DataFrame) -> dict[str, object]:
    value, low, high = (float(end[0]) for end in seed_mean(cube(pairs, "difference")))
    a, b = (float(seed_mean(cube(pairs, side)).value[0]) for side in ("a", "b"))
    row = {"estimator": name, "measure": measure.column, "a": a, "b": b, "difference": value}
    return row | {"low": low, "high": high, "verdict": _verdict(value, low, high, measure.ranked)}


def _cells(name: str, pairs: pl.DataFrame) -> list[dict[str, object]]:
    of_a, of_b, of_difference = (cube(pairs, side) for side in ("a", "b", "difference"))
    value, low, high = seed_interval(of_difference.values[0].T)
    a, b = (side.values[0].mean(axis=0) for side in (of_a, of_b))
    return [
        {"cell": cell, "estimator": name, "a": a[k], "b": b[k], "difference": value[k], "low": low[k], "high": high[k]}
        | {"verdict": _verdict(value[k], low[k], high[k])}
        for k, cell in enumerate(of_difference.cells)
    ]


def _verdict(value: float, low: float, high: float, ranked: bool = True) -> str:
    if value != value:
        return "-"
    if value == low == high == 0 or (value == 0 and low != low):
        return "same"
    if low != low:
        return "?"  # one seed, or figures that are missing in some runs
    if low <= 0 <= high:
        return "same"
    words = ("worse", "better") if ranked else ("more", "less")
    return words[0] if low > 0 else words[1]


def _times(a: Results, b: Results) -> tuple[pl.DataFrame, str]:
    """Medians over the common runs, and on which machines."""
    schema = {"estimator": pl.String, "a": pl.Float64, "b": pl.Float64, "ratio": pl.Float64}
    if not all(UPDATE in x.times.columns for x in (a, b)):
        return pl.DataFrame(schema=schema), ""
    both = a.times.join(b.times, on=KEYS, suffix=" of B").drop_nulls([UPDATE, f"{UPDATE} of B"])
    medians = both.group_by("estimator").agg(a=pl.col(UPDATE).median(), b=pl.col(f"{UPDATE} of B").median())
    ratios = medians.filter(pl.col("a") > 0).with_columns(ratio=pl.col("b") / pl.col("a")).sort("estimator")
    on = [_some(x.times["machine"].drop_nulls()) if "machine" in x.times.columns else "unknown" for x in (a, b)]
    if on[0] == on[1] != "unknown":
        return ratios, f"Both on {on[0]}."
    word = "Not known to be one machine" if "unknown" in on else "The machines differ, so the ratio is of them too"
    return ratios, f"{word}. A: {on[0]}. B: {on[1]}."


# -- as text ----------------------------------------------------------------------------------------------------------


def sections(found: Comparison, by_cell: bool = False) -> list[Section]:
    """The tables of what changed; ``by_cell``: all cells, not only those that changed most."""
    parts = []
    for measure in MEASURES:
        if len(frame := _known(found.changes, measure)) and (frame["difference"] != 0).any():
            parts.append(Section(measure.title, ["estimator", "A", "B", *HEADS], _rows(frame, measure.spec)))
    cells = found.by_cell.sort(pl.col("difference").abs(), "cell", "estimator", descending=[True, False, False])
    shown = found.by_cell.sort("cell", "estimator") if by_cell else cells.filter(pl.col("difference") != 0).head(MOST)
    if len(shown):
        title = "regret in all cells" if by_cell else "where regret changed most"
        rows = [[cell, *row[:2], *row[3:]] for cell, row in zip(shown["cell"], _rows(shown, ".2f"), strict=True)]
        parts.append(Section(title, ["cell", "estimator", "A", *HEADS], rows))
    if len(found.times):
        rows = [[r["estimator"], *(f"{r[k]:.1f}" for k in "ab"), f"{r['ratio']:.2f}"] for r in found.times.to_dicts()]
        parts.append(Section("median time of an update, us", ["estimator", "A", "B", "B / A"], rows))
    return parts


def unchanged(found: Comparison) -> str:
    """A sentence about the measures that are the same in the mean of every estimator; empty if there are none."""
    frames = {measure.title: _known(found.changes, measure) for measure in MEASURES}
    titles = [title for title, frame in frames.items() if len(frame) and (frame["difference"] == 0).all()]
    return f"No difference, for any estimator: {'; '.join(titles)}." if titles else ""


def _known(changes: pl.DataFrame, measure: Measure) -> pl.DataFrame:
    return changes.filter((pl.col("measure") == measure.column) & pl.col("difference").is_not_nan())


HEADS = ["B - A", "95 %", ""]


def _rows(frame: pl.DataFrame, spec: str) -> list[list[str]]:
    rows = []
    for r in frame.iter_rows(named=True):
        ends = "-" if np.isnan(r["low"]) else f"{r['low']:{spec}} to {r['high']:{spec}}"
        numbers = [f"{r['a']:{spec}}", f"{r['b']:{spec}}", f"{r['difference']:+{spec}}", ends]
        rows.append([r["estimator"], *numbers, r["verdict"]])
    return rows
