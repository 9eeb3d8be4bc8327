"""What rules share that push points through a function: means and covariances of columns, and the two halves of a step.

Points lie as columns; all but the first have the same weight, and the first has one for means and one for covariances.
"""

import math

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.linalg import cholesky, forward_solve, symmetrise
from vse_gym.inference.model import advance, observe


@generic
def spread_points(rule, mean, factor):
    """The points (n, p) that stand for a Gaussian with a lower factor (n, n) of its covariance, and their weights.

    Returns:
        points, the weight of the first one in a mean and in a covariance, and the weight of every other.
    """


@compiled
def plus_and_minus(points, begin, mean, factor, root):
    """Fill the columns from ``begin`` on with the mean plus, then minus, ``root`` times each column of the factor."""
    n = mean.size
    for i in range(n):
        for j in range(n):
            step = root * factor[i, j]
            points[i, begin + j] = mean[i] + step
            points[i, begin + n + j] = mean[i] - step


@compiled
def weighted_mean(values, first, other):
    """Of columns: (rows,)."""
    out = np.empty(values.shape[0])
    for i in range(values.shape[0]):
        total = 0.0
        for j in range(1, values.shape[1]):
            total += values[i, j]
        out[i] = first * values[i, 0] + other * total
    return out


@compiled
def weighted_cov(a, a_mean, b, b_mean, first, other):
    """Weighted cross-covariance of two sets of columns: (rows of a, rows of b)."""
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for k in range(b.shape[0]):
            total = 0.0
            for j in range(1, a.shape[1]):
                total += (a[i, j] - a_mean[i]) * (b[k, j] - b_mean[k])
            out[i, k] = first * (a[i, 0] - a_mean[i]) * (b[k, 0] - b_mean[k]) + other * total
    return out


@compiled
def channels_used(variances):
    """Indices of the channels that have a variance."""
    used = np.empty(variances.size, np.int64)
    count = 0
    for i in range(variances.size):
        if not math.isnan(variances[i]):
            used[count] = i
            count += 1
    return used[:count]


@compiled
def rows_of(values, used):
    """Those rows of a matrix."""
    out = np.empty((used.size, values.shape[1]))
    for i in range(used.size):
        for j in range(values.shape[1]):
            out[i, j] = values[used[i], j]
    return out


@compiled
def gain_step(factor, cross, y, expected, used):
    """The correction by a joint reading with innovation covariance S = L L^T and cross-covariance Pxz (n, m).

    ``cross`` becomes W = Pxz L^-T in place: the covariance loses W W^T, and the mean gains W (L^-1 v).

    Returns:
        The mean's gain (n,) and the NIS.
    """
    m = used.size
    whitened = np.empty(m)
    for i in range(m):
        whitened[i] = y[used[i]] - expected[i]
    forward_solve(factor, whitened)
    nis = 0.0
    for k in range(m):
        nis += whitened[k] * whitened[k]
    gained = np.zeros(cross.shape[0])
    for i in range(cross.shape[0]):
        forward_solve(factor, cross[i])
        for k in range(m):
            gained[i] += cross[i, k] * whitened[k]
    return gained, nis


def predict_with_points(rule, model, mean, cov, u):
    """``predict`` for rules that carry the covariance."""
    factor = np.empty(cov.shape)
    cholesky(cov, factor)
    points, first_mean, first_cov, other = spread_points(rule, mean, factor)
    values = advance(model, points, u)
    new_mean = weighted_mean(values, first_mean, other)
    new_cov = weighted_cov(values, new_mean, values, new_mean, first_cov, other) + model.process_cov
    symmetrise(new_cov)
    return new_mean, new_cov


@compiled
def foresee_with_factor(rule, model, mean, factor, u):
    """``foresee`` for rules that carry a lower factor of the covariance, (n, n) and what they may have below it."""
    points, first_mean, first_cov, other = spread_points(rule, mean, factor)
    values = observe(model, points, u)
    expected = weighted_mean(values, first_mean, other)
    return expected, point_variances(values, expected, first_cov, other)


def foresee_with_points(rule, model, mean, cov, u):
    """``foresee`` for rules that carry the covariance."""
    factor = np.empty(cov.shape)
    cholesky(cov, factor)
    return foresee_with_factor(rule, model, mean, factor, u)


@compiled
def point_variances(values, mean, first, other):
    """Weighted variance of each row."""
    out = np.empty(mean.size)
    for i in range(mean.size):
        total = 0.0
        for j in range(1, values.shape[1]):
            total += (values[i, j] - mean[i]) ** 2
        out[i] = first * (values[i, 0] - mean[i]) ** 2 + other * total
    return out


def correct_with_points(rule, model, mean, cov, u, y, variances):
    """``correct`` for rules that carry the covariance: the points are drawn anew from the prediction."""
    used = channels_used(variances)
    if used.size == 0:
        return mean.copy(), cov.copy(), 0.0, 0.0
    root = np.empty(cov.shape)
    cholesky(cov, root)
    points, first_mean, first_cov, other = spread_points(rule, mean, root)
    values = rows_of(observe(model, points, u), used)
    expected = weighted_mean(values, first_mean, other)
    spread = weighted_cov(values, expected, values, expected, first_cov, other)
    for i in range(used.size):
        spread[i, i] += variances[used[i]]
    cross = weighted_cov(points, mean, values, expected, first_cov, other)
    factor = np.empty(spread.shape)
    cholesky(spread, factor)
    gained, nis = gain_step(factor, cross, y, expected, used)
    new_cov = cov.copy()
    for i in range(mean.size):
        for j in range(i + 1):
            for k in range(used.size):
                new_cov[i, j] -= cross[i, k] * cross[j, k]
            new_cov[j, i] = new_cov[i, j]
    return mean + gained, new_cov, nis, float(used.size)
