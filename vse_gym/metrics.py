"""Scores of one run; the unit is in the name."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.physics import parameters as p
from vse_gym.types import SLOW, Array, Log

LOST = math.radians(30)  # an estimator whose sideslip is wrong by more has diverged
COLLAPSED = 1e6  # NEES of an instant whose covariance is singular or worse, and the most that any instant counts
WORST = 14.0  # regret of a drive that ended badly, and the most a drive can have


# -- direct: how far the estimate is from the truth ------------------------------------------------------------------


class Errors(NamedTuple):
    """Estimate minus truth over a drive, and how the estimate rates itself."""

    sideslip: Array  # (T,) [rad]; NaN below walking pace
    motion: Array  # vx, vy, yaw rate, (T, 3)
    cov: Array  # (T, 3, 3)
    sideslip_std: Array  # (T,) [rad]
    nis: Array  # over its degrees of freedom, (T,)
    effective_size: Array  # (T,)


def sideslip_std(estimate: Array, cov: Array) -> Array:
    """Standard deviation of sideslip to first order, (T,) [rad], from estimates (T, 5) and covs (T, 3, 3)."""
    square = np.maximum(estimate[:, 0] ** 2 + estimate[:, 1] ** 2, 1e-12)
    slope = np.stack([-estimate[:, 1] / square, estimate[:, 0] / square], axis=1)
    variance = np.einsum("ti,tij,tj->t", slope, cov[:, :2, :2], slope)
    std: Array = np.sqrt(np.maximum(variance, 0))
    return std


def errors(truth: Array, estimate: Array, cov: Array, nis: Array, effective_size: Array) -> Errors:
    """Errors of a drive from the plant's states (T, STATE_SIZE) and estimates (T, 5)."""
    true = truth[:, [p.VX, p.VY, p.YAW_RATE]]
    motion = estimate[:, :3] - true
    true_sideslip = np.arctan2(true[:, 1], true[:, 0])
    sideslip = np.arctan2(estimate[:, 1], estimate[:, 0]) - true_sideslip
    sideslip = (sideslip + np.pi) % (2 * np.pi) - np.pi
    sideslip = np.where(np.hypot(true[:, 0], true[:, 1]) > SLOW, sideslip, np.nan)
    return Errors(sideslip, motion, cov, sideslip_std(estimate, cov), nis, effective_size)


def _rms(x: Array) -> float:
    return math.sqrt(_mean(x**2))


def _mean(x: Array) -> float:
    known = x[~np.isnan(x)]
    return float(known.mean()) if known.size else math.nan


def _largest(x: Array) -> float:
    known = np.abs(x[~np.isnan(x)])
    return float(known.max()) if known.size else math.nan


def nees(e: Errors) -> float:
    """Mean normalised estimation error squared of vx, vy, yaw rate, over 3: 1 for a consistent filter."""
    usable: NDArray[np.bool_] = np.all(np.isfinite(e.cov), axis=(1, 2)) & np.all(np.isfinite(e.motion), axis=1)
    usable &= np.any(e.cov != 0, axis=(1, 2))  # the truth knows itself
    if not usable.any():
        return math.nan
    cov, motion = e.cov[usable], e.motion[usable]
    spread = np.linalg.eigvalsh(cov)
    sound = spread[:, 0] > 1e-12 * np.abs(spread[:, -1])
    square = np.full(len(cov), COLLAPSED)
    square[sound] = np.sum(np.linalg.solve(cov[sound], motion[sound][:, :, None])[:, :, 0] * motion[sound], axis=1)
    return float(np.mean(np.minimum(square, COLLAPSED))) / 3


def coverage(e: Errors) -> float:
    """Share of instants at which the 95 % band of sideslip holds the truth [%]."""
    known = np.isfinite(e.sideslip_std) & np.isfinite(e.sideslip) & (e.sideslip_std > 0)
    if not known.any():
        return math.nan
    return 100 * float(np.mean(np.abs(e.sideslip[known]) <= 1.96 * e.sideslip_std[known]))


def diverged(e: Errors) -> bool:
    """Whether an estimate stopped being a number, or sideslip was ever wrong by more than 30 deg."""
    return not np.isfinite(e.motion).all() or _largest(e.sideslip) > LOST


_DEG = 180 / math.pi
_SIGNALS: tuple[tuple[str, str, Callable[[Errors], Array]], ...] = (
    ("sideslip", "deg", lambda e: e.sideslip * _DEG),
    ("vx", "mps", lambda e: e.motion[:, 0]),
    ("vy", "mps", lambda e: e.motion[:, 1]),
    ("yaw_rate", "degps", lambda e: e.motion[:, 2] * _DEG),
)
_SUMMARIES: tuple[tuple[str, Callable[[Array], float]], ...] = (
    ("rmse", _rms),
    ("mean_abs", lambda x: _mean(np.abs(x))),
    ("max_abs", _largest),
)


def direct(e: Errors) -> dict[str, float | bool]:
    """Every direct metric of a drive."""
    scores: dict[str, float | bool] = {
        f"{signal}_{summary}_{unit}": fold(pick(e)) for signal, unit, pick in _SIGNALS for summary, fold in _SUMMARIES
    }
    scores |= {"nees": nees(e), "nis": _mean(e.nis), "coverage_percent": coverage(e), "diverged": diverged(e)}
    scores["effective_size"] = _mean(e.effective_size)
    return scores


# -- control: what the drive was like --------------------------------------------------------------------------------


def peak_sideslip_deg(log: Log) -> float:
    """Largest |sideslip| above walking pace."""
    return math.degrees(log.peak_sideslip)


def spin(log: Log) -> float:
    """1 if sideslip passed 80 deg."""
    return float(log.ended == "spin")


def brake_energy_kJ(log: Log) -> float:  # noqa: N802  the unit is kJ
    """Heat in the brakes."""
    return float(log.truth[-1, p.BRAKE_WORK] - log.truth[0, p.BRAKE_WORK]) / 1e3


def speed_lost_mps(log: Log) -> float:
    """Speed at the start minus speed at the end."""
    speed = np.hypot(log.truth[[0, -1], p.VX], log.truth[[0, -1], p.VY])
    return float(speed[0] - speed[1])


def intervention_s(log: Log) -> float:
    """Time during which the stability control asked for something."""
    asks = np.any((log.added > 0) | (log.release > 0), axis=1)
    return float(np.sum(np.diff(log.time), where=asks[:-1]))


METRICS: dict[str, Callable[[Log], float]] = {
    f.__name__: f for f in (peak_sideslip_deg, spin, brake_energy_kJ, speed_lost_mps, intervention_s)
}


# -- against the drive with true states on the same seed --------------------------------------------------------------


def path_deviation_m(log: Log, truth: Log) -> float:
    """Largest lateral distance to the truth drive's path at equal arc length, over the common length.

    At equal time it would only measure the speed lost.
    """
    length = log.truth[:, p.DISTANCE]
    common = length <= truth.truth[-1, p.DISTANCE]
    there = [np.interp(length[common], truth.truth[:, p.DISTANCE], truth.truth[:, k]) for k in (p.X, p.Y)]
    yaw = np.interp(length[common], truth.truth[:, p.DISTANCE], truth.truth[:, p.YAW] + truth.sideslip)
    dx, dy = (log.truth[common, k] - line for k, line in zip((p.X, p.Y), there, strict=True))
    return _largest(dy * np.cos(yaw) - dx * np.sin(yaw))


def heading_difference_deg(log: Log, truth: Log) -> float:
    """Heading at the end minus that of the truth drive, whole turns counted."""
    return math.degrees(log.truth[-1, p.YAW] - truth.truth[-1, p.YAW])


class Regret(NamedTuple):
    """What seeing the car through an estimate cost, in four parts; the sum is at most 14."""

    sideslip: float  # excess of the largest |sideslip|, 5 deg are 1
    energy: float  # excess of brake energy, 50 kJ are 1; in a benign drive 5 kJ
    heading: float  # difference of the heading at the end, 10 deg are 1
    path: float  # path deviation, 1 m is 1

    @property
    def total(self) -> float:
        """Sum of the parts."""
        return sum(self)


ENDED_BADLY = Regret(4.0, 4.0, 3.0, 3.0)


def regret(log: Log, truth: Log, benign: bool) -> Regret:
    """Regret of a drive against the one with true states on the same seed.

    A drive that ended early, for whatever reason, has the worst there is. In a benign drive only needless braking
    counts.
    """
    if log.ended:
        return ENDED_BADLY
    energy = brake_energy_kJ(log) - brake_energy_kJ(truth)
    if benign:
        return Regret(0.0, float(np.clip(energy, 0, 70)) / 5, 0.0, 0.0)
    return Regret(
        float(np.clip(peak_sideslip_deg(log) - peak_sideslip_deg(truth), 0, 20)) / 5,
        float(np.clip(energy, 0, 200)) / 50,
        float(np.clip(abs(heading_difference_deg(log, truth)), 0, 30)) / 10,
        float(np.clip(path_deviation_m(log, truth), 0, 3)),
    )
