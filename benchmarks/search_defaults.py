"""Where the defaults of SingleTrackTuning come from: a random search on the cells of ``training-v1``.

    python benchmarks/search_defaults.py --samples 60

Every sample drives the EKF through all training cells and seeds; printed are the best by mean regret, with the RMSE
of sideslip on the truth's drive beside it. UKF and particle filters use the same tuning, so that what differs between
their rows is the rule alone.
"""

import argparse
from dataclasses import replace

import numpy as np

from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.evaluation import Study, evaluate
from vse_gym.models import SingleTrackTuning

RANGES = {  # searched on a logarithmic scale
    "vx_noise": (0.3, 3.0),
    "vy_noise": (0.3, 5.0),
    "yaw_noise": (0.05, 2.0),
    "ax_error": (0.2, 3.0),
    "ay_error": (1.5, 8.0),
}


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    base, study = SingleTrackTuning(), Study.load("training-v1")
    draws = [{k: float(np.exp(rng.uniform(*np.log(r)))) for k, r in RANGES.items()} for _ in range(args.samples)]
    rows = {f"{k:03d}": ExtendedKalmanFilter(replace(base, **draw)) for k, draw in enumerate(draws)}
    rows["default"] = ExtendedKalmanFilter(base)
    runs = evaluate(study, rows, jobs=args.jobs)
    figures = runs.select("estimator", "cell", "regret", "shadow_sideslip_rmse_deg")
    mean = figures.filter(runs["estimator"] != "none").drop("cell").group_by("estimator").mean().sort("regret")
    for row in mean.head(12).iter_rows(named=True):
        name = row["estimator"]
        tuning = "" if name == "default" else ", ".join(f"{k} {v:.2f}" for k, v in draws[int(name)].items())
        print(f"{name}: regret {row['regret']:.3f}, sideslip RMSE {row['shadow_sideslip_rmse_deg']:.3f} deg; {tuning}")
    default = mean.filter(mean["estimator"] == "default").row(0, named=True)
    print(f"default: regret {default['regret']:.3f}, RMSE {default['shadow_sideslip_rmse_deg']:.3f} deg")


if __name__ == "__main__":
    main()
