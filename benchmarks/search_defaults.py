"""Where the default tunings of the filters come from: a random search on the cells of ``training-v1``.

    python benchmarks/search_defaults.py ekf
    python benchmarks/search_defaults.py pf --samples 100

Every sample drives the estimator through all training cells and seeds; printed are the best by mean regret, with the
RMSE of sideslip on the truth's drive beside it. No table reports these cells or seeds. The extended and the unscented
filter share a tuning, so that what differs between their rows is the rule alone.
"""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from vse_gym.catalogue import ESTIMATORS
from vse_gym.evaluation import Study, evaluate

FILTERS = ("ekf", "ekf_double_track", "pf", "pf_cauchy_gaussian")
RANGES = {  # the same for all, searched on a logarithmic scale
    "vx_noise": (0.1, 3.0),
    "vy_noise": (0.1, 5.0),
    "yaw_noise": (0.03, 2.0),
    "ax_error": (0.1, 3.0),
    "ay_error": (0.3, 8.0),
    "yaw_rate_error": (0.001, 0.05),
    "wheel_error": (0.01, 1.0),
}


def sample(name: str, rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """An estimator with a random tuning, and the tuning."""
    base = ESTIMATORS[name]()
    draw = {key: float(np.exp(rng.uniform(*np.log(limits)))) for key, limits in RANGES.items()}
    return replace(base, model=replace(base.model, **draw)), draw


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("estimator", choices=FILTERS)
    parser.add_argument("--samples", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    samples = [sample(args.estimator, rng) for _ in range(args.samples)]
    rows = {f"{k:03d}": estimator for k, (estimator, _) in enumerate(samples)} | {
        "default": ESTIMATORS[args.estimator]()
    }
    runs = evaluate(Study.load("training-v1"), rows, jobs=args.jobs)
    figures = runs.filter(pl.col("estimator") != "none").select("estimator", "regret", "shadow_sideslip_rmse_deg")
    mean = figures.group_by("estimator").mean().sort("regret")
    best = pl.concat([mean.head(10), mean.filter(pl.col("estimator") == "default")])
    for name, regret, rmse in best.iter_rows():
        tuning = {} if name == "default" else samples[int(name)][1]
        listed = ", ".join(f"{key} {value:.3g}" for key, value in tuning.items())
        print(f"{name}: regret {regret:.2f}, sideslip RMSE {rmse:.2f} deg; {listed}")


if __name__ == "__main__":
    main()
