"""The answer to the question in sentences and tables, all made of its numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from vse_gym.report.question import ALL, ERROR, Answer
from vse_gym.report.statistics import FEWEST
from vse_gym.report.text import markdown

MOST = 15  # misleading pairs that are shown
FEW = 10  # seeds; below, an interval is a rough one
NONE = "-"  # no figure, or no interval


def answer_text(answer: Answer) -> str:
    """A paragraph of sentences, then a table for each part of the answer, as Markdown."""
    parts = [
        _paragraph(answer),
        "Rank correlation of mean shadow error (RMSE of sideslip) and mean regret over estimators, with 95 % intervals "
        "over seeds, and over seeds and cells:\n",
        markdown(*_overall(answer.overall)),
        "In single cells; `tied`: not significantly more regret than the least, among all pairs of the cell:\n",
        markdown(*_by_cell(answer.by_cell)),
        *([_misleading(answer.misleading)] if _told(answer) else []),
        "Other shadow figures; `against RMSE` is their rank correlation minus that of sideslip's RMSE over the same "
        "estimators:\n",
        markdown(*_predictors(answer.predictors)),
        "**No explanation**: the error of sideslip measured in the loop. It correlates better, where it does, partly "
        "because a sliding car is harder to estimate; it is an effect of a bad drive as much as its cause.\n",
        markdown(*_predictors(answer.in_loop)),
    ]
    return "\n".join(parts)


def _told(answer: Answer) -> bool:
    """Whether there are seeds enough to tell a pair's difference from chance."""
    return bool(answer.overall["seeds"][0] >= FEWEST)


def _paragraph(answer: Answer) -> str:
    said = [_mean_sentence(row) for row in answer.overall.iter_rows(named=True)]
    said += [_cells_sentence(answer.by_cell), _least_sentence(answer.by_cell)]
    said += [_repeats_sentence(answer.repeats.row(0, named=True)), _misleading_sentence(answer)]
    anchors = _listed(answer.left_out)
    said.append(
        f"Left out: {anchors}, which would inflate the correlation: anchors see the truth, or nothing."
        if anchors
        else "Nothing was left out."
    )
    seeds = answer.overall["seeds"][0]
    said.append(
        "The intervals take the estimators as they are: filters that are near relatives count as many, and others "
        "than these may behave otherwise."
        if seeds > 1
        else "One seed gives no intervals."
    )
    if 1 < seeds < FEW:
        said.append(f"With fewer than {FEW} seeds all intervals are rough.")
    return " ".join(filter(None, said)) + "\n"


def _mean_sentence(row: dict[str, Any]) -> str:
    who = "Over all controllers" if row["controller"] == ALL else f"Under `{row['controller']}`"
    size = f"{row['estimators']} estimators, {_count(row['cells'], 'cell')} and {_count(row['seeds'], 'seed')}"
    if row["spearman"] != row["spearman"]:
        return f"{who} ({size}) there is no rank correlation: all have the same mean regret, or the same mean error."
    over = (("spearman", "over seeds"), ("spearman_cells", "if cells are drawn anew too"))
    ends = "; ".join(f"{_ends(row, key)} {what}" for key, what in over if _ends(row, key) != NONE)
    rho = f"{row['spearman']:.2f}" + (f" ({ends})" if ends else "")
    return f"{who} ({size}) the rank correlation of mean shadow error and mean regret is {rho}."


def _cells_sentence(by_cell: pl.DataFrame) -> str:
    """Of one cell all has been said."""
    rho, cells = by_cell["spearman"].drop_nans(), len(by_cell)
    said = []
    if len(rho) > 1:
        middle, least, most = np.quantile(rho.to_numpy(), [0.5, 0, 1])
        spread = f"{middle:.2f} in the median, from {least:.2f} to {most:.2f}"
        said.append(f"In a single cell the rank correlation is {spread} over {len(rho)} cells.")
    if 0 < (undefined := cells - len(rho)) < cells:
        said.append(f"It is not defined in {undefined} of {cells}, where all have the same regret or the same error.")
    return " ".join(said)


def _least_sentence(by_cell: pl.DataFrame) -> str:
    cells = _count(len(by_cell), "cell")
    said = f"The least error has the least regret in {by_cell['same'].sum()} of {cells}"
    if by_cell["tied"].null_count():
        return said + "."
    return f"{said}; in {by_cell['tied'].sum()} of {cells} it has not significantly more than the least."


def _repeats_sentence(row: dict[str, Any]) -> str:
    if (ends := _ends(row, "")) == NONE:
        return ""
    says = "says something" if row["low"] > 0 or row["high"] < 0 else "says nothing that can be told from chance"
    rows = f"mean of {row['pairs']} such rows" if row["pairs"] > 1 else "one such row"
    return (
        f"For one estimator in one cell, which seed has the larger error {says} about which has the larger regret: "
        f"rank correlation {row['rank_correlation']:.2f} ({ends}), {rows}."
    )


def _misleading_sentence(answer: Answer) -> str:
    if not _told(answer):
        return f"With fewer than {FEWEST} seeds no pair that misleads can be told from chance."
    estimators, found = answer.cell_means["estimator"].n_unique(), len(answer.misleading)
    pairs = _count(len(answer.by_cell) * estimators * (estimators - 1) // 2, "pair")
    sentence = (
        f"In {found} of {pairs} in a cell the error misleads: one has less of it, by an interval clear of 0, and more "
        "regret, by more than chance at 5 % for all pairs of the cell together."
    )
    if found:
        worst = answer.misleading.row(0, named=True)
        who = f"`{worst['less_error']}` errs {-worst['error']:.2f} deg less than `{worst['more_error']}`"
        sentence += f" The largest: in the cell '{worst['cell']}' {who} and has {worst['regret']:.2f} more regret."
    return sentence


def _misleading(frame: pl.DataFrame) -> str:
    if frame.is_empty():
        return "No pair misleads.\n"
    heads = ["cell", "controller", "A, less error", "B", "error A - B, deg", "95 %", "regret A - B", "95 %"]
    rows = [
        [r["cell"], r["controller"], r["less_error"], r["more_error"]]
        + [f"{r['error']:.2f}", _ends(r, "error"), f"{r['regret']:.2f}", _ends(r, "regret")]
        for r in frame.head(MOST).iter_rows(named=True)
    ]
    shown = f"the largest {MOST} of {len(frame)}" if len(frame) > MOST else f"all {len(frame)}"
    return f"Where it misleads, A against B, {shown}:\n\n" + markdown(heads, rows)


Table = tuple[list[str], list[list[str]]]
TIED = {True: "yes", False: "no", None: NONE}


def _overall(frame: pl.DataFrame) -> Table:
    heads = ["controller", "estimators", "cells", "seeds"]
    heads += [head for name in ("Spearman", "Kendall") for head in (name, "seeds", "seeds and cells")]
    rows = []
    for r in frame.iter_rows(named=True):
        numbers = [str(r[key]) for key in ("estimators", "cells", "seeds")]
        for key in ("spearman", "kendall"):
            numbers += [_number(r[key]), _ends(r, key), _ends(r, f"{key}_cells")]
        rows.append([r["controller"], *numbers])
    return heads, rows


def _by_cell(frame: pl.DataFrame) -> Table:
    heads = [
        "cell",
        "controller",
        "Spearman",
        "Kendall",
        "least error",
        "its regret",
        "least regret",
        "its regret",
        "tied",
    ]
    rows = [
        [r["cell"], r["controller"], _number(r["spearman"]), _number(r["kendall"]), r["least_error"]]
        + [_number(r["its_regret"]), r["least_regret_of"], _number(r["least_regret"]), TIED[r["tied"]]]
        for r in frame.iter_rows(named=True)
    ]
    return heads, rows


def _predictors(frame: pl.DataFrame) -> Table:
    heads = ["figure", "controller", "estimators", "Spearman", "95 %", "against RMSE", "95 %", "median of cells"]
    rows = []
    for r in frame.filter(pl.col("estimators") > 2).iter_rows(named=True):
        gain = ["", ""] if r["predictor"] == ERROR else [_number(r["gain"], "+.2f"), _ends(r, "gain")]
        rho = [_number(r["spearman"]), _ends(r, "spearman")]
        who = [f"`{r['predictor']}`", r["controller"], str(r["estimators"])]
        rows.append([*who, *rho, *gain, _number(r["cell_median"])])
    return heads, rows


def _ends(row: dict[str, Any], key: str) -> str:
    low, high = (row[f"{key}_{end}" if key else end] for end in ("low", "high"))
    return NONE if low != low or high != high else f"{low:.2f} to {high:.2f}"


def _number(value: float, spec: str = ".2f") -> str:
    return NONE if value != value else format(value, spec)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _listed(names: Sequence[str]) -> str:
    marked = [f"`{name}`" for name in names]
    return ", ".join(marked[:-1]) + " and " + marked[-1] if len(marked) > 1 else "".join(marked)
