"""The extended rule: linearise about the mean."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.recursion import (
    believe,
    correct,
    covariance,
    every_channel,
    foresee,
    itself,
    keep,
    predict,
)
from vse_gym.inference.linalg import joseph_scalar
from vse_gym.inference.model import advance, observe


class Extended(NamedTuple):
    """Linearise about the mean by central differences. Jazwinski (1970)."""

    step: float = 6e-6  # difference step over max(1, |x|): cube root of the rounding error


keep.register(Extended)(itself)
covariance.register(Extended)(itself)
believe.register(Extended)(every_channel)


@compiled
def stencil(mean, step):
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
def jacobian(columns, values):
    """Central differences (m, n) from a stencil's columns (n, 2n + 1) and their values (m, 2n + 1)."""
    n, m = columns.shape[0], values.shape[0]
    out = np.empty((m, n))
    for j in range(n):
        per_width = 1 / (columns[j, 1 + j] - columns[j, 1 + n + j])
        for i in range(m):
            out[i, j] = (values[i, 1 + j] - values[i, 1 + n + j]) * per_width
    return out


@compiled
def congruence(f, cov, noise):
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
    columns = stencil(mean, rule.step)
    values = advance(model, columns, u)
    return values[:, 0].copy(), congruence(jacobian(columns, values), cov, model.process_cov)


@correct.register(Extended)
@compiled
def _(rule, model, mean, cov, u, y, variances):
    # Channels are independent, so they are taken one after the other at one linearisation: exactly the joint update.
    columns = stencil(mean, rule.step)
    values = observe(model, columns, u)
    rows = jacobian(columns, values)
    n = mean.size
    new_mean, new_cov = mean.copy(), cov.copy()
    gain, scratch = np.empty(n), np.empty((n, n))
    nis, dof = 0.0, 0.0
    for i in range(y.size):
        if math.isnan(variances[i]):
            continue
        innovation = y[i] - values[i, 0]
        for j in range(n):
            innovation -= rows[i, j] * (new_mean[j] - mean[j])
        spread = joseph_scalar(new_mean, new_cov, rows[i], innovation, variances[i], gain, scratch)
        nis += innovation * innovation / spread
        dof += 1.0
    return new_mean, new_cov, nis, dof


@foresee.register(Extended)
@compiled
def _(rule, model, mean, cov, u):
    columns = stencil(mean, rule.step)
    values = observe(model, columns, u)
    rows = jacobian(columns, values)
    spread = np.zeros(rows.shape[0])
    for i in range(rows.shape[0]):
        for j in range(mean.size):
            for k in range(mean.size):
                spread[i] += rows[i, j] * cov[j, k] * rows[i, k]
    return values[:, 0].copy(), spread
