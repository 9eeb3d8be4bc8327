"""Gaussian filters: one recursion, and rules for how a Gaussian passes through a function."""

from vse_gym.inference.gaussian.cubature import Cubature
from vse_gym.inference.gaussian.extended import Extended
from vse_gym.inference.gaussian.gate import Gated
from vse_gym.inference.gaussian.heavy_tailed import HeavyTailed, cauchy_rungs
from vse_gym.inference.gaussian.recursion import (
    believe,
    correct,
    covariance,
    filter_drive,
    filter_step,
    filter_update,
    foresee,
    keep,
    learn,
    predict,
)
from vse_gym.inference.gaussian.sage_husa import SageHusa, untaught
from vse_gym.inference.gaussian.square_root import SquareRootUnscented, failed_downdates
from vse_gym.inference.gaussian.strong_tracking import StrongTracking, fading_factors
from vse_gym.inference.gaussian.unscented import Unscented

__all__ = [
    "Cubature",
    "Extended",
    "Gated",
    "HeavyTailed",
    "SageHusa",
    "SquareRootUnscented",
    "StrongTracking",
    "Unscented",
    "believe",
    "cauchy_rungs",
    "correct",
    "covariance",
    "fading_factors",
    "failed_downdates",
    "filter_drive",
    "filter_step",
    "filter_update",
    "foresee",
    "keep",
    "learn",
    "predict",
    "untaught",
]
