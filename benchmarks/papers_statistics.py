"""Figures of the papers' experiments over seeds: errors of a drive, their spread, paired comparisons."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import quantile_test

from vse_gym.physics import parameters as p
from vse_gym.replay import Trace
from vse_gym.types import Array, Log

LEVEL = 0.9  # of every interval here
DEG = 180 / np.pi


def sideslip_error(log: Log, trace: Trace) -> Array:
    """Estimated minus true sideslip, (T,) [deg]."""
    return DEG * np.arctan2(trace.estimate[:, 1], trace.estimate[:, 0]) - DEG * log.sideslip


def motion_error(log: Log, trace: Trace, which: int) -> Array:
    """Error of vx, vy (m/s), yaw rate (deg/s), ax or ay (m/s2), counted from 0, (T,)."""
    true = log.truth[:, (p.VX, p.VY, p.YAW_RATE, p.AX, p.AY)[which]]
    return (DEG if which == 2 else 1.0) * (trace.estimate[:, which] - true)


def rms(x: Array) -> float:
    """Of what is known."""
    return float(np.sqrt(np.nanmean(np.square(x))))


def spread(values: Sequence[float] | Array, spec: str = ".3g") -> str:
    """Median over seeds, and the range that holds 90 % of them."""
    low, middle, high = np.nanquantile(values, [0.5 - LEVEL / 2, 0.5, 0.5 + LEVEL / 2])
    return f"{middle:{spec}} [{low:{spec}}, {high:{spec}}]"


class Median(NamedTuple):
    """The median over seeds with its 90 % confidence interval."""

    middle: float
    low: float
    high: float

    def text(self, spec: str = "+.3g", unit: str = "") -> str:
        """As printed."""
        return f"{self.middle:{spec}} [{self.low:{spec}}, {self.high:{spec}}]{unit and ' ' + unit}"

    def judged(self, less_than: float = 0.0) -> str:
        """Whether the median is less than so much: "holds", "fails" or "open"."""
        return "holds" if self.high < less_than else "fails" if self.low > less_than else "open"


def median(values: Sequence[float] | Array) -> Median:
    """Exact for any law: by the signs of the differences to it."""
    x = np.asarray(values, dtype=float)
    interval = quantile_test(x, q=float(np.median(x)), p=0.5).confidence_interval(LEVEL)
    low, high = (end if np.isfinite(end) else pick(x) for end, pick in zip(interval, (np.min, np.max), strict=True))
    return Median(float(np.median(x)), float(low), float(high))


def gain(here: Array, other: Array) -> Median:
    """Paired by seed: by how many per cent ``here`` is less than ``other``; negative is better."""
    return median(100 * (here / other - 1))
