"""The posterior Cramer-Rao bound: how well a model's state can be known at all. Tichavsky, Muravchik, Nehorai (1998).

No estimator's mean squared error, averaged over drives of the model, is below the inverse of the information J that

    J' = D22 - D21 (J + D11)^-1 D12

carries from step to step, with D11 = E[F^T Q^-1 F], D12 = -E[F^T] Q^-1, D22 = Q^-1 + E[H^T I H]. F and H are the
Jacobians of ``advance`` and ``observe``, Q is the process noise, and I the Fisher information of the readings' noise
about its location. Where model and noise are linear and Gaussian this is Riccati's recursion, and the bound is met.
The relative error against it is 2e-15 with Q = 1e-2, 2e-11 with 1e-6, 3e-7 with 1e-10.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, heed, observe
from vse_gym.inference.particle import diffuse, draw

STEP = 6e-6  # of central differences, over max(1, |x|): cube root of the rounding error


class Expectations(NamedTuple):
    """What the recursion needs of a drive of T readings, averaged over sampled states."""

    curvature: NDArray[np.float64]  # E[F^T Q^-1 F] of the step to each reading, (T, n, n)
    slope: NDArray[np.float64]  # E[F], (T, n, n)
    reading: NDArray[np.float64]  # E[H^T I H] of each reading, (T, n, n)


@compiled
def draw_states(model, inputs, readings, size, rng):
    """Drives of the model itself, ``size`` at a time: (T + 1, n, size).

    As filters have it: the first is drawn from the prior and lies one step before the first reading; each further one
    is the one before, advanced under that reading's inputs, with process noise added.

    Args:
        model: With what ``inference.model`` asks for.
        inputs: (T, k).
        readings: What ``heed`` is told of readings, (T, m): the same for all drives, so NaN is what is fair.
        size: How many.
        rng: Where noise is drawn from.
    """
    out = np.empty((inputs.shape[0] + 1, model.prior_mean.size, size))
    out[0] = draw(model.prior_mean, model.prior_cov, size, rng)
    for k in range(inputs.shape[0]):
        out[k + 1] = advance(model, out[k], heed(model, inputs[k], readings[k]))
        diffuse(out[k + 1], model.process_cov, rng)
    return out


@compiled
def stencils(states):
    """Columns (n, 2 n N): states (n, N) with each row in turn moved up, then the same with it moved down."""
    n, size = states.shape
    out = np.empty((n, 2 * n * size))
    for k in range(2 * n):
        out[:, k * size : (k + 1) * size] = states
    for i in range(n):
        for j in range(size):
            h = STEP * max(1.0, abs(states[i, j]))
            out[i, i * size + j] += h
            out[i, (n + i) * size + j] -= h
    return out


@compiled
def slopes(columns, values):
    """Jacobians (n, m, N), by what is differentiated with respect to first, of a function's values (m, 2 n N)."""
    n, m = columns.shape[0], values.shape[0]
    half, size = columns.shape[1] // 2, columns.shape[1] // (2 * n)
    out = np.empty((n, m, size))
    for i in range(n):
        for j in range(size):
            up = i * size + j
            per_width = 1 / (columns[i, up] - columns[i, half + up])
            for k in range(m):
                out[i, k, j] = (values[k, up] - values[k, half + up]) * per_width
    return out


@compiled
def expectations(model, inputs, readings, states, precision, information):
    """The averages of the recursion, by Monte Carlo over states, with Jacobians by central differences.

    Args:
        model: With what ``inference.model`` asks for.
        inputs: (T, k).
        readings: (T, m); which are NaN, and what ``attend`` makes of the rest, says which channels tell anything.
        states: As of :func:`draw_states`, (T + 1, n, N).
        precision: Inverse of the process noise of a step, (n, n).
        information: Fisher information of each channel's noise times its variance, (m,): 1 if it is Gaussian [-].

    Returns:
        curvature, slope, reading, as :class:`Expectations` has them.
    """
    steps, m = readings.shape
    n = states.shape[1]
    curvature, slope, reading = np.zeros((steps, n, n)), np.zeros((steps, n, n)), np.zeros((steps, n, n))
    memory = model.memory
    for t in range(steps):
        u = heed(model, inputs[t], readings[t])
        variances, memory = attend(model, memory, u, readings[t])
        columns = stencils(states[t])
        F = slopes(columns, advance(model, columns, u))
        columns = stencils(states[t + 1])
        H = slopes(columns, observe(model, columns, u))
        for i in range(n):
            for k in range(n):
                slope[t, k, i] = F[i, k].mean()
                for a in range(n):
                    for b in range(n):
                        curvature[t, i, k] += precision[a, b] * np.mean(F[i, a] * F[k, b])
                for c in range(m):
                    if not np.isnan(variances[c]):
                        reading[t, i, k] += information[c] / variances[c] * np.mean(H[i, c] * H[k, c])
    return curvature, slope, reading


def bound(prior_cov: NDArray[np.float64], precision: NDArray[np.float64], e: Expectations) -> NDArray[np.float64]:
    """Least covariance of the error after each reading, (T, n, n).

    Args:
        prior_cov: Of the state one step before the first reading, (n, n).
        precision: Inverse of the process noise of a step, (n, n).
        e: Of the drive.
    """
    information = np.linalg.inv(prior_cov)
    out = np.empty_like(e.reading)
    for t, (curvature, slope, reading) in enumerate(zip(*e, strict=True)):
        cross = precision @ slope
        information = precision + reading - cross @ np.linalg.solve(information + curvature, cross.T)
        information = 0.5 * (information + information.T)
        out[t] = np.linalg.inv(information)
    return out
