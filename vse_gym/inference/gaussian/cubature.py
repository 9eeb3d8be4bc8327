"""The cubature rule: points at either side along each column of the covariance's factor, and no centre."""

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


class Cubature(NamedTuple):
    """Integrate over the Gaussian by the cubature rule of degree three. Arasaratnam, Haykin (2009).

    2n points, all of weight 1/(2n), drawn anew between prediction and correction as the paper has it.
    """


@compiled
def cubature_points(rule, mean, factor):
    """Points (n, 2n); the first is weighted like every other."""
    n = mean.size
    points = np.empty((n, 2 * n))
    sigma_points.plus_and_minus(points, 0, mean, factor, math.sqrt(n))
    weight = 0.5 / n
    return points, weight, weight, weight


sigma_points.spread_points.register(Cubature)(cubature_points)
keep.register(Cubature)(itself)
covariance.register(Cubature)(itself)
believe.register(Cubature)(every_channel)
predict.register(Cubature)(sigma_points.predict_with_points)
foresee.register(Cubature)(sigma_points.foresee_with_points)
correct.register(Cubature)(sigma_points.correct_with_points)
