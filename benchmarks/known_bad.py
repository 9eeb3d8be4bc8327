"""Does the battery see that an estimator was made worse? The estimate of a parent at half gain, late, biased, or zero.

    python benchmarks/known_bad.py
    python benchmarks/known_bad.py --study headline-v1 --seeds 5 --jobs 2

Each should have more regret than its parent over the whole study, with an interval of the paired difference clear of 0;
printed are also the cells in which it has less. In a benign drive only false alarms count, and who sees less sideslip
raises fewer, so that the difference without such drives stands beside. ``truth`` is made worse by the loop itself,
``ekf`` by a wrapper that sees nothing but its estimate.
"""

import argparse
from collections.abc import Callable, Sequence
from typing import Any

from rich.console import Console

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.anchors import Truth
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.degraded import Degraded
from vse_gym.evaluation import Study, evaluate
from vse_gym.report import on_screen
from vse_gym.report.statistics import Cube, Interval, cube, mean, ranked, seed_interval

WORSE: dict[str, dict[str, float]] = {
    "half gain": {"gain": 0.5},
    "100 ms late": {"delay": 0.1},
    "biased by 0.5 m/s": {"bias": 0.5},  # 1.3 deg at 80 km/h; chosen
    "biased by -0.5 m/s": {"bias": -0.5},
    "zero sideslip": {"gain": 0.0},
}
PARENTS: dict[str, Callable[..., Estimator]] = {
    "truth": Truth,
    "ekf": lambda **changes: Degraded(ESTIMATORS.make("ekf"), **changes),
}


def contenders() -> dict[str, Any]:
    """Parents and their worse children, by the names of their rows."""
    children = {f"{parent}, {how}": make(**c) for parent, make in PARENTS.items() for how, c in WORSE.items()}
    return {parent: parent for parent in PARENTS} | children


def parent_of(name: str) -> str:
    """Whose child a row is."""
    return name.partition(",")[0]


def minus_parents(runs: Cube) -> Interval:
    """Each row's paired difference to its parent, mean over cells, (E,)."""
    parents = [runs.estimators.index(parent_of(name)) for name in runs.estimators]
    return seed_interval(runs.by_seed - runs.by_seed[parents])


def against_parents(runs: Cube, benign: Sequence[str] = ()) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: regret over the study, the paired difference to the parent, and that without benign cells."""
    regret, difference = mean(runs), minus_parents(runs)
    needy = [k for k, cell in enumerate(runs.cells) if cell not in benign]
    elsewhere = minus_parents(runs._replace(cells=(), values=runs.values[:, :, needy]))
    found, rows = (regret, difference, elsewhere), []
    for parent in PARENTS:
        for name in (parent, *(f"{parent}, {how}" for how in WORSE)):
            k = runs.estimators.index(name)
            own, apart, rest = (f"{i.value[k]:.2f} [{i.low[k]:.2f}, {i.high[k]:.2f}]" for i in found)
            seen = "worse" if difference.low[k] > 0 else "better" if difference.high[k] < 0 else "not apart"
            rows.append([name, own, "", "", ""] if name == parent else [name, own, apart, seen, rest])
    return ["estimator", "regret", "minus the parent's", "verdict", "without benign cells"], rows


def exceptions(runs: Cube) -> list[str]:
    """A line for each child and cell in which it has less regret than its parent; a star: interval clear of 0."""
    lines = []
    for name in (n for n in runs.estimators if n not in PARENTS):
        child, parent = (runs.values[runs.estimators.index(n)] for n in (name, parent_of(name)))
        difference = seed_interval((child - parent).T)
        for k, cell in enumerate(runs.cells):
            if difference.value[k] < 0:
                ends = f"{difference.value[k]:.2f} [{difference.low[k]:.2f}, {difference.high[k]:.2f}]"
                lines.append(f"{name}: {cell}: {ends}{' *' if difference.high[k] < 0 else ''}")
    return lines


def main() -> None:
    """Drive and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--study", default="headline-v1")
    parser.add_argument("--seeds", type=int, help="default: the study's")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    study = Study.load(args.study)
    runs = cube(ranked(evaluate(study, contenders(), args.seeds, args.jobs)))
    benign = [cell.name for cell in study.cells if cell.benign]
    screen = Console()
    screen.print(on_screen(*against_parents(runs, benign), f"{args.study}, {len(runs.seeds)} seeds"))
    screen.print("Less regret than the parent, cell by cell (*: interval clear of 0):")
    for line in exceptions(runs):
        screen.print(f"  {line}")


if __name__ == "__main__":
    main()
