"""The unscented rule: a centre, and points at either side along each column of the covariance's factor."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian import sigma_points
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


class Unscented(NamedTuple):
    """Push sigma points through. Julier, Uhlmann (1997), in the scaled form of van der Merwe, Wan (2001).

    The default has no negative weight. The points are drawn anew between prediction and correction.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0


@compiled
def unscented_points(rule, mean, factor):
    """Points (n, 2n + 1), the weight of the first in a mean and in a covariance, and the weight of each other."""
    n = mean.size
    scale = rule.alpha * rule.alpha * (n + rule.kappa)  # n + lambda
    points = np.empty((n, 2 * n + 1))
    for i in range(n):
        points[i, 0] = mean[i]
    sigma_points.plus_and_minus(points, 1, mean, factor, math.sqrt(scale))
    first = (scale - n) / scale
    return points, first, first + 1 - rule.alpha * rule.alpha + rule.beta, 0.5 / scale


sigma_points.spread_points.register(Unscented)(unscented_points)
keep.register(Unscented)(itself)
covariance.register(Unscented)(itself)
believe.register(Unscented)(every_channel)
predict.register(Unscented)(sigma_points.predict_with_points)
foresee.register(Unscented)(sigma_points.foresee_with_points)
correct.register(Unscented)(sigma_points.correct_with_points)
