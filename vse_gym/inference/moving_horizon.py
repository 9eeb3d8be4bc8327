"""Moving-horizon estimation: the trajectory that fits the last N readings best, and what is known from before them.

    minimise  |x_0 - m|^2_P + sum |x_i - f(x_(i-1), u_i)|^2_Q + 2 sum rho((y_i - h(x_i, u_i))/sigma)

over x_0 ... x_N. Each Gauss-Newton step is linear least squares along the trajectory, which is what the smoother of
Rauch, Tung, Striebel (1965) solves, at a cost that grows with N and not with its cube: Bell (1994). Losses rho other
than the square are reweighted squares.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.inference.gaussian.extended import congruence, jacobian, stencil
from vse_gym.inference.linalg import backward_solve, cholesky, forward_solve, joseph_scalar
from vse_gym.inference.model import advance, attend, heed, observe, recall, remember, report


class MovingHorizon(NamedTuple):
    """Least squares over a window that moves. Rao, Rawlings, Mayne (2003).

    States need no bounds: models are defined for all of them, and the noise that binds one state to the next keeps a
    trajectory as near to the model as it keeps a Kalman filter.
    """

    loss: Any  # Huber or CauchyGaussian
    horizon: int  # readings in the window, N
    iterations: int  # Gauss-Newton steps for each reading
    step: float = 6e-6  # difference step over max(1, |x|), as of the extended rule


class Huber(NamedTuple):
    """The square, and beyond a limit a line. Huber (1964). With an infinite limit it is least squares."""

    limit: float = math.inf  # [standard deviations]


class CauchyGaussian(NamedTuple):
    """The negative log density of the noise law of Qin et al. (2014): the Cauchy part's scale is sigma over sqrt 2."""

    share: float  # of the Cauchy part [-]


@generic
def weigh(loss, z):
    """rho'(z)/z of a residual of z standard deviations: what a square must be weighed with to pull alike."""


@weigh.register(Huber)
@compiled
def _(loss, z):
    return 1.0 if abs(z) <= loss.limit else loss.limit / abs(z)


@weigh.register(CauchyGaussian)
@compiled
def _(loss, z):
    even, wide = (1 - loss.share) * math.exp(-0.5 * z * z), loss.share * 2 / math.sqrt(math.pi) / (1 + 2 * z * z)
    if even + wide == 0.0:  # Gaussian, and farther out than floats reach
        return 1.0
    return (even + wide * 4 / (1 + 2 * z * z)) / (even + wide)


@compiled
def filter_stage(rule, model, mean, cov, before, here, u, y, variances):
    """One step of Kalman's filter, linearised about the trajectory instead of about what it believes.

    Args:
        mean, cov: Belief before the step, (n,) and (n, n).
        before, here: The trajectory before and after the step, (n,).
        u, y, variances: Inputs, reading and noise of its channels; NaN: not used.

    Returns:
        F (n, n), the predicted mean and cov, the corrected mean and cov, NIS and its degrees of freedom.
    """
    columns = stencil(before, rule.step)
    values = advance(model, columns, u)
    F = jacobian(columns, values)
    n = mean.size
    ahead = np.empty(n)
    for i in range(n):
        ahead[i] = values[i, 0]
        for j in range(n):
            ahead[i] += F[i, j] * (mean[j] - before[j])
    ahead_cov = congruence(F, cov, model.process_cov)
    columns = stencil(here, rule.step)
    values = observe(model, columns, u)
    H = jacobian(columns, values)
    new_mean, new_cov = ahead.copy(), ahead_cov.copy()
    gain, scratch = np.empty(n), np.empty((n, n))
    nis, dof = 0.0, 0.0
    for i in range(y.size):
        if math.isnan(variances[i]):
            continue
        innovation = y[i] - values[i, 0]
        variance = variances[i] / weigh(rule.loss, innovation / math.sqrt(variances[i]))
        for j in range(n):
            innovation -= H[i, j] * (new_mean[j] - here[j])
        nis += innovation * innovation / joseph_scalar(new_mean, new_cov, H[i], innovation, variance, gain, scratch)
        dof += 1.0
    return F, ahead, ahead_cov, new_mean, new_cov, nis, dof


@compiled
def gauss_newton(rule, model, mean, cov, states, inputs, readings, variances):
    """One step on the whole window: the smoothed means of the problem linearised about the trajectory.

    Args:
        mean, cov: Belief over the state before the first reading of the window.
        states: The trajectory (N + 1, n), from that state on.
        inputs, readings, variances: (N, k), (N, m), (N, m).

    Returns:
        states (N + 1, n), the covariance of the last one (n, n), NIS of the last reading and its degrees of freedom.
    """
    size, n = inputs.shape[0], mean.size
    jacobians, covs, factors = np.empty((size, n, n)), np.empty((size, n, n)), np.empty((size, n, n))
    ahead, smoothed = np.empty((size, n)), np.empty((size + 1, n))
    nis, dof = 0.0, 0.0
    for t in range(size):
        F, ahead_mean, ahead_cov, new_mean, new_cov, nis, dof = filter_stage(
            rule, model, mean, cov, states[t], states[t + 1], inputs[t], readings[t], variances[t]
        )
        cholesky(ahead_cov, factors[t])
        for i in range(n):
            smoothed[t, i], ahead[t, i] = mean[i], ahead_mean[i]
            for j in range(n):
                jacobians[t, i, j], covs[t, i, j] = F[i, j], cov[i, j]
        mean, cov = new_mean, new_cov
    for i in range(n):
        smoothed[size, i] = mean[i]
    pull, push = np.empty(n), np.empty(n)
    for t in range(size - 1, -1, -1):
        for i in range(n):
            pull[i] = smoothed[t + 1, i] - ahead[t, i]
        forward_solve(factors[t], pull)
        backward_solve(factors[t], pull)
        for i in range(n):
            push[i] = 0.0
            for j in range(n):
                push[i] += jacobians[t, j, i] * pull[j]
        for i in range(n):
            for j in range(n):
                smoothed[t, i] += covs[t, i, j] * push[j]
    return smoothed, cov, nis, dof


@compiled
def appended(rows, row, begin):
    """The rows from ``begin`` on, and one more, which sets the width."""
    kept, width = rows.shape[0] - begin, row.size
    out = np.empty((kept + 1, width))
    for j in range(width):
        for i in range(kept):
            out[i, j] = rows[begin + i, j]
        out[kept, j] = row[j]
    return out


@compiled
def moving_horizon_update(constants, mean, cov, states, inputs, readings, variances, memory, u, y):
    """Take one more reading into the window, and let go of the oldest if it is full.

    What is let go of goes on as the arrival cost: an extended Kalman step, linearised about the trajectory as it
    stands. The model is asked once per reading which channels to believe. What lags behind the state follows the newest
    one, and stays for the older readings as it was in their time.

    Args:
        constants: ``hold((rule, model))``.
        mean, cov, states, inputs, readings, variances: As of :func:`gauss_newton`; the window may be shorter than N.
        memory: Of the model, (k,).
        u, y: Inputs and reading.

    Returns:
        mean, cov, states, inputs, readings, variances, memory, the covariance of the newest state,
        output (7,): vx, vy, yaw rate, ax, ay, NIS, its degrees of freedom.
    """
    rule, model = constants.value
    u = recall(model, memory, heed(model, u, y))
    noise, memory = attend(model, memory, u, y)
    begin = 0
    if inputs.shape[0] == rule.horizon:
        begin = 1
        _, _, _, mean, cov, _, _ = filter_stage(
            rule, model, mean, cov, states[0], states[1], inputs[0], readings[0], variances[0]
        )
    newest = np.ascontiguousarray(states[-1]).reshape(-1, 1)
    states = appended(states, advance(model, newest, u)[:, 0], begin)
    inputs, readings = appended(inputs, u, begin), appended(readings, y, begin)
    variances = appended(variances, noise, begin)
    newest_cov, output = cov, np.empty(7)
    for _ in range(rule.iterations):
        states, newest_cov, output[5], output[6] = gauss_newton(
            rule, model, mean, cov, states, inputs, readings, variances
        )
    memory = remember(model, memory, states[-1], u)
    reported = report(model, states[-1], u)
    for i in range(5):
        output[i] = reported[i]
    return mean, cov, states, inputs, readings, variances, memory, newest_cov, output
