"""The extended rule for heavy-tailed noise: a reading far from what is expected moves the belief less, not more."""

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
    itself,
    keep,
    predict,
)
from vse_gym.inference.model import observe


class HeavyTailed(NamedTuple):
    """Linearise about the mean; each channel's noise is a mixture of Gaussians about zero.

    After each channel the belief is the Gaussian with the mean and the covariance of the mixture that is exact for it:
    Masreliez (1975), with the score of a mixture as Sorenson, Alspach (1971) give it.
    """

    weights: NDArray[np.float64]  # of each channel's parts, (m, c)
    scales: NDArray[np.float64]  # variance of a part over what the model says of the channel, (c,)
    extended: Extended = Extended()


RUNGS = 16  # Gaussians that stand for the Cauchy law, each twice as wide as the one before


def cauchy_rungs() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights and variances (RUNGS,) of Gaussians whose mixture is the Cauchy law of scale 1 to 4 % of its density.

    A Cauchy variate is a normal one of variance 1/c, with c from the chi-square law of one degree of freedom: a rung
    has the probability that this variance lies within a factor of two of its own, and the outer ones what is beyond.
    From some ten thousand times the scale on, where the last one ends, tails are Gaussian.
    """
    variances = np.array([4.0**k for k in range(-2, RUNGS - 2)])
    beyond = [math.erf(math.sqrt(0.5 / (2 * v))) for v in variances[:-1]]  # P(1/c > 2 v)
    at_least = np.array([1.0, *beyond, 0.0])
    return at_least[:-1] - at_least[1:], variances


@compiled
def score(innovation, believed, variance, weights, scales):
    """Derivatives of the log density p of an innovation v under the mixture.

    Args:
        innovation: v.
        believed: What the doubt about the state adds to the variance of every part.
        variance: Of the channel, as the model has it.
        weights, scales: Of the parts, (c,).

    Returns:
        g, G: -d/dv log p over v, and -d2/dv2 log p. For one Gaussian both are 1/(believed + variance).
    """
    peak = -math.inf  # twice the log of the likeliest part, taken off so that not all of them underflow
    for c in range(scales.size):
        if weights[c] > 0.0:
            spread = believed + variance * scales[c]
            peak = max(peak, math.log(weights[c] * weights[c] / spread) - innovation * innovation / spread)
    total, first, second = 0.0, 0.0, 0.0
    for c in range(scales.size):
        if weights[c] > 0.0:
            per = 1 / (believed + variance * scales[c])
            part = weights[c] * math.sqrt(per) * math.exp(-0.5 * (innovation * innovation * per + peak))
            total += part
            first += part * per
            second += part * per * per
    g = first / total
    return g, g - innovation * innovation * (second / total - g * g)


keep.register(HeavyTailed)(itself)
covariance.register(HeavyTailed)(itself)
believe.register(HeavyTailed)(every_channel)


@predict.register(HeavyTailed)
@compiled
def _(rule, model, mean, cov, u):
    return predict(rule.extended, model, mean, cov, u)


@foresee.register(HeavyTailed)
@compiled
def _(rule, model, mean, cov, u):
    return foresee(rule.extended, model, mean, cov, u)


@correct.register(HeavyTailed)
@compiled
def _(rule, model, mean, cov, u, y, variances):
    columns = stencil(mean, rule.extended.step)
    values = observe(model, columns, u)
    rows = jacobian(columns, values)
    n = mean.size
    new_mean, new_cov = mean.copy(), cov.copy()
    gain = np.empty(n)
    nis, dof = 0.0, 0.0
    for k in range(y.size):
        if math.isnan(variances[k]):
            continue
        innovation, believed = y[k] - values[k, 0], 0.0
        for i in range(n):
            innovation -= rows[k, i] * (new_mean[i] - mean[i])
            gain[i] = 0.0
            for j in range(n):
                gain[i] += new_cov[i, j] * rows[k, j]
            believed += rows[k, i] * gain[i]
        g, curvature = score(innovation, believed, variances[k], rule.weights[k], rule.scales)
        for i in range(n):
            new_mean[i] += gain[i] * g * innovation
            for j in range(i + 1):
                new_cov[i, j] -= gain[i] * gain[j] * curvature
                new_cov[j, i] = new_cov[i, j]
        nis += innovation * innovation * g  # its mean is 1 for any law of noise, as a Gaussian's is
        dof += 1.0
    return new_mean, new_cov, nis, dof
