"""The square-root unscented rule: carries a factor of the covariance, and never forms or factors the covariance."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.recursion import believe, correct, covariance, every_channel, foresee, keep, predict
from vse_gym.inference.gaussian.sigma_points import (
    channels_used,
    foresee_with_factor,
    gain_step,
    rows_of,
    spread_points,
    weighted_cov,
    weighted_mean,
)
from vse_gym.inference.gaussian.unscented import unscented_points
from vse_gym.inference.linalg import cholesky, product, rank_one, symmetrise, triangularise
from vse_gym.inference.model import advance, observe


class SquareRootUnscented(NamedTuple):
    """The unscented rule on a Cholesky factor, by QR and rank-one updates. Van der Merwe, Wan (2001).

    Carries (n + 1, n): the lower factor, and in the first entry of the row below it how many downdates have failed.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0


def failed_downdates(kept) -> int:
    """How many rank-one downdates lost definiteness, so that the factor was rebuilt from the covariance."""
    return int(kept[-1, 0])


@compiled
def _change(factor, x, sign):
    """Factor of L L^T + sign x x^T in place, x is used up; says how often it had to be rebuilt, 0 or 1."""
    n = x.size
    before, by = factor.copy(), x.copy()
    if rank_one(factor, x, sign):
        return 0.0
    cov = product(before)
    for i in range(n):
        for j in range(n):
            cov[i, j] += sign * by[i] * by[j]
    symmetrise(cov)
    cholesky(cov, factor)
    return 1.0


@compiled
def _factor_of_points(values, mean, first, other, noise):
    """Lower factor of the weighted covariance of columns plus noise noise^T, and how often it had to be rebuilt."""
    n, count = values.shape[0], values.shape[1] - 1
    rows = np.empty((n, count + noise.shape[1]))
    root = math.sqrt(other)
    for i in range(n):
        for j in range(count):
            rows[i, j] = root * (values[i, 1 + j] - mean[i])
        for j in range(noise.shape[1]):
            rows[i, count + j] = noise[i, j]
    factor = triangularise(rows)
    if first == 0.0:
        return factor, 0.0
    centre = np.empty(n)
    for i in range(n):
        centre[i] = math.sqrt(abs(first)) * (values[i, 0] - mean[i])
    return factor, _change(factor, centre, math.copysign(1.0, first))


@keep.register(SquareRootUnscented)
@compiled
def _(rule, cov):
    n = cov.shape[0]
    kept = np.zeros((n + 1, n))
    cholesky(cov, kept[:n])
    return kept


@covariance.register(SquareRootUnscented)
@compiled
def _(rule, kept):
    return product(kept)


@predict.register(SquareRootUnscented)
@compiled
def _(rule, model, mean, kept, u):
    n = mean.size
    points, first_mean, first_cov, other = spread_points(rule, mean, kept)
    values = advance(model, points, u)
    new_mean = weighted_mean(values, first_mean, other)
    noise = np.empty((n, n))
    cholesky(model.process_cov, noise)
    factor, failed = _factor_of_points(values, new_mean, first_cov, other, noise)
    new_kept = kept.copy()
    for i in range(n):
        for j in range(n):
            new_kept[i, j] = factor[i, j]
    new_kept[n, 0] += failed
    return new_mean, new_kept


@correct.register(SquareRootUnscented)
@compiled
def _(rule, model, mean, kept, u, y, variances):
    used = channels_used(variances)
    if used.size == 0:
        return mean.copy(), kept.copy(), 0.0, 0.0
    n = mean.size
    points, first_mean, first_cov, other = spread_points(rule, mean, kept)
    values = rows_of(observe(model, points, u), used)
    expected = weighted_mean(values, first_mean, other)
    noise = np.zeros((used.size, used.size))
    for i in range(used.size):
        noise[i, i] = math.sqrt(variances[used[i]])
    factor, failed = _factor_of_points(values, expected, first_cov, other, noise)
    cross = weighted_cov(points, mean, values, expected, first_cov, other)
    gained, nis = gain_step(factor, cross, y, expected, used)
    new_kept = kept.copy()
    lost = np.empty(n)
    for k in range(used.size):
        for i in range(n):
            lost[i] = cross[i, k]
        failed += _change(new_kept[:n], lost, -1.0)
    new_kept[n, 0] += failed
    return mean + gained, new_kept, nis, float(used.size)


spread_points.register(SquareRootUnscented)(unscented_points)
foresee.register(SquareRootUnscented)(foresee_with_factor)
believe.register(SquareRootUnscented)(every_channel)
