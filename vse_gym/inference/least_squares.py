"""Recursive least squares with forgetting: parameters of a linear regression, as its measurements come in."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.linalg import joseph_scalar


class LeastSquares(NamedTuple):
    """Tunings of the recursion for p parameters."""

    forgetting: float  # weight of everything known so far when a measurement comes in, in (0, 1]
    excitation: float  # a row phi with phi^T phi below this says nothing
    trace: float  # of the covariance, at most: forgetting without news would make it grow for ever
    lower: NDArray[np.float64]  # bounds of the parameters, (p,)
    upper: NDArray[np.float64]  # (p,)


@compiled
def forget(squares, cov, used):
    """Widen the covariance (p, p) in place, in those parameters (p,) that a measurement is about to speak of.

    P_ij over sqrt(lam_i lam_j), with lam_i = 1 for the others: what is not measured is not forgotten, and with all of
    them measured it is the textbook's P / lam. Then all of it is scaled down to the largest trace.
    """
    root, trace = 1 / math.sqrt(squares.forgetting), 0.0
    for i in range(used.size):
        for j in range(used.size):
            cov[i, j] *= (root if used[i] else 1.0) * (root if used[j] else 1.0)
        trace += cov[i, i]
    if trace > squares.trace:
        for i in range(used.size):
            for j in range(used.size):
                cov[i, j] *= squares.trace / trace


@compiled
def least_squares_step(squares, parameters, cov, rows, targets, variances):
    """The parameters after one instant's measurements targets = rows parameters + noise. Ljung, Soderstrom (1983).

    Minimises the sum of squared errors over their variances, each weighted by ``forgetting`` to the power of its age
    in informative instants; the start counts as a measurement of the parameters themselves.

    Args:
        squares: The tunings.
        parameters: (p,).
        cov: Of the parameters, (p, p); in their units if the variances are those of the noise.
        rows: phi^T of each measurement, (m, p).
        targets: What was measured, (m,); NaN: nothing.
        variances: Of the measurements' noise, (m,).

    Returns:
        parameters within their bounds, cov: new arrays; as they were if no row says anything.
    """
    p, m = parameters.size, targets.size
    parameters, cov = parameters.copy(), cov.copy()
    heard, used = np.zeros(m, np.bool_), np.zeros(p, np.bool_)
    for i in range(m):
        square = 0.0
        for j in range(p):
            square += rows[i, j] * rows[i, j]
        heard[i] = square >= squares.excitation and math.isfinite(square + targets[i])
        if heard[i]:
            for j in range(p):
                used[j] = used[j] or rows[i, j] != 0.0
    forget(squares, cov, used)
    gain, scratch = np.empty(p), np.empty((p, p))
    for i in range(m):
        if heard[i]:
            error = targets[i]
            for j in range(p):
                error -= rows[i, j] * parameters[j]
            joseph_scalar(parameters, cov, rows[i], error, variances[i], gain, scratch)
    for j in range(p):
        parameters[j] = max(squares.lower[j], min(squares.upper[j], parameters[j]))
    return parameters, cov
