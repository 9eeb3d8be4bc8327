"""Scores of what some estimators find beside the motion: roll, mass, axle stiffnesses, friction."""

import math

import numpy as np

from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.axles import axle_stiffness
from vse_gym.types import FOUND, SLOW, Array, Log

SMALLEST = math.radians(0.3)  # an axle with less slip has no stiffness that could be told from noise [rad]
LAST = 1.0  # what is found is what is believed in the end: over so long [s]
NAMES = FOUND[: len(FOUND) // 2]  # the others are their standard deviations


# name: unit, factor into it, whether the error is relative to the true value
SCALES: dict[str, tuple[str, float, bool]] = {
    "roll": ("deg", 180 / math.pi, False),
    "roll_rate": ("degps", 180 / math.pi, False),
    "mass": ("kg", 1.0, False),
    "stiffness_front": ("percent", 100.0, True),
    "stiffness_rear": ("percent", 100.0, True),
    "friction": ("abs", 1.0, False),
}


def true_value(log: Log, name: str, tyres_known: bool = True) -> Array:
    """What there was to be found in a drive, (T,) in SI; NaN where it is not defined.

    An axle's stiffness is the plant's lateral force over the slip angle, at slip angles of 0.3 deg and more.

    Args:
        log: Of the drive.
        name: One of NAMES.
        tyres_known: Whether the log's vehicle is what moved; another plant's tyres nobody knows.
    """
    if name in ("roll", "roll_rate"):
        return log.truth[:, p.ROLL if name == "roll" else p.ROLL_RATE]
    if name == "friction":
        return log.friction
    car = log.vehicle
    if car is None or (name != "mass" and not tyres_known):
        return np.full(len(log.time), np.nan)
    if name == "mass":
        return np.full(len(log.time), car.mass)
    both = axle_stiffness(car, log.truth, log.steer, log.friction, SMALLEST)
    moving = np.hypot(log.truth[:, p.VX], log.truth[:, p.VY]) > SLOW
    return np.where(moving, both[:, 0 if name == "stiffness_front" else 1], np.nan)


def sheet_value(nominal: Nominal, name: str) -> float:
    """What whoever estimates nothing believes: the data sheet, and a car that does not roll. SI."""
    car = nominal.vehicle
    values = {"roll": 0.0, "roll_rate": 0.0, "mass": car.mass, "friction": nominal.friction}
    values["stiffness_front"] = 2 * car.front_tyre.cornering_stiffness
    values["stiffness_rear"] = 2 * car.rear_tyre.cornering_stiffness
    return float(values[name])


def found(log: Log, estimates: Array, nominal: Nominal, tyres_known: bool = True) -> dict[str, float]:
    """RMSE over a drive, that of the data sheet, mean error over the last second, and coverage of the 95 % band.

    A parameter that the estimator is silent about is NaN.

    Args:
        log: Of the drive that was heard.
        estimates: As FOUND, (T, 12).
        nominal: What the estimator was told.
        tyres_known: As of :func:`true_value`.
    """
    scores: dict[str, float] = {}
    late = log.time > log.time[-1] - LAST if len(log.time) else np.zeros(0, bool)
    for k, name in enumerate(NAMES):
        unit, factor, relative = SCALES[name]
        names = [f"{name}_{what}_{unit}" for what in ("rmse", "sheet_rmse", "final")] + [f"{name}_coverage_percent"]
        value, std = estimates[:, k], estimates[:, k + len(NAMES)]
        if np.isnan(value).all():
            scores |= dict.fromkeys(names, math.nan)
            continue
        true = true_value(log, name, tyres_known)
        error, believed = value - true, sheet_value(nominal, name) - true
        shown, sheet = (factor * (e / true if relative else e) for e in (error, believed))
        banded = np.isfinite(error) & np.isfinite(std) & (std > 0)
        covered = np.abs(error[banded]) <= 1.96 * std[banded]
        rms = [math.sqrt(_mean(e**2)) for e in (shown, np.where(np.isnan(shown), np.nan, sheet))]
        scores |= dict(zip(names, (*rms, _mean(shown[late]), 100 * _mean(covered.astype(float))), strict=True))
    return scores


def _mean(x: Array) -> float:
    known = x[~np.isnan(x)]
    return float(known.mean()) if known.size else math.nan
