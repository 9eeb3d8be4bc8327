"""Noise levels found on line: what is left of a reading after the correction says how noisy its channel is."""

import math
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.gaussian.cubature import Cubature
from vse_gym.inference.gaussian.recursion import believe, foresee, learn
from vse_gym.inference.gaussian.sigma_points import spread_points
from vse_gym.inference.gaussian.wrapped import leave_to_inner, to_edit


class SageHusa(NamedTuple):
    """Another rule whose reading noise R adapts, channel by channel: Sage, Husa (1969), with fading memory.

    R <- (1 - d) R + d (e^2 + C), d = (1 - b)/(1 - b^(k + 1)), after each reading: e is what is left of it, C the
    doubt that is left about it. That sum is positive, as the form with the innovation's covariance need not be. The
    process noise stays as it is: both at once could explain anything. What is adapted is the factor on the variance
    that the model gives; a channel that is not believed keeps its own.

    The model's memory must be longer by two numbers per channel, as of :func:`untaught`.
    """

    rule: Any = Cubature()
    forgetting: float = 0.98  # b [-]
    floor: float = 0.1  # least factor [-]
    cap: float = 10.0  # greatest factor [-]
    limit: float = 9.0  # e^2/(R + C) beyond which a reading teaches nothing [-]


def untaught(rule: SageHusa, channels: int, readings: float) -> Any:
    """The memory at the start, (2 channels,): factors, and b^k with ``readings`` for k, as if so many had agreed."""
    return np.repeat([1.0, rule.forgetting**readings], channels)


leave_to_inner(SageHusa)


@spread_points.register(SageHusa)
def _inner_points(adaptive, mean, factor):
    return spread_points(adaptive.rule, mean, factor)


@believe.register(SageHusa)
@compiled
def _(adaptive, model, mean, kept, memory, u, y):
    begin = memory.size - 2 * y.size
    told, own = believe(adaptive.rule, model, mean, kept, memory[:begin], u, y)
    variances, after = to_edit(told, own, memory)
    for i in range(y.size):
        variances[i] *= memory[begin + i]
    return variances, after


@generic
def learn_from(rule, memory, y, expected, spread, variances):
    """The memory after a reading (m,) of which a belief is left that expects (m,) with variances ``spread`` (m,)."""


@learn_from.register(object)
def _nothing_to_learn(rule, memory, y, expected, spread, variances):
    return memory


@learn_from.register(SageHusa)
@compiled
def _(adaptive, memory, y, expected, spread, variances):
    after, b, begin = memory.copy(), adaptive.forgetting, memory.size - 2 * y.size
    for i in range(y.size):
        if math.isnan(variances[i]):
            continue
        left = (y[i] - expected[i]) ** 2
        if not left <= adaptive.limit * (variances[i] + spread[i]):
            continue
        factor, faded = memory[begin + i], b * memory[begin + y.size + i]
        d = (1 - b) / (1 - faded)
        found = (1 - d) * factor + d * factor * (left + spread[i]) / variances[i]
        after[begin + i] = max(adaptive.floor, min(adaptive.cap, found))
        after[begin + y.size + i] = faded
    return after


@learn.register(SageHusa)
@compiled
def _(adaptive, model, mean, kept, memory, u, y, variances):
    expected, spread = foresee(adaptive.rule, model, mean, kept, u)
    return learn_from(adaptive, memory, y, expected, spread, variances)
