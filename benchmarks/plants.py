"""Would another's car give the same order? The ranking on CommonRoad's multi-body car beside that on ours.

    python benchmarks/plants.py                       (pip install 'vse-gym[multibody]')
    python benchmarks/plants.py --seeds 4 --jobs 2

The same cars, drives, draws and noise on both plants; on friction up to 0.8, because on more the multi-body's inner
wheels carry negative loads for long. Its roads are level and alike left and right.
"""

import argparse
from dataclasses import replace

import numpy as np
from rich.console import Console

from vse_gym.evaluation import Cell, Randomise, Study, evaluate
from vse_gym.report import on_screen
from vse_gym.report.rank_correlation import Indices, resampled, spearman
from vse_gym.report.statistics import Cube, cube, mean, ranked
from vse_gym.types import Array

ESTIMATORS = ("ekf", "ukf", "ekf_told", "ekf_double_track", "pf", "pf_cauchy_gaussian", "kinematic", "kf")
PLANTS = ("double_track", "commonroad_mb")
CELLS = (
    Cell(
        "friction jump",
        "held_steer",
        vehicle="bmw_320i",
        controller="esc",
        sensors="cauchy_gaussian",
        settings={"speed_kmh": 80, "amplitude_deg": 60, "friction": 0.8, "friction_after": 0.35, "jump": 1.8},
    ),
    Cell(
        "lane change",
        "double_lane_change",
        vehicle="bmw_320i",
        controller="sideslip_esc",
        sensors="biased",
        settings={"speed_kmh": 70, "friction": 0.4},
    ),
    Cell(
        "sine with dwell",
        "sine_with_dwell",
        vehicle="vw_vanagon",
        controller="sideslip_esc",
        sensors="gaussian",
        settings={"speed_kmh": 80, "amplitude_deg": 100, "friction": 0.5},
    ),
    Cell(
        "braking in a turn",
        "brake_in_turn",
        vehicle="ford_escort",
        controller="sideslip_esc",
        sensors="loud",
        settings={"speed_kmh": 80, "amplitude_deg": 40, "friction": 0.8, "brake": 2.0, "duration": 5.0},
    ),
)
RANDOM = Randomise(
    speed=3 / 3.6, steer=0.12, friction=0.03, mass=(1.0, 1.25), stiffness=(0.75, 1.0)
)  # as the headline's


def study_on(plant: str) -> Study:
    """The drives on one plant; the names of cells, and so the draws, are the same on both."""
    cells = tuple(replace(cell, plant=plant) for cell in CELLS)
    return Study(f"plants: {plant}", 1, cells, randomise=RANDOM)


def agreement(first: Array, second: Array) -> tuple[float, float, float]:
    """Spearman's correlation of the orders by mean regret (E, S, C) on two plants, and its interval about the seeds."""

    def drawn(seeds: Indices) -> Array:
        of_first, of_second = (values[:, seeds].mean(axis=(2, 3)).T for values in (first, second))
        return spearman(of_first, of_second)[:, None]

    figure, low, high = (float(end[0]) for end in resampled(drawn, first.shape[1]))
    return figure, low, high


def main() -> None:
    """Drive and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    tables = [evaluate(study_on(plant), ESTIMATORS, args.seeds, args.jobs) for plant in PLANTS]
    ours, theirs = (cube(ranked(table)) for table in tables)
    screen = Console()
    screen.print(on_screen(*side_by_side(ours, theirs), f"mean regret, {args.seeds} seeds: seven degrees | multi-body"))
    for k, cell in (*enumerate(ours.cells), (slice(None), "all cells")):
        parts = (of.values[:, :, k].reshape(*of.values.shape[:2], -1) for of in (ours, theirs))
        figure, low, high = agreement(*parts)
        screen.print(f"rank correlation, {cell}: {figure:.2f} [{low:.2f}, {high:.2f}]")


def side_by_side(ours: Cube, theirs: Cube) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: an estimator each, the least regret on our plant first."""
    (own, *_), (other, *_) = mean(ours), mean(theirs)
    rows = []
    for k in np.argsort(own):
        cells = [f"{a:.2f} | {b:.2f}" for a, b in zip(ours.values[k].mean(0), theirs.values[k].mean(0), strict=True)]
        rows.append([ours.estimators[k], f"{own[k]:.2f} | {other[k]:.2f}", *cells])
    return ["estimator", "all", *ours.cells], rows


if __name__ == "__main__":
    main()
