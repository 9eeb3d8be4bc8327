"""Gaussian filters: one recursion, and a rule for how a Gaussian passes through a function.

A step is: predict with the held inputs, ask the model which channels to believe (``attend``), correct with those.
Rules differ in the two middle parts only. Nothing is factored or inverted beyond three to ten rows, so all is loops.
"""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.linalg import cholesky, forward_solve, joseph_scalar, symmetrise
from vse_gym.inference.model import advance, attend, heed, observe, report


class Extended(NamedTuple):
    """Linearise about the mean by central differences. Jazwinski (1970)."""

    step: float = 6e-6  # difference step over max(1, |x|): cube root of the rounding error


class Unscented(NamedTuple):
    """Push sigma points through. Julier, Uhlmann (1997), in the scaled form of van der Merwe, Wan (2001).

    The default has no negative weight. The points are drawn anew between prediction and correction.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0


@generic
def predict(rule, model, mean, cov, u):
    """The belief one step on: mean (n,), cov (n, n); raises nothing, whatever is not finite stays so."""


@generic
def correct(rule, model, mean, cov, u, y, variances):
    """The belief after reading y (m,); channels whose variance is NaN are left out.

    Returns:
        mean, cov, nis, dof: nis is the squared, normalised length of the innovation over dof channels.
    """


@compiled
def filter_step(rule, model, mean, cov, memory, u, y):
    """Predict, attend, correct; u as :func:`heed` gives it.

    Returns:
        mean (n,), cov (n, n), memory (k,), and the NIS with its degrees of freedom.
    """
    mean, cov = predict(rule, model, mean, cov, u)
    variances, memory = attend(model, memory, u, y)
    mean, cov, nis, dof = correct(rule, model, mean, cov, u, y, variances)
    return mean, cov, memory, nis, dof


@compiled
def filter_update(constants, belief, u, y):
    """As :func:`filter_step`, for callers in Python: constants held, and one flat belief instead of four arrays.

    Args:
        constants: ``hold((rule, model))``.
        belief: mean, cov row by row, memory; then what is reported: vx, vy, yaw rate, ax, ay, NIS, its degrees of
            freedom. One after the other.
        u, y: Inputs and reading.
    """
    rule, model = constants.value
    n = model.prior_mean.size
    a, b, c = n, n + n * n, n + n * n + model.memory.size
    out = np.empty(belief.size)
    parts = belief[:a], belief[a:b].reshape(n, n), belief[b:c]
    u = heed(model, u, y)
    mean, cov, memory, out[c + 5], out[c + 6] = filter_step(rule, model, *parts, u, y)
    reported = report(model, mean, u)
    for i in range(n):  # loops: an assignment of slices costs 30 ns each
        out[i] = mean[i]
        for j in range(n):
            out[a + i * n + j] = cov[i, j]
    for i in range(memory.size):
        out[b + i] = memory[i]
    for i in range(5):
        out[c + i] = reported[i]
    return out


@compiled
def filter_drive(rule, model, mean, cov, memory, inputs, readings):
    """A whole recorded drive in one call: inputs (T, k) and readings (T, m) to means (T, n) and covs (T, n, n)."""
    steps, n = readings.shape[0], mean.size
    means, covs = np.empty((steps, n)), np.empty((steps, n, n))
    for t in range(steps):
        u = heed(model, inputs[t], readings[t])
        mean, cov, memory, _, _ = filter_step(rule, model, mean, cov, memory, u, readings[t])
        means[t], covs[t] = mean, cov
    return means, covs


# -- extended -------------------------------------------------------------------------------------------------------


@compiled
def _stencil(mean, step):
    """Columns x, then x + h_i e_i and x - h_i e_i: (n, 2n + 1)."""
    n = mean.size
    columns = np.empty((n, 2 * n + 1))
    for i in range(n):
        for j in range(2 * n + 1):
            columns[i, j] = mean[i]
        h = step * max(1.0, abs(mean[i]))
        columns[i, 1 + i] += h
        columns[i, 1 + n + i] -= h
    return columns


@compiled
def _jacobian(columns, values):
    """Central differences (m, n) from a stencil's columns (n, 2n + 1) and their values (m, 2n + 1)."""
    n, m = columns.shape[0], values.shape[0]
    jacobian = np.empty((m, n))
    for j in range(n):
        per_width = 1 / (columns[j, 1 + j] - columns[j, 1 + n + j])
        for i in range(m):
            jacobian[i, j] = (values[i, 1 + j] - values[i, 1 + n + j]) * per_width
    return jacobian


@compiled
def _congruence(f, cov, noise):
    """F P F^T + Q, symmetric, for small matrices."""
    n = cov.shape[0]
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            for j in range(n):
                half[i, j] += f[i, k] * cov[k, j]
    out = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.5 * (noise[i, j] + noise[j, i])
            for k in range(n):
                total += half[i, k] * f[j, k]
            out[i, j] = out[j, i] = total
    return out


@predict.register(Extended)
@compiled
def _(rule, model, mean, cov, u):
    columns = _stencil(mean, rule.step)
    values = advance(model, columns, u)
    return values[:, 0].copy(), _congruence(_jacobian(columns, values), cov, model.process_cov)


@correct.register(Extended)
@compiled
def _(rule, model, mean, cov, u, y, variances):
    # Channels are independent, so they are taken one after the other at one linearisation: exactly the joint update.
    columns = _stencil(mean, rule.step)
    values = observe(model, columns, u)
    jacobian = _jacobian(columns, values)
    n = mean.size
    new_mean, new_cov = mean.copy(), cov.copy()
    gain, scratch = np.empty(n), np.empty((n, n))
    nis, dof = 0.0, 0.0
    for i in range(y.size):
        if math.isnan(variances[i]):
            continue
        innovation = y[i] - values[i, 0]
        for j in range(n):
            innovation -= jacobian[i, j] * (new_mean[j] - mean[j])
        spread = joseph_scalar(new_mean, new_cov, jacobian[i], innovation, variances[i], gain, scratch)
        nis += innovation * innovation / spread
        dof += 1.0
    return new_mean, new_cov, nis, dof


# -- unscented ------------------------------------------------------------------------------------------------------


@compiled
def _sigma_points(rule, mean, cov):
    """Points (n, 2n + 1), the weight of the first in a mean and in a covariance, and the weight of each other."""
    n = mean.size
    scale = rule.alpha * rule.alpha * (n + rule.kappa)  # n + lambda
    factor = np.empty((n, n))
    cholesky(cov, factor)
    points = np.empty((n, 2 * n + 1))
    root = math.sqrt(scale)
    for i in range(n):
        points[i, 0] = mean[i]
        for j in range(n):
            points[i, 1 + j] = mean[i] + root * factor[i, j]
            points[i, 1 + n + j] = mean[i] - root * factor[i, j]
    first = (scale - n) / scale
    return points, first, first + 1 - rule.alpha * rule.alpha + rule.beta, 0.5 / scale


@compiled
def _weighted_mean(values, first, other):
    out = np.empty(values.shape[0])
    for i in range(values.shape[0]):
        total = 0.0
        for j in range(1, values.shape[1]):
            total += values[i, j]
        out[i] = first * values[i, 0] + other * total
    return out


@compiled
def _weighted_cov(a, a_mean, b, b_mean, first, other):
    """Weighted cross-covariance of two sets of columns: (rows of a, rows of b)."""
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for k in range(b.shape[0]):
            total = 0.0
            for j in range(1, a.shape[1]):
                total += (a[i, j] - a_mean[i]) * (b[k, j] - b_mean[k])
            out[i, k] = first * (a[i, 0] - a_mean[i]) * (b[k, 0] - b_mean[k]) + other * total
    return out


@predict.register(Unscented)
@compiled
def _(rule, model, mean, cov, u):
    points, first_mean, first_cov, other = _sigma_points(rule, mean, cov)
    values = advance(model, points, u)
    new_mean = _weighted_mean(values, first_mean, other)
    new_cov = _weighted_cov(values, new_mean, values, new_mean, first_cov, other) + model.process_cov
    symmetrise(new_cov)
    return new_mean, new_cov


@correct.register(Unscented)
@compiled
def _(rule, model, mean, cov, u, y, variances):
    points, first_mean, first_cov, other = _sigma_points(rule, mean, cov)
    all_values = observe(model, points, u)
    used = np.empty(y.size, np.int64)
    count = 0
    for i in range(y.size):
        if not math.isnan(variances[i]):
            used[count] = i
            count += 1
    n = mean.size
    new_mean, new_cov = mean.copy(), cov.copy()
    if count == 0:
        return new_mean, new_cov, 0.0, 0.0
    values = np.empty((count, 2 * n + 1))
    for i in range(count):
        values[i] = all_values[used[i]]
    expected = _weighted_mean(values, first_mean, other)
    spread = _weighted_cov(values, expected, values, expected, first_cov, other)
    for i in range(count):
        spread[i, i] += variances[used[i]]
    cross = _weighted_cov(points, mean, values, expected, first_cov, other)
    factor = np.empty((count, count))
    cholesky(spread, factor)
    # With S = L L^T and W = Pxz L^-T: gain times innovation is W (L^-1 v), and the covariance loses W W^T.
    whitened = np.empty(count)
    for i in range(count):
        whitened[i] = y[used[i]] - expected[i]
    forward_solve(factor, whitened)
    for i in range(n):
        forward_solve(factor, cross[i])
    nis = 0.0
    for k in range(count):
        nis += whitened[k] * whitened[k]
    for i in range(n):
        for k in range(count):
            new_mean[i] += cross[i, k] * whitened[k]
        for j in range(i + 1):
            for k in range(count):
                new_cov[i, j] -= cross[i, k] * cross[j, k]
            new_cov[j, i] = new_cov[i, j]
    return new_mean, new_cov, nis, float(count)
