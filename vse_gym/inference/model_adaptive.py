"""The particle filter whose transition is an autoregression that adapts: propagate, weigh, resample, learn."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.autoregression import Autoregressions, AutoregressionTuning, adapt, coefficients_used
from vse_gym.inference.model import advance, attend, heed, observe, recall, remember, report
from vse_gym.inference.particle import log_likelihood, systematic
from vse_gym.inference.wavelet import NoiseLevel, listen


class ModelAdaptive(NamedTuple):
    """What does not change during a drive."""

    model: Any
    adaptation: AutoregressionTuning
    physics: bool  # the autoregression is of what the model's prediction leaves over, not of the state itself
    sheet: NDArray[np.float64]  # R_0: variances of the sensors as their data sheet has them, (m,)
    least_noise: float  # R is at least this share of R_0 [-]
    smoothing: float  # of R [-]
    constant: float  # Donoho's, or the printed one
    noise_gain: float  # transition noise over what the autoregression leaves unexplained, variances [-]
    shares: NDArray[np.float64]  # Cauchy share of each channel's likelihood, (m,)
    resample_below: float  # effective sample size over N [-]


class Swarm(NamedTuple):
    """A weighted sample, with what each particle remembers and what all of them have learnt."""

    states: NDArray[np.float64]  # (n, N)
    series: NDArray[np.float64]  # each particle's last samples of the autoregressive series, newest first, (p, n, N)
    weights: NDArray[np.float64]  # (N,), summing to one
    memory: NDArray[np.float64]  # of the model, (k,)
    learnt: Autoregressions
    noise: NoiseLevel


@compiled
def propagate(states, series, base, coefficients, sigmas, rng):
    """Every particle one step on: base (n, N) plus its own autoregression plus noise.

    Returns:
        states (n, N), series (p, n, N).
    """
    p, n, size = series.shape
    after, moved = np.empty_like(series), np.empty_like(states)
    for k in range(1, p):
        after[k] = series[k - 1]
    for i in range(n):
        new = after[0, i]
        for j in range(size):
            new[j] = sigmas[i] * rng.standard_normal()
        for k in range(p):
            a, old = coefficients[i, k], series[k, i]
            for j in range(size):
                new[j] += a * old[j]
        for j in range(size):
            moved[i, j] = base[i, j] + new[j]
    return moved, after


@compiled
def weigh(weights, logs):
    """Weights (N,) times likelihoods given by their logarithms, summing to one, and the sum of their squares."""
    peak = -math.inf
    for j in range(weights.size):
        if weights[j] > 0.0:
            peak = max(peak, logs[j])
    after, total, squares = np.empty(weights.size), 0.0, 0.0
    for j in range(weights.size):
        after[j] = weights[j] * math.exp(min(0.0, logs[j] - peak))
        total += after[j]
    for j in range(weights.size):
        after[j] /= total
        squares += after[j] * after[j]
    return after, squares


@compiled
def weighted_means(values, weights):
    """Of rows (n, N): (n,)."""
    out = np.zeros(values.shape[0])
    for i in range(values.shape[0]):
        total, row = 0.0, values[i]
        for j in range(weights.size):
            total += weights[j] * row[j]
        out[i] = total
    return out


@compiled
def doubt(states, mean, weights, squares, sigmas):
    """Covariance (n, n) of a weighted sample; each particle stands for the noise that it was drawn with, too, so that
    few of them do not look sure.
    """
    n = mean.size
    cov = np.empty((n, n))
    for i in range(n):
        for k in range(i + 1):
            total = 0.0
            for j in range(weights.size):
                total += weights[j] * (states[i, j] - mean[i]) * (states[k, j] - mean[k])
            cov[i, k] = cov[k, i] = total
        cov[i, i] += squares * sigmas[i] * sigmas[i]
    return cov


@compiled
def adaptive_step(fixed, swarm, u, y, rng):
    """One update of the model-adaptive particle filter. Qin, Li, Li, Cao (2014).

    Returns:
        The swarm, cov (n, n), output (6,): vx, vy, yaw rate, ax, ay and the effective sample size.
    """
    model = fixed.model
    states, series, weights, memory, learnt, noise = swarm
    n, size = states.shape
    u = recall(model, memory, heed(model, u, y))
    sigmas = np.empty(n)
    for i in range(n):
        sigmas[i] = math.sqrt(max(model.process_cov[i, i], fixed.noise_gain * learnt.variances[i]))
    base = advance(model, states, u) if fixed.physics else np.zeros((n, size))
    states, series = propagate(states, series, base, coefficients_used(fixed.adaptation, learnt), sigmas, rng)
    noise = listen(noise, y, fixed.smoothing, fixed.constant)
    told, memory = attend(model, memory, u, y)
    variances, heard = told.copy(), False
    for i in range(y.size):
        heard = heard or not math.isnan(variances[i])
        variances[i] += max(fixed.least_noise * fixed.sheet[i], noise.variances[i]) - fixed.sheet[i]
    weights, squares = weigh(weights, log_likelihood(observe(model, states, u), y, variances, fixed.shares))
    mean = weighted_means(states, weights)
    cov = doubt(states, mean, weights, squares, sigmas)
    memory = remember(model, memory, mean, u)
    output = np.empty(6)
    output[:5] = report(model, mean, u)
    output[5] = 1 / squares
    if heard:
        learnt = adapt(fixed.adaptation, learnt, weighted_means(series[0], weights))
    if not 1 / squares >= fixed.resample_below * size:
        picked = systematic(weights, rng.random())
        states, series = states[:, picked], series[:, :, picked]
        weights = np.full(size, 1 / size)
    return Swarm(states, series, weights, memory, learnt, noise), cov, output
