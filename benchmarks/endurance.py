"""Whether covariances stay covariances: long drives, with every sensor silent for a second now and then.

    python benchmarks/endurance.py                all that have a covariance: 100 000 steps, or 5 000 if it is a sample
    python benchmarks/endurance.py ekf sr_ukf     some of them
    python benchmarks/endurance.py --steps 2000   shorter

A recorded drive, with stability control and silent sensors, is heard over and over. At every step the covariance of
what is known must be finite, symmetric and positive definite; printed are the smallest eigenvalue met, over the
largest one of the same instant, and the largest asymmetry over the largest entry.
"""

import argparse
import time
from collections.abc import Sequence
from itertools import cycle, islice
from typing import Any, NamedTuple

import numpy as np

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.sensors import stream
from vse_gym.testing import example_drive
from vse_gym.types import Reading

STEPS, SAMPLED_STEPS = 100_000, 5_000
SILENCE, EVERY = 100, 1_000  # readings of a silent second, and from one to the next


class Endured(NamedTuple):
    """What a covariance went through."""

    steps: int  # that were made; fewer than asked for when it broke
    eigenvalue: float  # smallest of all, over the largest of the same instant [-]
    asymmetry: float  # largest, over the largest entry of the same instant [-]
    seconds: float  # of processor time, estimates and checks included
    broken: str  # empty: it held


def endurance_drive(seed: int = 0) -> tuple[Nominal, list[Reading]]:
    """What is told, and readings without end in sight: cycle through them."""
    drive = example_drive(seed)
    return drive.nominal, list(drive.readings)


def endure(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading], steps: int) -> Endured | None:
    """Hear a drive over and over, and look at the covariance after every reading; None for who has none."""
    rng = stream(0, "estimator")
    state, nothing = estimator.init(nominal, rng), np.full(readings[0].y.size, np.nan)
    eigenvalue, asymmetry, begin, k = np.inf, 0.0, time.process_time(), 0
    for k, heard in enumerate(islice(cycle(readings), steps), start=1):
        reading = heard._replace(y=nothing) if k % EVERY < SILENCE else heard
        state = estimator.update(state, reading, rng)
        cov = estimator.estimate(state).cov
        if k == 1 and (np.isnan(cov).all() or not cov.any()):
            return None
        if np.isnan(cov).all():
            return Endured(k, np.nan, np.nan, time.process_time() - begin, "not finite")
        if not cov.any():
            return Endured(k, 0.0, 0.0, time.process_time() - begin, "not positive definite")
        known = ~np.isnan(np.diag(cov))
        cov = cov[np.ix_(known, known)]
        if not np.isfinite(cov).all():
            return Endured(k, np.nan, np.nan, time.process_time() - begin, "not finite")
        values = np.linalg.eigvalsh(cov)
        eigenvalue = min(eigenvalue, values[0] / values[-1])
        asymmetry = max(asymmetry, np.abs(cov - cov.T).max() / np.abs(cov).max())
    broken = "" if eigenvalue > 0 else "not positive definite"
    broken = broken or ("" if asymmetry < 1e-12 else "not symmetric")
    return Endured(k, float(eigenvalue), float(asymmetry), time.process_time() - begin, broken)


def samples(estimator: Estimator, nominal: Nominal, reading: Reading) -> bool:
    """Whether an update draws random numbers: those are slow, and get fewer steps."""
    rng = np.random.default_rng(0)
    state = estimator.init(nominal, rng)
    before: Any = rng.bit_generator.state
    estimator.update(state, reading, rng)
    return bool(rng.bit_generator.state != before)


def main() -> None:
    """Endure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("estimators", nargs="*", default=[], help="names; none: all")
    parser.add_argument("--steps", type=int, default=0)
    args = parser.parse_args()
    nominal, readings = endurance_drive()
    print(f"{'estimator':20} {'steps':>8} {'eigenvalue':>11} {'asymmetry':>10} {'s':>7}")
    held = True
    for name in args.estimators or ESTIMATORS:
        estimator = ESTIMATORS.make(name)
        steps = args.steps or (SAMPLED_STEPS if samples(estimator, nominal, readings[0]) else STEPS)
        if (found := endure(estimator, nominal, readings, steps)) is None:
            continue
        figures = f"{found.eigenvalue:11.1e} {found.asymmetry:10.1e} {found.seconds:7.1f}"
        print(f"{name:20} {found.steps:8} {figures}  {found.broken}", flush=True)
        held = held and not found.broken
    raise SystemExit(not held)


if __name__ == "__main__":
    main()
