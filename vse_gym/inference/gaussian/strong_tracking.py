"""The strong tracking rule: where innovations are larger than they should be, the past is made to fade."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.extended import Extended, jacobian, stencil
from vse_gym.inference.gaussian.recursion import (
    believe,
    correct,
    covariance,
    every_channel,
    foresee,
    keep,
    predict,
)
from vse_gym.inference.model import observe


class StrongTracking(NamedTuple):
    """The extended rule with fading factors that keep the innovations orthogonal. Zhou, Frank (1996).

    Before a correction the predicted covariance F P F^T + Q becomes L F P F^T L + Q with L^2 = diag(lambda):
    lambda_i = max(1, a_i c), c = tr N/sum of a_i M_ii, N = V - H Q H^T - beta R and M = F P F^T H^T H. V is the fading
    mean of v v^T, V <- (rho V + v v^T)/(1 + rho), of which a trace asks for the diagonal alone. With alike a_i there is
    one factor for all states.

    Not in the paper: a state fades no further than to ``largest`` times its variance at the start. What no heard
    channel tells of would fade at every reading anew, and then be made to explain what others have caused.

    Carries the covariance (n, n); below it a row of the last factors, and V from there on, -1 where nothing was heard.
    """

    forgetting: float  # rho
    weakening: float  # beta: larger, and it fades later
    shares: NDArray[np.float64]  # a_i: which states change rather than others, (n,)
    watched: NDArray[np.float64]  # 1: innovations of this channel tell a change, 0: they do not, (m,)
    whitened: float  # 1: each channel in units of its own noise; 0: as printed, a sum of different units
    largest: float = math.inf  # variance that fading gives a state at most, over its prior's; inf: as printed
    extended: Extended = Extended()


@keep.register(StrongTracking)
@compiled
def _(rule, cov):
    n, m = cov.shape[0], rule.watched.size
    kept = np.full((n + 1 + (m + n - 1) // n, n), -1.0)
    for i in range(n):
        kept[n, i] = 1.0
        for j in range(n):
            kept[i, j] = cov[i, j]
    return kept


@covariance.register(StrongTracking)
@compiled
def _(rule, kept):
    return kept[: kept.shape[1]]


def fading_factors(kept):
    """Those of the last correction, (n,); 1: nothing faded."""
    return kept[kept.shape[1]]


@compiled
def _with_covariance(kept, cov):
    out = kept.copy()
    for i in range(cov.shape[0]):
        for j in range(cov.shape[0]):
            out[i, j] = cov[i, j]
    return out


@compiled
def fade(rule, kept, prior_cov, process_cov, rows, innovations, variances):
    """``kept`` with its covariance faded and the innovations counted in; a channel with variance NaN is left out.

    Args:
        rule: The tunings.
        kept: With the predicted covariance.
        prior_cov: Of the state at the start, (n, n).
        process_cov: Q (n, n), which does not fade.
        rows: H (m, n).
        innovations: v (m,).
        variances: Diagonal of R, (m,).
    """
    n = rows.shape[1]
    out = kept.copy()
    held = np.empty((n, n))  # F P F^T
    for i in range(n):
        for j in range(n):
            held[i, j] = kept[i, j] - process_cov[i, j]
    excess, reach = 0.0, np.zeros(n)  # tr N, and the diagonal of M
    for k in range(innovations.size):
        if math.isnan(variances[k]):
            continue
        at = n + 1 + k // n, k % n
        square = innovations[k] * innovations[k]
        if kept[at] >= 0.0:
            square = (rule.forgetting * kept[at] + square) / (1 + rule.forgetting)
        out[at] = square
        unit = rule.watched[k] / (variances[k] if rule.whitened else 1.0)
        expected = rule.weakening * variances[k]
        for i in range(n):
            for j in range(n):
                expected += rows[k, i] * process_cov[i, j] * rows[k, j]
                reach[i] += unit * rows[k, i] * held[i, j] * rows[k, j]
        excess += unit * (square - expected)
    total = 0.0
    for i in range(n):
        total += rule.shares[i] * reach[i]
    for i in range(n):
        fades = excess > 0.0 and total > 0.0
        out[n, i] = max(1.0, rule.shares[i] * excess / total) if fades else 1.0
        limit = rule.largest * prior_cov[i, i]
        if out[n, i] * held[i, i] > limit:
            out[n, i] = max(1.0, limit / held[i, i])
    for i in range(n):
        for j in range(n):
            out[i, j] += (math.sqrt(out[n, i] * out[n, j]) - 1) * held[i, j]
    return out


@predict.register(StrongTracking)
@compiled
def _(rule, model, mean, kept, u):
    mean, cov = predict(rule.extended, model, mean, kept[: mean.size], u)
    return mean, _with_covariance(kept, cov)


@foresee.register(StrongTracking)
@compiled
def _(rule, model, mean, kept, u):
    return foresee(rule.extended, model, mean, kept[: mean.size], u)


@correct.register(StrongTracking)
@compiled
def _(rule, model, mean, kept, u, y, variances):
    columns = stencil(mean, rule.extended.step)
    values = observe(model, columns, u)
    rows = jacobian(columns, values)
    faded = fade(rule, kept, model.prior_cov, model.process_cov, rows, y - values[:, 0], variances)
    mean, cov, nis, dof = correct(rule.extended, model, mean, faded[: mean.size], u, y, variances)
    return mean, _with_covariance(faded, cov), nis, dof


believe.register(StrongTracking)(every_channel)
