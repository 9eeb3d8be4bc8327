"""The one recursion of all Gaussian filters: predict with the held inputs, ask which channels to believe, correct.

A rule is a NamedTuple of tunings that registers for the generics below. What it carries in place of a covariance is
its own affair: the covariance itself, or a factor of it.
"""

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.model import attend, heed, recall, remember, report


@generic
def keep(rule, cov):
    """What the rule carries of a covariance (n, n): an array (k, n) with a k of its choice."""


@generic
def covariance(rule, kept):
    """The covariance (n, n) that a rule carries as ``kept``."""


@generic
def predict(rule, model, mean, kept, u):
    """The belief one step on: mean (n,), kept (k, n); raises nothing, whatever is not finite stays so."""


@generic
def believe(rule, model, mean, kept, memory, u, y):
    """As :func:`attend`, for a rule that has a say in which channels to believe: the belief is the predicted one."""


@generic
def foresee(rule, model, mean, kept, u):
    """What is expected to be read, (m,), and the variance that the doubt about the state gives it, (m,)."""


@generic
def correct(rule, model, mean, kept, u, y, variances):
    """The belief after reading y (m,); channels whose variance is NaN are left out.

    Returns:
        mean, kept, nis, dof: nis is the squared, normalised length of the innovation over dof channels.
    """


@generic
def learn(rule, model, mean, kept, memory, u, y, variances):
    """The memory after the correction, of a rule that learns from what the corrected belief leaves unexplained."""


@learn.register(object)
def _nothing_learnt(rule, model, mean, kept, memory, u, y, variances):
    return memory


@compiled
def filter_step(rule, model, mean, kept, memory, u, y):
    """Predict, attend, correct, learn; u as :func:`recall` gives it.

    Returns:
        mean (n,), kept (k, n), memory, and the NIS with its degrees of freedom.
    """
    mean, kept = predict(rule, model, mean, kept, u)
    variances, memory = believe(rule, model, mean, kept, memory, u, y)
    mean, kept, nis, dof = correct(rule, model, mean, kept, u, y, variances)
    memory = learn(rule, model, mean, kept, memory, u, y, variances)
    return mean, kept, remember(model, memory, mean, u), nis, dof


@compiled
def filter_update(constants, belief, u, y):
    """As :func:`filter_step`, for callers in Python: constants held, and one flat belief instead of four arrays.

    Args:
        constants: ``hold((rule, model))``.
        belief: mean, kept row by row, memory; then what is reported: vx, vy, yaw rate, ax, ay, NIS, its degrees of
            freedom. One after the other.
        u, y: Inputs and reading.
    """
    rule, model = constants.value
    n, c = model.prior_mean.size, belief.size - 7
    b = c - model.memory.size
    rows = (b - n) // n
    out = np.empty(belief.size)
    parts = belief[:n], belief[n:b].reshape(rows, n), belief[b:c]
    u = recall(model, parts[2], heed(model, u, y))
    mean, kept, memory, out[c + 5], out[c + 6] = filter_step(rule, model, *parts, u, y)
    reported = report(model, mean, u)
    for i in range(n):  # loops: an assignment of slices costs 30 ns each, and 5 s of compiling
        out[i] = mean[i]
    for i in range(rows):
        for j in range(n):
            out[n + i * n + j] = kept[i, j]
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
    kept = keep(rule, cov)
    for t in range(steps):
        u = recall(model, memory, heed(model, inputs[t], readings[t]))
        mean, kept, memory, _, _ = filter_step(rule, model, mean, kept, memory, u, readings[t])
        cov = covariance(rule, kept)
        for i in range(n):
            means[t, i] = mean[i]
            for j in range(n):
                covs[t, i, j] = cov[i, j]
    return means, covs


def itself(rule, cov):
    """For rules that carry the covariance as it is."""
    return cov


def every_channel(rule, model, mean, kept, memory, u, y):
    """For rules that believe what the model says."""
    return attend(model, memory, u, y)
