"""A linear model as it is in one step, for the rules that know models by ``advance`` and ``observe``."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, observe


class Frozen(NamedTuple):
    """x' = F x + g, y = H x + d: what ``matrices`` gives of a model whose inputs and memory are known."""

    F: NDArray[np.float64]  # (n, n)
    g: NDArray[np.float64]  # (n,)
    H: NDArray[np.float64]  # (m, n)
    d: NDArray[np.float64]  # (m,)
    process_cov: NDArray[np.float64]  # (n, n)
    variances: NDArray[np.float64]  # of the channels in this step; NaN: not used; (m,)


@compiled
def affine(matrix, shift, states):
    """Of columns: (n, N) to (rows, N)."""
    out = np.empty((matrix.shape[0], states.shape[1]))
    for i in range(matrix.shape[0]):
        for j in range(states.shape[1]):
            total = shift[i]
            for k in range(matrix.shape[1]):
                total += matrix[i, k] * states[k, j]
            out[i, j] = total
    return out


@advance.register(Frozen)
@compiled
def _(model, states, u):
    return affine(model.F, model.g, states)


@observe.register(Frozen)
@compiled
def _(model, states, u):
    return affine(model.H, model.d, states)


@attend.register(Frozen)
@compiled
def _(model, memory, u, y):
    return model.variances, memory
