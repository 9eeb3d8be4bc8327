"""How the cost of a study grows with its cells, its seeds, its estimators and their particles.

    python benchmarks/cost.py
    python benchmarks/cost.py --study headline-v1 --out results/cost.md

One process, processor time, each figure the least of some repeats: what else the machine does can only add. The first
drive of all, which may compile, is not counted. A straight line is fitted to each row: what it costs to begin, what
one more costs, and how far the figures lie from the line.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from vse_gym.estimators.particle import BootstrapParticleFilter
from vse_gym.evaluation import Study, evaluate

PARTICLES = (100, 300, 1000, 3000)
COUNTS = (1, 2, 4, 8)
SHARE = ("truth", "ekf")


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Least processor time of a piece of work [s]."""
    spent = []
    for _ in range(repeats):
        begin = process_time()
        work()
        spent.append(process_time() - begin)
    return min(spent)


def line(counts: Sequence[float], spent: Sequence[float]) -> tuple[float, float, float]:
    """Intercept and slope of the straight line through figures, and their largest relative distance from it."""
    slope, start = np.polyfit(counts, spent, 1)
    off = np.max(np.abs(start + slope * np.asarray(counts) - spent) / np.asarray(spent))
    return float(start), float(slope), float(off)


def rows(study: Study, repeats: int) -> list[tuple[str, Sequence[int], list[float]]]:
    """What is counted, how many there were, and the seconds that each took."""
    evaluate(study, SHARE, seeds=1)
    first = replace(study, cells=study.cells[:1])
    cells = [k for k in COUNTS if k <= len(study.cells)]
    out: list[tuple[str, Sequence[int], list[float]]] = []

    def measure(what: str, counts: Sequence[int], work: Callable[[int], object]) -> None:
        out.append((what, counts, [seconds(lambda k=k: work(k), repeats) for k in counts]))  # type: ignore[misc]

    measure("cells", cells, lambda k: evaluate(replace(study, cells=study.cells[:k]), SHARE, seeds=1))
    measure("seeds", COUNTS, lambda k: evaluate(first, SHARE, seeds=k))
    measure("estimators (ekf)", COUNTS, lambda k: evaluate(first, {f"ekf {i}": "ekf" for i in range(k)}, seeds=1))
    measure("particles", PARTICLES, lambda k: evaluate(first, {"pf": BootstrapParticleFilter(size=k)}, seeds=1))
    return out


def markdown(study: Study, measured: list[tuple[str, Sequence[int], list[float]]]) -> str:
    """The table."""
    text = [
        f"{study.name}, one process, processor time; loop and shadow, truth and uncontrolled drives included.\n",
        "| what | how many: seconds | to begin s | one more ms | farthest from the line % |",
        "| --- | --- | ---: | ---: | ---: |",
    ]
    for what, counts, spent in measured:
        listed = ", ".join(f"{k}: {s:.2f}" for k, s in zip(counts, spent, strict=True))
        start, slope, off = line(counts, spent)
        text.append(f"| {what} | {listed} | {start:.2f} | {1e3 * slope:.3g} | {100 * off:.0f} |")
    return "\n".join(text) + "\n"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--study", default="headline-v1")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, help="write the table here too (Markdown)")
    args = parser.parse_args()
    study = Study.load(args.study)
    table = markdown(study, rows(study, args.repeats))
    print(table)
    if args.out is not None:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(table, encoding="utf-8")


if __name__ == "__main__":
    main()
