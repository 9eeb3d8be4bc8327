"""Rank correlations of many samples at once, and their intervals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from vse_gym.report.statistics import DRAW, Array, Interval, widened

Indices = NDArray[np.int64]

RESAMPLES = 2000
BATCH = 100  # resamples held in memory at once


def spearman(x: Array, y: Array) -> Array:
    """Spearman's rho along the last axis, (..., n) to (...); NaN where a value is missing or all of one are equal."""
    ranks = (stats.rankdata(x, axis=-1), stats.rankdata(y, axis=-1))
    centred = [r - r.mean(axis=-1, keepdims=True) for r in ranks]
    return _correlation(*centred)


def kendall(x: Array, y: Array) -> Array:
    """Kendall's tau-b along the last axis, (..., n) to (...); NaN as in :func:`spearman`. Kendall (1945)."""
    signs = [np.sign(v[..., :, None] - v[..., None, :]).reshape(*v.shape[:-1], -1) for v in (x, y)]
    return _correlation(*signs)


def _correlation(x: Array, y: Array) -> Array:
    square = np.sum(x * x, axis=-1) * np.sum(y * y, axis=-1)
    return np.asarray(np.sum(x * y, axis=-1) / np.sqrt(np.where(square > 0, square, np.nan)))


def resampled(statistic: Callable[..., Array], *sizes: int, largest: Any = 1.0) -> Interval:
    """A statistic of what is drawn, and the 95 % interval of its bootstrap; several things are drawn independently.

    Percentiles, at the level widened for the smallest of ``sizes``, and their reflection about the value. Noise of the
    means pulls a rank correlation towards 0, the value once and what is drawn twice; percentiles alone lie too near 0,
    and the reflection as far to the other side. Where the noise is a tenth of the variance of the means, it covers 95
    to 99 % with five or more seeds; where noise hides most of the order, less, for then so does the value itself.

    Args:
        statistic: From one array of indices for each size, (B, size), to (B, k); NaN where it is not defined.
        sizes: How many there are of each thing, such as seeds and cells.
        largest: Absolute value that each figure can have, one or (k,).

    Returns:
        Value, low, high, (k,); ends are NaN with fewer than two of anything, and where half of the draws are undefined.
    """
    value = statistic(*(np.arange(size)[None] for size in sizes))[0]
    if min(sizes) < 2:
        return Interval(value, np.full_like(value, np.nan), np.full_like(value, np.nan))
    rng = np.random.default_rng(DRAW)
    rounds = [[rng.integers(size, size=(BATCH, size)) for size in sizes] for _ in range(RESAMPLES // BATCH)]
    draws = np.concatenate([statistic(*drawn) for drawn in rounds])
    beyond = (1 - widened(min(sizes))) / 2
    known = np.isfinite(value) & (np.mean(np.isfinite(draws), axis=0) > 0.5)
    ends = np.full((2, *value.shape), np.nan)
    ends[:, known] = np.nanquantile(draws[:, known], [beyond, 1 - beyond], axis=0)
    low, high = np.minimum(ends[0], 2 * value - ends[1]), np.maximum(ends[1], 2 * value - ends[0])
    return Interval(value, np.maximum(low, -largest), np.minimum(high, largest))
