"""Kalman's filter, for models that are linear once the inputs of a step are known. Kalman (1960)."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.gaussian.extended import congruence
from vse_gym.inference.gaussian.gate import refuse
from vse_gym.inference.gaussian.recursion import covariance, itself, keep
from vse_gym.inference.linalg import joseph_scalar
from vse_gym.inference.model import attend, heed


class Kalman(NamedTuple):
    """The exact filter of a linear model, behind a gate on each channel as :class:`Gated` has it."""

    limit: float = math.inf  # largest squared innovation over its variance that passes [-]
    patience: float = 0.0  # a channel refused so often in a row is let through until it agrees again


keep.register(Kalman)(itself)
covariance.register(Kalman)(itself)


@generic
def matrices(model, memory, u):
    """The model under held inputs u, given what it remembers: x' = F x + g, y = H x + d.

    Returns:
        F (n, n), g (n,), H (m, n), d (m,).
    """


@generic
def report_linear(model, mean, memory, expected):
    """As :func:`report`, of a mean (n,), with the reading (m,) that is expected of it."""


@compiled
def kalman_step(rule, model, mean, cov, memory, u, y):
    """Attend, predict, correct; u as :func:`heed` gives it. The last m of ``memory`` count refusals.

    Returns:
        mean (n,), cov (n, n), memory, the reading (m,) expected of them, and the NIS with its degrees of freedom.
    """
    n, m = mean.size, y.size
    begin = memory.size - m
    told, own = attend(model, memory[:begin], u, y)
    variances, after = told.copy(), memory.copy()
    for i in range(begin):
        after[i] = own[i]
    F, g, H, d = matrices(model, own, u)
    predicted = g.copy()
    for i in range(n):
        for j in range(n):
            predicted[i] += F[i, j] * mean[j]
    cov = congruence(F, cov, model.process_cov)
    expected, spread = d.copy(), np.zeros(m)
    for i in range(m):
        for j in range(n):
            expected[i] += H[i, j] * predicted[j]
            for k in range(n):
                spread[i] += H[i, j] * cov[j, k] * H[i, k]
    refuse(rule.limit, rule.patience, y, expected, spread, variances, after[begin:])
    mean = predicted.copy()
    gain, scratch = np.empty(n), np.empty((n, n))
    nis, dof = 0.0, 0.0
    for i in range(m):
        if math.isnan(variances[i]):
            continue
        innovation = y[i] - expected[i]
        for j in range(n):
            innovation -= H[i, j] * (mean[j] - predicted[j])
        total = joseph_scalar(mean, cov, H[i], innovation, variances[i], gain, scratch)
        nis += innovation * innovation / total
        dof += 1.0
    for i in range(m):
        for j in range(n):
            expected[i] += H[i, j] * (mean[j] - predicted[j])
    return mean, cov, after, expected, nis, dof


@compiled
def kalman_update(constants, belief, u, y):
    """As :func:`kalman_step`, for callers in Python; arguments as of ``filter_update``."""
    rule, model = constants.value
    n, c = model.prior_mean.size, belief.size - 7
    b = n + n * n
    out = np.empty(belief.size)
    u = heed(model, u, y)
    mean, cov, memory, expected, out[c + 5], out[c + 6] = kalman_step(
        rule, model, belief[:n], belief[n:b].reshape(n, n), belief[b:c], u, y
    )
    reported = report_linear(model, mean, memory, expected)
    for i in range(n):
        out[i] = mean[i]
        for j in range(n):
            out[n + i * n + j] = cov[i, j]
    for i in range(memory.size):
        out[b + i] = memory[i]
    for i in range(5):
        out[c + i] = reported[i]
    return out


@compiled
def kalman_drive(rule, model, mean, cov, memory, inputs, readings):
    """A whole recorded drive in one call: inputs (T, k) and readings (T, m) to means (T, n) and covs (T, n, n)."""
    steps, n = readings.shape[0], mean.size
    means, covs = np.empty((steps, n)), np.empty((steps, n, n))
    for t in range(steps):
        u = heed(model, inputs[t], readings[t])
        mean, cov, memory, _, _, _ = kalman_step(rule, model, mean, cov, memory, u, readings[t])
        for i in range(n):
            means[t, i] = mean[i]
            for j in range(n):
                covs[t, i, j] = cov[i, j]
    return means, covs
