"""Measurement noise found on line, by matching the innovations' variance over a window with what is expected of it."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.gate import refuse
from vse_gym.inference.gaussian.recursion import believe, foresee
from vse_gym.inference.gaussian.wrapped import leave_to_inner, to_edit


class InnovationAdaptive(NamedTuple):
    """Another rule that rescales the noise variance R of each channel. Mehra (1972); Mohamed, Schwarz (1999).

    The innovation v of a good filter has the variance H P H^T + R, so the mean of (v^2 - H P H^T)/R over the last
    ``window`` readings is the factor by which R is wrong. It is held within a floor and a cap, is 1 until a window is
    full, and learns nothing from a reading that the gate refuses, of each channel as :class:`Gated` has it.

    The model's memory must be longer by window + 2 numbers per channel: how many readings there have been, the
    window, how often in a row one has been refused.
    """

    rule: Any
    window: int  # readings
    floor: NDArray[np.float64]  # of the factor on each channel's variance, (m,) [-]
    cap: NDArray[np.float64]  # (m,) [-]
    limit: float = math.inf  # largest squared innovation over its variance that passes [-]
    patience: float = 0.0  # a channel refused so often in a row is let through until it agrees again


leave_to_inner(InnovationAdaptive)


def adaptive_memory(channels: int, window: int) -> NDArray[np.float64]:
    """What is to be put behind the memory of a model with so many channels."""
    return np.zeros(channels * (window + 2))


@compiled
def _factor(rule, count, ratios, i):
    """On the variance of channel i, from its window (window,) and how many readings there have been."""
    if count < rule.window:
        total, n = 1.0, 1.0
    else:
        total, n = 0.0, float(rule.window)
        for k in range(rule.window):
            total += ratios[k]
    return min(max(total / n, rule.floor[i]), rule.cap[i])


@believe.register(InnovationAdaptive)
@compiled
def _(rule, model, mean, kept, memory, u, y):
    m, length = y.size, rule.window
    begin = memory.size - m * (length + 2)
    told, own = believe(rule.rule, model, mean, kept, memory[:begin], u, y)
    told, after = to_edit(told, own, memory)
    variances = np.empty(m)
    counts = after[begin : begin + m]
    windows = after[begin + m : begin + m * (length + 1)].reshape(m, length)
    for i in range(m):
        variances[i] = told[i] * _factor(rule, counts[i], windows[i], i)
    expected, spread = foresee(rule.rule, model, mean, kept, u)
    refuse(rule.limit, rule.patience, y, expected, spread, variances, after[begin + m * (length + 1) :])
    for i in range(m):
        if not math.isnan(variances[i]):
            innovation = y[i] - expected[i]
            windows[i, int(counts[i]) % length] = (innovation * innovation - spread[i]) / told[i]
            counts[i] += 1.0
            variances[i] = told[i] * _factor(rule, counts[i], windows[i], i)
    return variances, after
