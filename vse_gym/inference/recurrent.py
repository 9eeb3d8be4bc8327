"""A gated recurrent unit and a dense layer on it: Cho et al. (2014), in the form that torch.nn.GRU has."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled

Array = NDArray[np.float64]


class RecurrentNet(NamedTuple):
    """Weights of one layer of H gated units and of O outputs, which are linear in them.

    Columns of three gates stand beside each other: reset, update, new.
    """

    input_weights: Array  # (F, 3 H)
    hidden_weights: Array  # (H, 3 H)
    input_bias: Array  # (3 H,)
    hidden_bias: Array  # (3 H,)
    output_weights: Array  # (H, O)
    output_bias: Array  # (O,)


@compiled
def affine(rows, weights, bias):
    """Rows (B, n) times weights (n, m) plus bias (m,): (B, m)."""
    out = np.empty((rows.shape[0], bias.size))
    for b in range(rows.shape[0]):
        for j in range(bias.size):
            out[b, j] = bias[j]
    for k in range(rows.shape[1]):  # the inner loop along a row of weights, which vectorises as a sum would not
        for b in range(rows.shape[0]):
            factor = rows[b, k]
            for j in range(bias.size):
                out[b, j] += factor * weights[k, j]
    return out


@compiled
def sigmoid(x):
    """The logistic function."""
    return 0.5 + 0.5 * math.tanh(0.5 * x)


@compiled
def gated_step(net, hidden, x):
    """The hidden states (B, H) after inputs x (B, F); each stays within (-1, 1) if it began there."""
    given, recalled = affine(x, net.input_weights, net.input_bias), affine(hidden, net.hidden_weights, net.hidden_bias)
    size = hidden.shape[1]
    out = np.empty_like(hidden)
    for b in range(hidden.shape[0]):
        for j in range(size):
            reset = sigmoid(given[b, j] + recalled[b, j])
            update = sigmoid(given[b, size + j] + recalled[b, size + j])
            new = math.tanh(given[b, 2 * size + j] + reset * recalled[b, 2 * size + j])
            out[b, j] = new + update * (hidden[b, j] - new)
    return out


@compiled
def mirrored_step(net, hidden, x, odd_inputs, odd_outputs):
    """One step of the net on x (F,) and on its mirror image: whatever the weights, odd inputs give odd outputs.

    Args:
        net: Its weights.
        hidden: Of the one and the other, (2, H).
        x: (F,).
        odd_inputs: -1 for what changes its sign in a mirror, else 1, (F,).
        odd_outputs: The same of the outputs, (O,).

    Returns:
        hidden (2, H) and the outputs (O,): the mean of one and the other's mirror image.
    """
    both = np.empty((2, x.size))
    for k in range(x.size):
        both[0, k], both[1, k] = x[k], odd_inputs[k] * x[k]
    hidden = gated_step(net, hidden, both)
    outputs = affine(hidden, net.output_weights, net.output_bias)
    for j in range(odd_outputs.size):
        outputs[0, j] = 0.5 * (outputs[0, j] + odd_outputs[j] * outputs[1, j])
    return hidden, outputs[0].copy()
