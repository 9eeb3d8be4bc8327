"""The stochastic ensemble Kalman filter: a sample of states stands for the Gaussian. Evensen (1994, 2003)."""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.sigma_points import channels_used, gain_step, rows_of
from vse_gym.inference.linalg import backward_solve, cholesky
from vse_gym.inference.model import advance, attend, heed, observe, recall, remember, report
from vse_gym.inference.particle import diffuse


@compiled
def row_means(values):
    """(rows,)."""
    out = np.empty(values.shape[0])
    for i in range(values.shape[0]):
        total = 0.0
        for j in range(values.shape[1]):
            total += values[i, j]
        out[i] = total / values.shape[1]
    return out


@compiled
def sample_cov(a, a_mean, b, b_mean):
    """Sample cross-covariance of two sets of columns, unbiased: (rows of a, rows of b)."""
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for k in range(b.shape[0]):
            total = 0.0
            for j in range(a.shape[1]):
                total += (a[i, j] - a_mean[i]) * (b[k, j] - b_mean[k])
            out[i, k] = total / (a.shape[1] - 1)
    return out


@compiled
def ensemble_step(held, states, memory, u, y, inflation, rng):
    """Advance every member with its own process noise; draw each towards a reading with its own noise added.

    Burgers, van Leeuwen, Evensen (1998): without perturbed readings the ensemble would become too narrow.

    Args:
        held: ``hold(model)``.
        states: (n, N).
        memory: The model's, (k,).
        u, y: Inputs and reading.
        inflation: Factor on the deviations from the mean after the prediction; 1: none. Anderson, Anderson (1999).
        rng: Where noise is drawn from.

    Returns:
        states, memory, cov (n, n) of the sample, output (7,): vx, vy, yaw rate, ax, ay, NIS, its degrees of freedom.
    """
    model = held.value
    n, size = states.shape
    u = recall(model, memory, heed(model, u, y))
    states = advance(model, states, u)
    diffuse(states, model.process_cov, rng)
    mean = row_means(states)
    for i in range(n):
        for j in range(size):
            states[i, j] = mean[i] + inflation * (states[i, j] - mean[i])
    variances, memory = attend(model, memory, u, y)
    used = channels_used(variances)
    m = used.size
    nis = 0.0
    if m > 0:
        values = rows_of(observe(model, states, u), used)
        expected = row_means(values)
        spread = sample_cov(values, expected, values, expected)
        for k in range(m):
            spread[k, k] += variances[used[k]]
        factor = np.empty((m, m))
        cholesky(spread, factor)
        gain = sample_cov(states, mean, values, expected)
        _, nis = gain_step(factor, gain, y, expected, used)  # leaves Pxz L^-T
        for i in range(n):
            backward_solve(factor, gain[i])
        for k in range(m):
            sigma = math.sqrt(variances[used[k]])
            for j in range(size):
                values[k, j] = y[used[k]] + sigma * rng.standard_normal() - values[k, j]
        for i in range(n):
            for k in range(m):
                for j in range(size):
                    states[i, j] += gain[i, k] * values[k, j]
        mean = row_means(states)
    cov = sample_cov(states, mean, states, mean)
    memory = remember(model, memory, mean, u)
    reported = report(model, mean, u)
    output = np.empty(7)
    for i in range(5):
        output[i] = reported[i]
    output[5], output[6] = nis, float(m)
    return states, memory, cov, output
