"""The square-root cubature rule: one triangularisation gives the gain and the new factor, with no downdate."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.cubature import cubature_points
from vse_gym.inference.gaussian.recursion import believe, correct, covariance, every_channel, foresee, keep, predict
from vse_gym.inference.gaussian.sigma_points import (
    channels_used,
    foresee_with_factor,
    rows_of,
    spread_points,
    weighted_mean,
)
from vse_gym.inference.linalg import cholesky, forward_solve, product, triangularise
from vse_gym.inference.model import advance, observe


class SquareRootCubature(NamedTuple):
    """The cubature rule on a factor of the covariance. Arasaratnam, Haykin (2009). Carries the lower factor (n, n)."""


@keep.register(SquareRootCubature)
@compiled
def _(rule, cov):
    factor = np.empty(cov.shape)
    cholesky(cov, factor)
    return factor


@covariance.register(SquareRootCubature)
@compiled
def _(rule, kept):
    return product(kept)


@predict.register(SquareRootCubature)
@compiled
def _(rule, model, mean, kept, u):
    n = mean.size
    points, first, _, other = spread_points(rule, mean, kept)
    values = advance(model, points, u)
    new_mean = weighted_mean(values, first, other)
    noise = np.empty((n, n))
    cholesky(model.process_cov, noise)
    rows, root = np.empty((n, 3 * n)), math.sqrt(other)
    for i in range(n):
        for j in range(2 * n):
            rows[i, j] = root * (values[i, j] - new_mean[i])
        for j in range(n):
            rows[i, 2 * n + j] = noise[i, j]
    return new_mean, triangularise(rows)


@correct.register(SquareRootCubature)
@compiled
def _(rule, model, mean, kept, u, y, variances):
    # [[Z, sqrt R], [X, 0]] of deviations triangularises to [[Szz, 0], [Pxz Szz^-T, S]], S the new factor.
    used = channels_used(variances)
    n, m = mean.size, used.size
    if m == 0:
        return mean.copy(), kept.copy(), 0.0, 0.0
    points, first, _, other = spread_points(rule, mean, kept)
    values = rows_of(observe(model, points, u), used)
    expected = weighted_mean(values, first, other)
    rows, root = np.zeros((m + n, 2 * n + m)), math.sqrt(other)
    for j in range(2 * n):
        for i in range(m):
            rows[i, j] = root * (values[i, j] - expected[i])
        for i in range(n):
            rows[m + i, j] = root * (points[i, j] - mean[i])
    whitened = np.empty(m)
    for i in range(m):
        rows[i, 2 * n + i] = math.sqrt(variances[used[i]])
        whitened[i] = y[used[i]] - expected[i]
    factor = triangularise(rows)
    forward_solve(factor[:m, :m], whitened)
    nis, new_mean = 0.0, mean.copy()
    for k in range(m):
        nis += whitened[k] * whitened[k]
        for i in range(n):
            new_mean[i] += factor[m + i, k] * whitened[k]
    return new_mean, factor[m:, m:].copy(), nis, float(m)


spread_points.register(SquareRootCubature)(cubature_points)
foresee.register(SquareRootCubature)(foresee_with_factor)
believe.register(SquareRootCubature)(every_channel)
