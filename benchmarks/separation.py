"""Which cells of a study rank estimators, which rank nobody, and which are chaos.

    python benchmarks/separation.py headline-v1
    python benchmarks/separation.py headline-v1 --seeds 5 --cells "friction jump,braking in a turn"
    python benchmarks/separation.py headline-v1 --runs results/h/runs.parquet     drives the floor alone

A pair of estimators is apart in a cell if the 95 % interval of its paired difference of regret is clear
of 0; it matters if the interval is also clear of +/- 0.4, what a cell may score by luck. The floor is the regret of
drives with true states that are disturbed a little, by 0.02 m/s of vy or 0.2 % of the hand wheel: where so little makes
more than 0.4, the cell is chaos. Stability is the rank correlation of orders from some seeds (and cells) and from all;
of halves, between two that share no seed. Markers and the car without control are in no pair.
"""

import argparse
from dataclasses import fields, replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from joblib import Parallel, delayed
from rich.console import Console
from scipy.stats import rankdata

from vse_gym.estimators.anchors import Truth
from vse_gym.evaluation import Cell, Study, evaluate
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.metrics import regret
from vse_gym.report import in_blocks, on_screen
from vse_gym.report.statistics import Cube, cube, ranked, seed_interval
from vse_gym.simulation import rollout
from vse_gym.types import Array

MARKERS = ("truth", "truth_velocity")
VY, HAND_WHEEL = 0.02, 1.002  # disturbances: [m/s], and times
LUCK = 0.4  # most that a floor may be; smaller differences of regret do not matter
RANKS = 0.25  # share of pairs whose difference must matter (chosen)
COUNTS = (1, 3, 5, 10, 20)
DRAWS = 200  # random choices of seeds and cells


class Floor(NamedTuple):
    """Regret of drives with true states, disturbed in one way or the other."""

    vy: float
    hand_wheel: float


# -- from the table of runs -------------------------------------------------------------------------------------------


def regrets(runs: pl.DataFrame) -> Cube:
    """Regret of the estimators that are ranked."""
    return cube(ranked(runs).filter(~pl.col("estimator").is_in(MARKERS)))


def pairs_apart(values: Array, matters: float = 0.0) -> float:
    """Share of pairs of rows (E, S) whose difference has an interval beyond +/- ``matters`` [-]; NaN without pairs."""
    differences = np.array([a - b for a, b in combinations(values, 2)]).reshape(-1, values.shape[1])
    if not len(differences):
        return float("nan")
    _, low, high = seed_interval(differences)
    return float(np.mean((low > matters) | (high < -matters)))


def rank_correlation(first: Array, second: Array) -> float:
    """Spearman's, ties at their mean rank; 1 of two orders that are all ties, 0 if only one is."""
    a, b = (rankdata(values) - (len(values) + 1) / 2 for values in (first, second))
    if not a.any() or not b.any():
        return float(a.any() == b.any())
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def halves(values: Array, rng: np.random.Generator) -> float:
    """Mean rank correlation of the orders from two halves of the seeds that share none; values (E, S, C)."""
    size, found = values.shape[1], []
    if size < 2:
        return float("nan")
    for _ in range(DRAWS):
        seeds = rng.permutation(size)
        first, second = (values[:, part].mean(axis=(1, 2)) for part in (seeds[: size // 2], seeds[size // 2 :]))
        found.append(rank_correlation(first, second))
    return float(np.mean(found))


def stability(values: Array, seeds: int, cells: int, rng: np.random.Generator) -> float:
    """Mean rank correlation of orders from some seeds and cells, chosen at random, and from all; values (E, S, C)."""
    everything, found = values.mean(axis=(1, 2)), []
    for _ in range(DRAWS):
        some = values[:, rng.choice(values.shape[1], seeds, replace=False)]
        some = some[:, :, rng.choice(values.shape[2], cells, replace=False)]
        found.append(rank_correlation(some.mean(axis=(1, 2)), everything))
    return float(np.mean(found))


def verdict(share: float, floor: float) -> str:
    """What a cell is good for."""
    if not floor <= LUCK:  # nor is a cell whose truth drives all end badly anything else
        return "chaos"
    return "ranks" if share >= RANKS else "ranks nobody"


# -- the floor --------------------------------------------------------------------------------------------------------


def oversteered(manoeuvre: Manoeuvre) -> Manoeuvre:
    """The same drive with the hand wheel a little further round, whatever the driver meant."""
    kind: Any = type(manoeuvre)

    class Oversteered(kind):
        def drive(self, state, time, car):
            driver, state = super().drive(state, time, car)
            return driver._replace(hand_wheel=HAND_WHEEL * driver.hand_wheel), state

    return Oversteered(**{f.name: getattr(manoeuvre, f.name) for f in fields(manoeuvre)})


def floor_of(study: Study, cell: Cell, seed: int) -> Floor | None:
    """The floor at one seed; None if the undisturbed drive ends badly."""
    scenario = cell.scenario(study.randomise, seed)
    turned = replace(scenario, manoeuvre=oversteered(scenario.manoeuvre))
    truth = rollout(scenario, "truth", cell.controller, seed)
    if truth.ended:
        return None
    disturbed = ((scenario, Truth(bias=VY)), (turned, Truth()))
    logs = (rollout(drive, estimator, cell.controller, seed) for drive, estimator in disturbed)
    return Floor(*(regret(log, truth, cell.benign).total for log in logs))


def floors(study: Study, seeds: int, jobs: int) -> dict[str, Floor]:
    """The mean floor of every cell."""
    tasks = [(cell, seed) for cell in study.cells for seed in range(study.first_seed, study.first_seed + seeds)]
    found = Parallel(n_jobs=jobs)(delayed(floor_of)(study, cell, seed) for cell, seed in tasks)
    drives: dict[str, list[Floor]] = {cell.name: [] for cell in study.cells}
    for (cell, _), floor in zip(tasks, found, strict=True):
        if floor is not None:
            drives[cell.name].append(floor)
    unknown = Floor(float("nan"), float("nan"))
    return {name: Floor(*np.mean(every, axis=0)) if every else unknown for name, every in drives.items()}


# -- tables -----------------------------------------------------------------------------------------------------------


def per_cell(runs: pl.DataFrame, all_floors: dict[str, Floor]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows, a cell each."""
    table, rng, rows = regrets(runs), np.random.default_rng(0), []
    counts = [n for n in COUNTS if n < len(table.seeds)]
    replaced = dict(runs.unique(["cell", "seed"]).group_by("cell").agg(pl.col("replaced").sum()).iter_rows())
    for k, cell in enumerate(table.cells):
        mine, floor = table.values[:, :, k : k + 1], all_floors[cell]
        apart, matters = pairs_apart(mine[:, :, 0]), pairs_apart(mine[:, :, 0], LUCK)
        means = mine.mean(axis=(1, 2))
        figures = (100 * apart, 100 * matters, means.min(), means.max(), *floor, halves(mine, rng))
        stable = [stability(mine, n, 1, rng) for n in counts]
        texts = [f"{f:{spec}}" for f, spec in zip(figures, (".0f", ".0f", *5 * [".2f"]), strict=True)]
        more = [*(f"{s:.2f}" for s in stable), str(replaced[cell]), verdict(matters, max(floor))]
        rows.append([cell, *texts, *more])
    heads = ["cell", "apart %", "matters %", "least", "most", "floor vy", "floor wheel", "halves"]
    return [*heads, *(f"n={n}" for n in counts), "replaced", "verdict"], rows


def over_all(table: Cube) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: stability of the order over the whole study, by numbers of cells and of seeds."""
    _, size, cells = table.values.shape
    rng = np.random.default_rng(0)
    many = [n for n in (1, 2, 4, 6, 8) if n < cells] + [cells]
    some = [n for n in COUNTS if n < size] + [size]
    rows = [[str(c), *(f"{stability(table.values, n, c, rng):.2f}" for n in some)] for c in many]
    return ["cells", *(f"n={n}" for n in some)], rows


def one_left_out(table: Cube) -> list[tuple[str, float]]:
    """Rank correlation of the order without a cell and with it; the cell that matters most first."""
    everything, found = table.values.mean(axis=(1, 2)), []
    for k, cell in enumerate(table.cells):
        rest = np.delete(table.values, k, axis=2).mean(axis=(1, 2))
        found.append((cell, rank_correlation(rest, everything)))
    return sorted(found, key=lambda pair: pair[1])


def main() -> None:
    """Drive, or read, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study")
    parser.add_argument("--seeds", type=int, help="default: the study's")
    parser.add_argument("--cells", help="some of the study's, with commas between")
    parser.add_argument("--runs", type=Path, help="a finished table of runs of this study")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    study = Study.load(args.study)
    if args.cells:
        wanted = [name.strip() for name in args.cells.split(",")]
        known = {cell.name: cell for cell in study.cells}
        if wrong := [name for name in wanted if name not in known]:
            parser.error(f"no such cell: {', '.join(wrong)}; known: {', '.join(known)}")
        study = replace(study, cells=tuple(known[name] for name in wanted))
    if args.runs:
        named = pl.col("cell").is_in([cell.name for cell in study.cells])
        runs = pl.read_parquet(args.runs).filter(named, pl.col("seed") < study.first_seed + (args.seeds or study.seeds))
    else:
        runs = evaluate(study, seeds=args.seeds, jobs=args.jobs)
    table, screen = regrets(runs), Console()
    size = len(table.seeds)
    for block in in_blocks(*per_cell(runs, floors(study, size, args.jobs)), columns=5):  # 80 columns hold no more
        screen.print(on_screen(*block, f"{study.name}, {size} seeds"))
    if len(table.cells) > 1:
        screen.print(f"pairs apart over all cells: {100 * pairs_apart(table.by_seed):.0f} %")
        screen.print(f"halves of the seeds, all cells: {halves(table.values, np.random.default_rng(0)):.2f}")
        screen.print(on_screen(*over_all(table), "rank correlation with the order from all"))
        left = "; ".join(f"{cell} {figure:.2f}" for cell, figure in one_left_out(table))
        screen.print(f"rank correlation of the order without a cell with that from all: {left}")


if __name__ == "__main__":
    main()
