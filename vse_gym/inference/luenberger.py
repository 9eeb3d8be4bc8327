"""Luenberger's observer of a linear model with two states, seen through two channels."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.linear import matrices, report_linear
from vse_gym.inference.model import attend, heed


class Placed(NamedTuple):
    """Where the poles of the error's dynamics are, and the channels that it is corrected with."""

    first: float  # share of the first state's error that a step leaves [-]
    second: float  # of the second state's
    one: int  # channels
    two: int


@compiled
def placed_gain(F, rows, first, second):
    """The gain K (2, 2) for which errors e' = (I - K H) F e shrink by ``first`` and ``second`` each on its own.

    Two states seen through two channels can be given any dynamics: K = (I - D F^-1) H^-1 with D their diagonal.

    Args:
        F: Of a step, (2, 2).
        rows: H, (2, 2), of full rank.
        first, second: Of the states' errors [-].
    """
    out = np.empty((2, 2))
    per_f = 1 / (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0])
    per_h = 1 / (rows[0, 0] * rows[1, 1] - rows[0, 1] * rows[1, 0])
    left = (1 - first * F[1, 1] * per_f, first * F[0, 1] * per_f)
    right = (second * F[1, 0] * per_f, 1 - second * F[0, 0] * per_f)
    out[0, 0] = (left[0] * rows[1, 1] - left[1] * rows[1, 0]) * per_h
    out[0, 1] = (left[1] * rows[0, 0] - left[0] * rows[0, 1]) * per_h
    out[1, 0] = (right[0] * rows[1, 1] - right[1] * rows[1, 0]) * per_h
    out[1, 1] = (right[1] * rows[0, 0] - right[0] * rows[0, 1]) * per_h
    return out


@compiled
def luenberger_update(constants, belief, u, y):
    """Predict, then correct with the innovations of both channels; a silent one has none. Luenberger (1971).

    Args:
        constants: ``hold((placed, model))``.
        belief: State (2,), the model's memory, and what is reported: vx, vy, yaw rate, ax, ay. One after the other.
        u, y: Inputs and reading.
    """
    placed, model = constants.value
    out = belief.copy()
    c = belief.size - 5
    u = heed(model, u, y)
    _, memory = attend(model, belief[2:c], u, y)
    F, g, H, d = matrices(model, memory, u)
    rows, innovation = np.empty((2, 2)), np.zeros(2)
    predicted = g.copy()
    for i in range(2):
        for j in range(2):
            predicted[i] += F[i, j] * belief[j]
    for i, channel in enumerate((placed.one, placed.two)):
        for j in range(2):
            rows[i, j] = H[channel, j]
        if not math.isnan(y[channel]):
            innovation[i] = y[channel] - d[channel] - rows[i, 0] * predicted[0] - rows[i, 1] * predicted[1]
    gain = placed_gain(F, rows, placed.first, placed.second)
    for i in range(2):
        predicted[i] += gain[i, 0] * innovation[0] + gain[i, 1] * innovation[1]
        out[i] = predicted[i]
    expected = d.copy()
    for i in range(d.size):
        expected[i] += H[i, 0] * predicted[0] + H[i, 1] * predicted[1]
    reported = report_linear(model, predicted, memory, expected)
    for i in range(memory.size):
        out[2 + i] = memory[i]
    for i in range(5):
        out[c + i] = reported[i]
    return out
