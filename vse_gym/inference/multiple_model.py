"""The interacting multiple model filter: a Gaussian filter for each mode of a system that jumps between modes.

A mode is a model. All are of one type and differ in their parameters alone, and what one step adds to the state, the
channels used and the memory are asked of the first, so that all of them are judged by the same readings.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian import correct, covariance, foresee, keep, predict
from vse_gym.inference.gaussian.gate import refuse
from vse_gym.inference.linalg import cholesky
from vse_gym.inference.model import attend, heed, recall, remember, report


class Interacting(NamedTuple):
    """Mix the beliefs of M modes before every step, weigh them after it. Blom, Bar-Shalom (1988).

    The rule must be one whose NIS is that of Gaussian noise. The gate on each channel is one for all modes, for modes
    that heard different channels could not be weighed; it judges by what all of them together expect. The models'
    memory must be longer by one number per channel, as of :class:`Gated`.
    """

    rule: Any  # how a Gaussian passes through a function, one of inference.gaussian
    transition: NDArray[np.float64]  # row i: probabilities of the modes one step after mode i, (M, M)
    limit: float = math.inf  # largest squared innovation over its variance that passes [-]
    patience: float = 0.0  # a channel refused so often in a row is let through until it agrees again


@compiled
def moments(weights, means, covs):
    """Mean (n,) and covariance (n, n) of a mixture of Gaussians: the laws of total expectation and variance.

    Args:
        weights: (M,), summing to one.
        means, covs: (M, n) and (M, n, n).
    """
    modes, n = means.shape
    mean, cov = np.zeros(n), np.zeros((n, n))
    for k in range(modes):
        for i in range(n):
            mean[i] += weights[k] * means[k, i]
    for k in range(modes):
        for i in range(n):
            apart = means[k, i] - mean[i]
            for j in range(i + 1):
                cov[i, j] += weights[k] * (covs[k, i, j] + apart * (means[k, j] - mean[j]))
    for i in range(n):
        for j in range(i):
            cov[j, i] = cov[i, j]
    return mean, cov


@compiled
def put(into_mean, into_cov, mean, cov):
    """Copy a belief into another's arrays; loops, since an assignment of slices takes seconds to compile."""
    for i in range(mean.size):
        into_mean[i] = mean[i]
        for j in range(mean.size):
            into_cov[i, j] = cov[i, j]


@compiled
def interact(transition, probabilities, means, covs):
    """What every mode starts from: the mixture of all beliefs, each weighed with how likely it led there.

    Returns:
        The modes' probabilities one step on (M,), means (M, n), covs (M, n, n). A mode that nothing leads to keeps its
        belief.
    """
    modes = probabilities.size
    predicted = np.zeros(modes)
    for i in range(modes):
        for j in range(modes):
            predicted[j] += transition[i, j] * probabilities[i]
    mixed_means, mixed_covs = means.copy(), covs.copy()
    weights = np.empty(modes)
    for j in range(modes):
        if not predicted[j] > 0.0:
            continue
        for i in range(modes):
            weights[i] = transition[i, j] * probabilities[i] / predicted[j]
        mean, cov = moments(weights, means, covs)
        put(mixed_means[j], mixed_covs[j], mean, cov)
    return predicted, mixed_means, mixed_covs


@compiled
def reweigh(probabilities, logs):
    """Bayes' rule: probabilities (M,) after readings of log likelihoods (M,), which may lack a common constant."""
    peak, total = -math.inf, 0.0
    for j in range(logs.size):
        if probabilities[j] > 0.0:  # an impossible mode beside the reading would make all others underflow
            peak = max(peak, logs[j])
    out = np.zeros(logs.size)
    for j in range(logs.size):
        if probabilities[j] > 0.0:
            out[j] = probabilities[j] * math.exp(logs[j] - peak)
            total += out[j]
    return out / total if total > 0.0 else probabilities.copy()  # likelihoods that are no numbers say nothing


@compiled
def expect(filter, models, probabilities, means, kept, u):
    """What all modes together expect to be read (m,), and the variance of their doubt (m,).

    A mixture's, taken in one mode after the other: Welford (1962). ``kept`` holds what the rule carries of each.
    """
    expected, spread = foresee(filter.rule, models[0], means[0], kept[0], u)
    weight = probabilities[0]
    for j in range(1, probabilities.size):
        model = models[j]
        other, own = foresee(filter.rule, model, means[j], kept[j], u)
        weight += probabilities[j]
        share = probabilities[j] / weight if weight > 0.0 else 1.0
        for i in range(expected.size):
            apart = other[i] - expected[i]
            expected[i] += share * apart
            spread[i] += share * (own[i] - spread[i] + (1 - share) * apart * apart)
    return expected, spread


@compiled
def log_determinant(cov):
    """Of a positive definite matrix (n, n)."""
    factor, total = np.empty(cov.shape), 0.0
    cholesky(cov, factor)
    for i in range(cov.shape[0]):
        total += math.log(factor[i, i])
    return 2 * total


@compiled
def multiple_model_step(filter, models, probabilities, means, covs, memory, u, y):
    """Mix, predict and correct each mode, weigh the modes; u as :func:`recall` gives it.

    The likelihood of a reading needs the determinant of its covariance S. It follows from what each rule gives anyway:
    |S| = |R| |P-|/|P+|, with the same R for all modes. That is exact for a rule that linearises; with sigma points it
    leaves out what the curvature of h adds to S.

    Returns:
        probabilities (M,), means (M, n), covs (M, n, n), memory, the modes' mean NIS and its degrees of freedom.
    """
    modes, begin = probabilities.size, memory.size - y.size
    probabilities, means, covs = interact(filter.transition, probabilities, means, covs)
    told, own = attend(models[0], memory[:begin], u, y)
    variances, memory = told.copy(), memory.copy()
    for i in range(begin):
        memory[i] = own[i]
    first = keep(filter.rule, covs[0])
    carried = np.empty((modes, first.shape[0], first.shape[1]))
    for j in range(modes):
        model = models[j]
        mean, kept = predict(filter.rule, model, means[j], keep(filter.rule, covs[j]), u)
        for i in range(mean.size):
            means[j, i] = mean[i]
        for i in range(kept.shape[0]):
            for k in range(kept.shape[1]):
                carried[j, i, k] = kept[i, k]
    if filter.limit < math.inf:
        expected, spread = expect(filter, models, probabilities, means, carried, u)
        refuse(filter.limit, filter.patience, y, expected, spread, variances, memory[begin:])
    logs, squares, dof = np.empty(modes), np.empty(modes), 0.0
    for j in range(modes):
        model = models[j]
        before = covariance(filter.rule, carried[j])
        mean, kept, squares[j], dof = correct(filter.rule, model, means[j], carried[j], u, y, variances)
        after = covariance(filter.rule, kept)
        logs[j] = 0.5 * (log_determinant(after) - log_determinant(before) - squares[j]) if dof > 0.0 else 0.0
        put(means[j], covs[j], mean, after)
    probabilities = reweigh(probabilities, logs)
    nis = 0.0
    for j in range(probabilities.size):
        nis += probabilities[j] * squares[j]
    return probabilities, means, covs, memory, nis, dof


@compiled
def multiple_model_update(constants, probabilities, means, covs, memory, u, y):
    """As :func:`multiple_model_step`, for callers in Python.

    Args:
        constants: ``hold((filter, models))``.
        probabilities, means, covs, memory: Of the modes, and of what they remember; the last m count refusals.
        u, y: Inputs and reading.

    Returns:
        probabilities, means, covs, memory, output (7,): vx, vy, yaw rate, ax, ay, NIS, its degrees of freedom.
    """
    filter, models = constants.value
    u = recall(models[0], memory, heed(models[0], u, y))
    output, mean = np.zeros(7), np.zeros(means.shape[1])
    probabilities, means, covs, memory, output[5], output[6] = multiple_model_step(
        filter, models, probabilities, means, covs, memory, u, y
    )
    for j in range(probabilities.size):
        model = models[j]
        reported = report(model, means[j], u)
        for i in range(5):
            output[i] += probabilities[j] * reported[i]
        for i in range(mean.size):
            mean[i] += probabilities[j] * means[j, i]
    memory = remember(models[0], memory, mean, u)
    return probabilities, means, covs, memory, output
