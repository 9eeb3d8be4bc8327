"""Recorded drives through estimators, with no plant: everybody hears the very same readings."""

from typing import NamedTuple

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.listener import EstimatorError, Listener
from vse_gym.models import Nominal
from vse_gym.sensors import stream
from vse_gym.types import CHANNELS, FOUND, Array, Log, Reading


class Trace(NamedTuple):
    """What an estimator made of a drive, T instants long."""

    estimate: Array  # vx, vy, yaw rate, ax, ay, (T, 5)
    cov: Array  # of vx, vy, yaw rate, (T, 3, 3)
    found: Array  # roll, mass and the like, as FOUND, (T, 12); NaN where not estimated
    nis: Array  # squared normalised innovation over its degrees of freedom, (T,); NaN where none
    effective_size: Array  # of a particle filter, (T,); NaN otherwise
    seconds: float  # spent in Estimator.update and estimate, median over the readings [s]
    ended: str  # why it stopped early; empty: it did not


def shadow(log: Log, estimator: Estimator, nominal: Nominal, seed: int) -> Trace:
    """Hear a logged drive without driving it.

    Args:
        log: The drive; its truth is read by the marker class ``Truth`` alone.
        estimator: Whose estimates are wanted.
        nominal: What it is told.
        seed: Of the run; the estimator draws from the same stream as in the loop.
    """
    rows = len(log.time)
    estimate, cov = np.full((rows, 5), np.nan), np.full((rows, 3, 3), np.nan)
    found = np.full((rows, len(FOUND)), np.nan)
    nis, size = np.full(rows, np.nan), np.full(rows, np.nan)
    heard, ended = np.zeros(len(CHANNELS)), ""
    spent: list[float] = []
    try:
        listener = Listener(estimator, nominal, stream(seed, "estimator"))
        for k in range(rows):
            reading = Reading(float(log.time[k]), log.inputs[k].copy(), log.readings[k].copy())
            heard = np.where(np.isnan(reading.y), heard, reading.y)
            said = listener.hear(reading, heard, log.truth[k], float(log.friction[k]))
            spent.append(listener.seconds)
            estimate[k], cov[k], found[k] = said[:5], said.cov, said[6:]
            nis[k] = listener.nis
            size[k] = estimator.effective_size(listener.state)
    except EstimatorError as error:  # a broken estimator is a row with its reason, not the end of a benchmark
        ended = str(error)
    if not ended and not np.isfinite(estimate[:, :3]).all():
        ended = "estimate not finite"
    return Trace(estimate, cov, found, nis, size, float(np.median(spent)) if spent else np.nan, ended)
