"""The innovation gate: a channel too far from what is expected is left out, but not for ever."""

import math
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.recursion import believe, foresee, learn
from vse_gym.inference.gaussian.wrapped import leave_to_inner, to_edit


class Gated(NamedTuple):
    """Another rule behind a gate on each channel: Bar-Shalom, Li, Kirubarajan (2001), for one channel at a time.

    The model's memory must be longer by one number per channel: how often in a row it has been refused.
    """

    rule: Any
    limit: float  # largest squared innovation over its variance that passes, a quantile of chi-square [-]
    patience: float  # a channel refused so often in a row is let through until it agrees again


leave_to_inner(Gated)


@compiled
def refuse(limit, patience, y, expected, spread, variances, refused):
    """Make NaN the variances of channels that fail, and count those: variances (m,) and refused (m,), in place.

    A filter sure of a wrong state would refuse every reading that could set it right; so a channel that has been
    refused ``patience`` times in a row is believed until it is within the limit once more.
    """
    for i in range(y.size):
        if math.isnan(variances[i]):
            continue
        innovation = y[i] - expected[i]
        if not innovation * innovation > limit * (spread[i] + variances[i]):
            refused[i] = 0.0
        elif refused[i] < patience:
            refused[i] += 1.0
            variances[i] = np.nan


@believe.register(Gated)
@compiled
def _(gated, model, mean, kept, memory, u, y):
    begin = memory.size - y.size
    told, own = believe(gated.rule, model, mean, kept, memory[:begin], u, y)
    variances, after = to_edit(told, own, memory)
    expected, spread = foresee(gated.rule, model, mean, kept, u)
    refuse(gated.limit, gated.patience, y, expected, spread, variances, after[begin:])
    return variances, after


@learn.register(Gated)
@compiled
def _(gated, model, mean, kept, memory, u, y, variances):
    begin = memory.size - y.size
    after, own = memory.copy(), learn(gated.rule, model, mean, kept, memory[:begin], u, y, variances)
    for i in range(begin):
        after[i] = own[i]
    return after
