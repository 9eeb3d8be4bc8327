"""What every estimator promises."""

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vse_gym.checks.blocks import COMMON_CHECKS, check_is_symmetric
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.probing import Block, require, who
from vse_gym.types import CHANNELS, U_BRAKE, WHEELS, Y_AX, Y_AY, Y_YAW_RATE, Estimate, Reading


def check_follows_a_drive(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """After every reading of a drive there is an Estimate, and its vx and vy are finite."""
    _stays_finite(estimator, nominal, readings, "on an ordinary drive")


def check_survives_silence(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """With every sensor silent for 1 s, from the first reading on or amid a drive, the estimate stays finite."""
    for begin in (0, len(readings) // 4):
        silent = copy.deepcopy(list(readings))
        for reading in silent[begin : begin + round(1 / nominal.dt)]:
            reading.y[:] = np.nan
        _stays_finite(estimator, nominal, silent, f"with all sensors silent from reading {begin} on")


def check_survives_a_dropout(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """With any one sensor silent for 0.2 s, from the first reading on and amid a drive, the estimate stays finite."""
    length = round(0.2 / nominal.dt)
    for channel, name in enumerate(CHANNELS):
        partly = copy.deepcopy(list(readings[: len(readings) // 2]))
        for reading in partly[:length] + partly[len(partly) // 2 :][:length]:
            reading.y[channel] = np.nan
        _stays_finite(estimator, nominal, partly, f"with {name} silent for {length} readings")


def check_survives_outliers(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """Readings of 20 m/s2, 100 deg/s and locked wheels, one alone and 0.5 s long, leave the estimate finite."""
    wild = copy.deepcopy(list(readings))
    length, middle = round(0.5 / nominal.dt), len(wild) // 4
    for k in (middle // 2, *range(middle, middle + length)):
        sign = 1.0 if k // 10 % 2 == 0 else -1.0
        wild[k].y[[Y_AX, Y_AY, Y_YAW_RATE]] = -20.0 * sign, 20.0 * sign, math.radians(100) * sign
        wild[k].y[WHEELS] = 0.0
        wild[k].inputs[U_BRAKE : U_BRAKE + 4] = nominal.vehicle.brake_caps
    _stays_finite(estimator, nominal, wild, "after wild outliers")


def check_stands_still(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """A car that stands, its brakes off and on, every reading zero, has a finite estimate."""
    still = [r._replace(inputs=np.zeros_like(r.inputs), y=np.zeros_like(r.y)) for r in readings]
    for reading in still[len(still) // 2 :]:
        reading.inputs[U_BRAKE : U_BRAKE + 4] = nominal.vehicle.brake_caps
    _stays_finite(estimator, replace(nominal, speed=0.0), still, "of a standing car")


def _stays_finite(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading], when: str) -> None:
    for k, estimate in enumerate(Block(estimator, nominal, [readings]).drive()):
        told = f"{who(estimator)} {when}, after reading {k}"
        require(isinstance(estimate, Estimate), f"{told}: {estimate!s:.200}, expected an Estimate.")
        told += f": {', '.join(f'{name} = {v}' for name, v in zip(estimate._fields[:5], estimate[:5], strict=True))}"
        numbers = [value for name, value in estimate._asdict().items() if name != "cov"]
        require(all(np.ndim(value) == 0 for value in numbers), f"{told}, expected plain floats beside cov.")
        advice = "leave silent channels out, and divide by nothing that may be zero"
        finite = math.isfinite(estimate.vx) and math.isfinite(estimate.vy)
        require(finite, f"{told}, expected finite vx and vy: {advice}.")
        require(not any(math.isinf(v) for v in numbers), f"{told}, expected no infinity; unknown is NaN: {advice}.")


def check_covariance(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """``cov`` is (3, 3) and, where it is not NaN, symmetric and positive semi-definite, to rounding (1e-9)."""
    for k, estimate in enumerate(Block(estimator, nominal, [readings]).drive()):
        told = f"{who(estimator)}, after reading {k}: cov of vx, vy, yaw_rate is {np.asarray(estimate.cov).tolist()}"
        require(np.shape(estimate.cov) == (3, 3), f"{told}, expected shape (3, 3), NaN where unknown.")
        known = ~np.isnan(np.diag(estimate.cov))
        cov = estimate.cov[np.ix_(known, known)]
        small = 1e-9 * np.max(np.abs(cov), initial=0.0)
        require(bool(np.all(np.isfinite(cov))), f"{told}, expected finite numbers beside a finite variance.")
        require(bool(np.all(np.abs(cov - cov.T) <= small)), f"{told}, expected symmetry: hand out (P + P^T)/2.")
        lowest = np.min(np.linalg.eigvalsh(cov), initial=0.0)
        require(bool(lowest >= -small), f"{told}, expected no negative eigenvalue, not {lowest}: use Joseph's form.")


ESTIMATOR_CHECKS: tuple[Callable[..., None], ...] = (
    check_follows_a_drive,
    check_survives_silence,
    check_survives_a_dropout,
    check_survives_outliers,
    check_stands_still,
    check_covariance,
    *COMMON_CHECKS,
    check_is_symmetric,
)
