"""A Gaussian filter inside which recursive least squares finds parameters of its model."""

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.gaussian.recursion import filter_step
from vse_gym.inference.least_squares import least_squares_step
from vse_gym.inference.model import heed, recall, report


@generic
def regress(model, mean, memory, u, y):
    """What a reading says of the parameters, given the belief's mean after the reading before.

    Returns:
        rows (r, p), targets (r,), variances (r,): of the regression, NaN targets where nothing can be learnt.
        heard: What the filter hears of the reading, (m,).
        memory: Of the model, one step on.
    """


@generic
def instruct(model, u, parameters):
    """The inputs (k,), as :func:`heed` gives them, with the parameters (p,) put in, in place."""


@compiled
def identify_update(constants, belief, u, y):
    """Learn the parameters, then predict and correct with them: one update, for callers in Python.

    The parameters come from the belief *before* the reading: the one after it has been bent towards the reading by
    the very parameters in question, and would confirm them. The reading is still used twice, since it corrects the
    state with what it has just taught, and the state's covariance does not know that. Learning after the correction
    would use it once, but with parameters a step older: where a short memory follows the tyres, that costs more.

    Args:
        constants: ``hold((rule, model, least squares))``.
        belief: mean, kept row by row, memory, parameters, their covariance row by row; then what is reported: vx, vy,
            yaw rate, ax, ay, NIS, its degrees of freedom. One after the other.
        u, y: Inputs and reading.
    """
    rule, model, squares = constants.value
    n, p, c = model.prior_mean.size, squares.lower.size, belief.size - 7
    q = c - p - p * p
    b = q - model.memory.size
    rows = (b - n) // n
    out = np.empty(belief.size)
    mean, kept, memory = belief[:n], belief[n:b].reshape(rows, n), belief[b:q]
    u = recall(model, memory, heed(model, u, y))
    regressors, targets, variances, heard, memory = regress(model, mean, memory, u, y)
    parameters, cov = least_squares_step(
        squares, belief[q : q + p], belief[q + p : c].reshape(p, p), regressors, targets, variances
    )
    instruct(model, u, parameters)
    mean, kept, memory, out[c + 5], out[c + 6] = filter_step(rule, model, mean, kept, memory, u, heard)
    reported = report(model, mean, u)
    for i in range(n):
        out[i] = mean[i]
    for i in range(rows):
        for j in range(n):
            out[n + i * n + j] = kept[i, j]
    for i in range(memory.size):
        out[b + i] = memory[i]
    for i in range(p):
        out[q + i] = parameters[i]
        for j in range(p):
            out[q + p + i * p + j] = cov[i, j]
    for i in range(5):
        out[c + i] = reported[i]
    return out
