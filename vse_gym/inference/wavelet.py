"""How loud a sensor's noise is, in real time, from the finest wavelet coefficients of its last readings."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled

DONOHO = 0.6745  # median of |x| of a standard normal variate
PRINTED = 0.627  # what Qin et al. (2014) print in its place: 7.6 % more noise
ROOT_HALF = math.sqrt(0.5)


class NoiseLevel(NamedTuple):
    """What is remembered of the noise of m channels."""

    variances: NDArray[np.float64]  # R, (m,)
    last: NDArray[np.float64]  # the reading before, NaN where silent, (m,)
    details: NDArray[np.float64]  # |Haar detail| of each of the last N readings and the one before it, a ring, (m, N)
    time: float  # readings so far


def noise_level(variances: NDArray[np.float64], window: int) -> NoiseLevel:
    """Nothing heard yet: R_0 = variances (m,), and a window of N = ``window`` readings.

    Raises:
        ValueError: If the window does not consist of pairs.
    """
    if window < 2 or window % 2:
        raise ValueError(f"the window must be an even number of readings, not {window}")
    silence = np.full((variances.size, window), np.nan)
    return NoiseLevel(variances, silence[:, 0].copy(), silence, 0.0)


@compiled
def median(values, count):
    """Median of the first ``count`` values, which are put into another order. Hoare's selection (1961)."""
    low, high, middle = 0, count - 1, count // 2
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    if count % 2:
        return values[middle]
    below = values[0]  # the other of the two in the middle is the largest of the lower half
    for k in range(1, middle):
        below = max(below, values[k])
    return 0.5 * (below + values[middle])


@compiled
def listen(level, y, smoothing, constant):
    """The noise level after one more reading y (m,): Qin et al. (2014), with the estimate of Donoho, Johnstone (1994).

    sigma(t) = median|d|/constant over the details of the last N readings, and from the N-th reading on
    R(t) = (1 - smoothing) R(t-1) + smoothing sigma^2(t). A pair with a silent reading counts for nothing; a channel of
    which less than half the pairs were heard keeps its R.
    """
    m, size = level.details.shape
    variances, last, details = level.variances.copy(), np.empty(m), level.details.copy()
    pairs, at = np.empty(size // 2), int(level.time) % size
    for i in range(m):
        last[i] = y[i]
        details[i, at] = abs(y[i] - level.last[i]) * ROOT_HALF
        if level.time + 1 < size:
            continue
        heard = 0
        for k in range(0, size, 2):  # every other difference: those of the pairs that end with this reading
            detail = details[i, at - k]
            if not math.isnan(detail):
                pairs[heard] = detail
                heard += 1
        if heard >= size // 4:
            sigma = median(pairs, heard) / constant
            variances[i] = (1 - smoothing) * variances[i] + smoothing * sigma * sigma
    return NoiseLevel(variances, last, details, level.time + 1)
