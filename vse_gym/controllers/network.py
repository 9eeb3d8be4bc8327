"""A trained agent's net without the library that trained it: full layers, behind an LSTM if it remembers."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.types import Array

ACTIVATIONS = ("tanh", "relu")
SQUASHES = ("clip", "tanh")  # to [-1, 1]: cut off, as of a Gaussian's mean; or by a tanh


class Network(NamedTuple):
    """Weights in one row, so that nets of every depth are of one type and compiled once."""

    sizes: NDArray[np.int64]  # widths of what the layers take, and of the answer
    memory: int  # width of the LSTM in front of them; 0: none
    relu: bool  # else tanh
    tanh: bool  # whether the answer is squashed by one, else it is clipped
    weights: Array  # of the LSTM: on the input (k, 4 h), on the memory (h, 4 h), biases; of a layer: (in, out), biases


@compiled
def _add_product(out, signal, weights, first):
    """Add signal (n,) times the matrix (n, out.size) that begins at ``first``; where the next one begins."""
    for i in range(signal.size):
        for j in range(out.size):
            out[j] += signal[i] * weights[first + i * out.size + j]
    return first + signal.size * out.size


@compiled
def _sigmoid(x):
    return 0.5 * (1.0 + math.tanh(0.5 * x))


@compiled
def answer(network, seen, hidden):
    """The net's answer (m,) in [-1, 1], and what it remembers then.

    Args:
        network: The Network.
        seen: Its input, (k,).
        hidden: Output and cell of the LSTM (Hochreiter & Schmidhuber, 1997), (2 h,), zeros at first.
    """
    after, first = hidden.copy(), 0
    signal = seen.astype(np.float64)
    h = network.memory
    if h > 0:
        gates = np.zeros(4 * h)
        first = _add_product(gates, signal, network.weights, first)
        first = _add_product(gates, hidden[:h], network.weights, first)
        gates += network.weights[first : first + 4 * h]
        first += 4 * h
        for i in range(h):
            take, keep = _sigmoid(gates[i]), _sigmoid(gates[h + i])
            after[h + i] = keep * hidden[h + i] + take * math.tanh(gates[2 * h + i])
            after[i] = _sigmoid(gates[3 * h + i]) * math.tanh(after[h + i])
        signal = after[:h].copy()
    last = network.sizes.size - 2
    for layer in range(last + 1):
        out = np.zeros(network.sizes[layer + 1])
        first = _add_product(out, signal, network.weights, first)
        for j in range(out.size):
            out[j] += network.weights[first + j]
            if layer < last:
                out[j] = max(0.0, out[j]) if network.relu else math.tanh(out[j])
        first += out.size
        signal = out
    for j in range(signal.size):
        signal[j] = math.tanh(signal[j]) if network.tanh else min(1.0, max(-1.0, signal[j]))
    return signal, after


def shapes(inputs: int, sizes: Sequence[int], memory: int) -> dict[str, tuple[int, ...]]:
    """Names and shapes of a net's arrays as torch has them, in the order in which :class:`Network` lays them out.

    Args:
        inputs: Features of an observation.
        sizes: Widths of the hidden layers, and of the answer.
        memory: Width of the LSTM; 0: none.
    """
    out: dict[str, tuple[int, ...]] = {}
    if memory:
        gates = 4 * memory
        out = {"lstm.weight_ih": (gates, inputs), "lstm.weight_hh": (gates, memory), "lstm.bias": (gates,)}
    widths = (memory or inputs, *sizes)
    for k, (before, after) in enumerate(pairwise(widths)):
        out |= {f"layers.{k}.weight": (after, before), f"layers.{k}.bias": (after,)}
    return out


def network(
    arrays: Mapping[str, Array], inputs: int, sizes: Sequence[int], memory: int, activation: str, squash: str
) -> Network:
    """A net from its arrays; see :func:`shapes`.

    Raises:
        ValueError: If an array lacks, is one too many, has another shape or is not finite.
    """
    wanted = shapes(inputs, sizes, memory)
    if arrays.keys() != wanted.keys():
        raise ValueError(f"the arrays must be {', '.join(wanted)}, not {', '.join(sorted(arrays)) or 'none'}")
    for name, shape in wanted.items():
        array = np.asarray(arrays[name])
        if array.shape != shape or not np.issubdtype(array.dtype, np.floating):
            raise ValueError(f"{name} must be {shape} floats, not {array.shape} of {array.dtype}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} is not finite")
    flat = [np.asarray(arrays[name], dtype=float).T.ravel() for name in wanted]
    widths = np.array([memory or inputs, *sizes], dtype=np.int64)
    return Network(widths, int(memory), activation == "relu", squash == "tanh", np.concatenate(flat))
