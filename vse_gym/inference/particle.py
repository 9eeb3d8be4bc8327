"""The bootstrap particle filter: propagate, weigh, resample.

States lie as columns, (n, N), so that each loop runs over contiguous memory; random numbers come from the Generator
that is handed in.
"""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.linalg import cholesky
from vse_gym.inference.model import advance, attend, heed, observe, recall, remember, report


@compiled
def systematic(weights, u):
    """Indices (N,) of systematic resampling: each particle copied floor or ceil of N w times. Kitagawa (1996).

    Args:
        weights: (N,), summing to one.
        u: One uniform draw in [0, 1).
    """
    size = weights.size
    picked = np.empty(size, np.int64)
    reached, k = weights[0], 0
    for i in range(size):
        at = (i + u) / size
        while reached <= at and k < size - 1:  # the last index is clipped: weights may sum to 1 - 1e-16
            k += 1
            reached += weights[k]
        picked[i] = k
    return picked


@compiled
def diffuse(states, cov, rng):
    """Add noise of covariance cov (n, n) to every column of states (n, N), in place."""
    n = states.shape[0]
    factor = np.empty((n, n))
    cholesky(cov, factor)
    draws = np.empty(n)
    for j in range(states.shape[1]):
        for i in range(n):
            draws[i] = rng.standard_normal()
            for k in range(i + 1):
                states[i, j] += factor[i, k] * draws[k]


@compiled
def draw(mean, cov, size, rng):
    """``size`` columns from a normal distribution, (n, size)."""
    states = np.empty((mean.size, size))
    for i in range(mean.size):
        states[i, :] = mean[i]
    diffuse(states, cov, rng)
    return states


@compiled
def cauchy_gaussian_density(z, share):
    """Density, times the core's sigma and sqrt(2 pi), of z sigmas under (1 - share) Gauss + share Cauchy.

    The mixture of Qin et al. (2014): both parts have scale gamma, and the Gaussian part has variance 2 gamma^2, so the
    Cauchy part's scale is the core's sigma over sqrt 2. A share of 0 is the Gaussian.
    """
    return (1 - share) * math.exp(-0.5 * z * z) + share * 2 / math.sqrt(math.pi) / (1 + 2 * z * z)


@compiled
def log_likelihood(expected, y, variances, share):
    """Log density (N,) of reading y (m,) where (m, N) is expected, up to a constant; NaN variances add nothing.

    ``share`` is the Cauchy share of every channel, or one for each (m,).
    """
    size = expected.shape[1]
    total, shares = np.zeros(size), np.zeros(y.size) + share
    for i in range(y.size):
        if math.isnan(variances[i]):
            continue
        precision = 1 / math.sqrt(variances[i])
        row = expected[i]
        if shares[i] == 0.0:
            for j in range(size):
                z = (y[i] - row[j]) * precision
                total[j] -= 0.5 * z * z
        else:
            for j in range(size):
                total[j] += math.log(cauchy_gaussian_density((y[i] - row[j]) * precision, shares[i]))
    return total


@compiled
def bootstrap_step(model, states, weights, memory, u, y, share, resample_below, rng):
    """Propose from the model, weigh by the likelihood, resample when few particles carry the weight.

    Gordon, Salmond, Smith (1993). ``share`` is the Cauchy share of the likelihood (0: Gaussian), of all channels
    or one each (m,); resampling happens when the effective sample size falls below ``resample_below`` N.

    Returns:
        states (n, N), weights (N,) summing to one, memory, cov (n, n), positive definite,
        output (6,): vx, vy, yaw rate, ax, ay and the effective sample size.
    """
    n, size = states.shape
    u = recall(model, memory, heed(model, u, y))
    states = advance(model, states, u)
    diffuse(states, model.process_cov, rng)
    variances, memory = attend(model, memory, u, y)
    logs = log_likelihood(observe(model, states, u), y, variances, share)
    peak = -math.inf
    for j in range(size):
        if weights[j] > 0.0:  # one without weight, right beside the reading, would make all others underflow
            peak = max(peak, logs[j])
    after = np.empty(size)
    total = 0.0
    for j in range(size):
        after[j] = weights[j] * math.exp(min(0.0, logs[j] - peak))
        total += after[j]
    mean = np.zeros(n)
    squares = 0.0
    for j in range(size):
        after[j] /= total
        squares += after[j] * after[j]
        if after[j] == 0.0:  # it may have left the range of floats, and 0 times infinity would spoil the sums
            states[:, j] = 0.0
    for i in range(n):
        row = states[i]
        value = 0.0
        for j in range(size):
            value += after[j] * row[j]
        mean[i] = value
    cov = np.empty((n, n))
    for i in range(n):
        for k in range(i + 1):
            value = 0.0
            for j in range(size):
                value += after[j] * (states[i, j] - mean[i]) * (states[k, j] - mean[k])
            if squares * 2 * n > 1:
                # So few particles carry the weight that their sample has hardly any rank, and none if one carries it
                # all: each stands for the noise that it was drawn with, too.
                value += squares * model.process_cov[i, k]
            cov[i, k] = cov[k, i] = value
    memory = remember(model, memory, mean, u)
    output = np.empty(6)
    output[:5] = report(model, mean, u)
    output[5] = 1 / squares
    if not 1 / squares >= resample_below * size:
        picked = systematic(after, rng.random())
        states = states[:, picked]
        after[:] = 1 / size
    return states, after, memory, cov, output
