"""Another rule with measurement variances that a fuzzy controller adapts, channel by channel."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.fuzzy import fuzzy_factor
from vse_gym.inference.gaussian.recursion import believe, foresee
from vse_gym.inference.gaussian.wrapped import leave_to_inner, to_edit


class FuzzyAdaptive(NamedTuple):
    """R_k = U R, with U from how the innovations' actual variance compares with theory's. Wang et al. (2017).

    e is the logarithm of their ratio: a difference would need another scale for every channel. The theoretical
    variance is H P H^T + R with R as at the start, so that e says how far R has to go and not how far it still is.
    The model's memory must be longer by two numbers per channel: the actual variance, negative before the first
    reading, and the last e.
    """

    rule: Any
    adapted: NDArray[np.float64]  # of each channel, 1: its R is adapted, 0: it stays, (m,)
    surface: NDArray[np.float64]  # (7, 7), log10 U over e and its change
    window: float  # readings over which the actual variance is averaged, with exponential weights
    decades: float  # log10 of the ratio at which e is 1 [-]
    change: float  # change of e from reading to reading that counts as 1 [-]


leave_to_inner(FuzzyAdaptive)


@compiled
def channel_factor(rule, innovation, spread, variance, actual, last):
    """One channel's factor U, its actual innovation variance and its e, given those before.

    Args:
        rule: The tunings.
        innovation: Of the reading.
        spread: What the doubt about the state adds to its variance.
        variance: Of the channel, as the model has it at the start.
        actual, last: Actual variance and e after the reading before; a negative variance: there was none.
    """
    theory = spread + variance
    if actual < 0.0:
        actual = theory
    actual += (innovation * innovation - actual) / rule.window
    e = math.log10(max(actual / theory, 1e-12)) / rule.decades
    return fuzzy_factor(rule.surface, e, (e - last) / rule.change), actual, e


@believe.register(FuzzyAdaptive)
@compiled
def _(fuzzy, model, mean, kept, memory, u, y):
    begin = memory.size - 2 * y.size
    told, own = believe(fuzzy.rule, model, mean, kept, memory[:begin], u, y)
    variances, after = to_edit(told, own, memory)
    expected, spread = foresee(fuzzy.rule, model, mean, kept, u)
    for i in range(y.size):
        if fuzzy.adapted[i] > 0.0 and not math.isnan(variances[i]):
            k = begin + 2 * i
            factor, after[k], after[k + 1] = channel_factor(
                fuzzy, y[i] - expected[i], spread[i], variances[i], memory[k], memory[k + 1]
            )
            variances[i] *= factor
    return variances, after
