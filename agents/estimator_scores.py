"""How good an estimate of recorded drives is: errors, peaks, and whether its bands hold what they say."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from vse_gym.types import SLOW

Floats = NDArray[Any]
LARGE = math.radians(5)  # peak sideslip from which on a drive counts as one with large sideslip
DEG = 180 / math.pi


class Scores(NamedTuple):
    """Over all instants of all drives; the sideslip above walking pace alone."""

    sideslip_rmse_deg: float
    large_rmse_deg: float  # of sideslip, over drives whose peak is beyond LARGE
    peak_ratio: float  # estimated over true sideslip where the true one is largest: median of the same drives
    vx_rmse_mps: float
    yaw_rate_rmse_degps: float
    coverage_percent: float  # truths of vx, vy and yaw rate within 1.96 standard deviations; NaN: none were given
    vy_coverage_percent: float  # the same of vy alone


def score(truth: Sequence[Floats], told: Sequence[Floats], std: Sequence[Floats] | None = None) -> Scores:
    """The scores of estimates.

    Args:
        truth: Of each drive vx, vy, yaw rate in its first columns, (T, 3 or more).
        told: What was estimated, likewise.
        std: Standard deviations of vx, vy, yaw rate, (T, 3); None: not given.
    """
    errors = [_angle(t) - _angle(e) for t, e in zip(truth, told, strict=True)]
    moving = [np.hypot(t[:, 0], t[:, 1]) > SLOW for t in truth]
    wrapped = [((e + math.pi) % (2 * math.pi) - math.pi)[m] for e, m in zip(errors, moving, strict=True)]
    peaks = [_peak(t, e, m) for t, e, m in zip(truth, told, moving, strict=True)]
    large = [k for k, (true, _) in enumerate(peaks) if abs(true) > LARGE]
    apart = np.concatenate([e[:, :3] - t[:, :3] for t, e in zip(truth, told, strict=True)])
    held = np.full(apart.shape, np.nan)
    if std is not None:
        held = np.where(np.abs(apart) <= 1.96 * np.concatenate(std)[:, :3], 100.0, 0.0)
    return Scores(
        DEG * _rms(wrapped),
        DEG * _rms([wrapped[k] for k in large]),
        float(np.median([peaks[k][1] / peaks[k][0] for k in large])) if large else math.nan,
        _rms([apart[:, 0]]),
        DEG * _rms([apart[:, 2]]),
        float(held.mean()),
        float(held[:, 1].mean()),
    )


def _angle(motion: Floats) -> Floats:
    return np.arctan2(motion[:, 1].astype(float), motion[:, 0].astype(float))


def _peak(truth: Floats, told: Floats, moving: Floats) -> tuple[float, float]:
    """The largest true sideslip, and the one estimated then."""
    if not moving.any():
        return 0.0, 0.0
    true, estimated = _angle(truth)[moving], _angle(told)[moving]
    at = int(np.argmax(np.abs(true)))
    return float(true[at]), float(estimated[at])


def _rms(parts: Sequence[Floats]) -> float:
    joined = np.concatenate([*parts, np.empty(0)]).astype(float)
    return math.sqrt(float(np.mean(joined**2))) if joined.size else math.nan


def table(found: Mapping[str, Scores], title: str) -> Table:
    """For a screen, a column an estimator."""
    out = Table("", *found, title=title)
    for name, *values in zip(Scores._fields, *found.values(), strict=True):
        out.add_row(name, *(f"{value:.3g}" for value in values))
    return out
