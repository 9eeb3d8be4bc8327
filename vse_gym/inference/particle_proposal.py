"""Particle filters whose every particle has a Gaussian filter of its own, which looks at the reading before it moves.

Van der Merwe, Doucet, de Freitas, Wan (2000): the unscented particle filter. With the cubature rule and adaptive
reading noise it is the adaptive cubature particle filter of patent application CN110532590A (2019).

Points of all particles go through the model together, as columns (n, N p): one particle's beside each other.
"""

import math

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.recursion import believe
from vse_gym.inference.gaussian.sage_husa import learn_from
from vse_gym.inference.gaussian.sigma_points import channels_used, spread_points
from vse_gym.inference.linalg import cholesky, forward_solve
from vse_gym.inference.model import advance, heed, observe, recall, remember, report
from vse_gym.inference.particle import log_likelihood, systematic


@compiled
def spread_all(rule, means, factors):
    """The points (n, N p) of N Gaussians with means (n, N) and lower factors (N, n, n), and the points' weights."""
    n, size = means.shape
    one, first_mean, first_cov, other = spread_points(rule, means[:, 0].copy(), factors[0])
    p = one.shape[1]
    points = np.empty((n, size * p))
    for j in range(size):
        if j > 0:
            one, _, _, _ = spread_points(rule, means[:, j].copy(), factors[j])
        for i in range(n):
            for k in range(p):
                points[i, j * p + k] = one[i, k]
    return points, p, first_mean, first_cov, other


@compiled
def deviations(values, begin, p, first, other, rows, mean, out):
    """Weighted mean of columns begin to begin + p of those ``rows`` of values into ``mean``, what is off it to ``out``.

    ``first`` is the first column's weight in the mean.
    """
    for a in range(rows.size):
        row, total = values[rows[a]], 0.0
        for k in range(1, p):
            total += row[begin + k]
        mean[a] = first * row[begin] + other * total
        for k in range(p):
            out[a, k] = row[begin + k] - mean[a]


@compiled
def spread_of(a, b, i, k, p, first, other):
    """Weighted covariance of row i of deviations a with row k of deviations b."""
    total = 0.0
    for c in range(1, p):
        total += a[i, c] * b[k, c]
    return first * a[i, 0] * b[k, 0] + other * total


@compiled
def predict_all(rule, model, states, factors, u):
    """Each particle's belief one step on, and where it goes itself, without noise.

    Args:
        rule: With points.
        model: As ``inference.model`` has it.
        states: (n, N).
        factors: Of the particles' covariances, (N, n, n).
        u: As of :func:`recall`.

    Returns:
        means (n, N), factors (N, n, n), centres (n, N).
    """
    n, size = states.shape
    points, p, first_mean, first_cov, other = spread_all(rule, states, factors)
    if p % 2 == 1:  # the first point is the particle: the unscented rule's costs nothing more
        values = advance(model, points, u)
        centres = np.empty((n, size))
        for i in range(n):
            for j in range(size):
                centres[i, j] = values[i, j * p]
    else:
        values, centres = advance(model, points, u), advance(model, states, u)
    means, after = np.empty((n, size)), np.empty((size, n, n))
    rows, mean, off, cov = np.arange(n), np.empty(n), np.empty((n, p)), np.empty((n, n))
    for j in range(size):
        deviations(values, j * p, p, first_mean, other, rows, mean, off)
        for i in range(n):
            means[i, j] = mean[i]
            for k in range(i + 1):
                cov[i, k] = spread_of(off, off, i, k, p, first_cov, other) + model.process_cov[i, k]
                cov[k, i] = cov[i, k]
        cholesky(cov, after[j])
    return means, after, centres


@compiled
def correct_all(rule, model, means, factors, u, y, variances):
    """Each particle's belief after reading y: means (n, N) and factors (N, n, n) in place, by Kalman's gain."""
    n, size = means.shape
    used = channels_used(variances)
    m = used.size
    if m == 0:
        return
    points, p, first_mean, first_cov, other = spread_all(rule, means, factors)
    values = observe(model, points, u)
    expected, off, off_points = np.empty(m), np.empty((m, p)), np.empty((n, p))
    spread, root, gain, cov = np.empty((m, m)), np.empty((m, m)), np.empty((n, m)), np.empty((n, n))
    for j in range(size):
        deviations(values, j * p, p, first_mean, other, used, expected, off)
        for i in range(n):
            for k in range(p):
                off_points[i, k] = points[i, j * p + k] - means[i, j]
        for a in range(m):
            for b in range(a + 1):
                spread[a, b] = spread_of(off, off, a, b, p, first_cov, other)
                spread[b, a] = spread[a, b]
            spread[a, a] += variances[used[a]]
        cholesky(spread, root)
        for a in range(m):
            expected[a] = y[used[a]] - expected[a]
        forward_solve(root, expected)  # the innovation, white
        for i in range(n):
            for a in range(m):
                gain[i, a] = spread_of(off_points, off, i, a, p, first_cov, other)
            forward_solve(root, gain[i])
            for a in range(m):
                means[i, j] += gain[i, a] * expected[a]
        for i in range(n):
            for k in range(i + 1):
                total = 0.0
                for c in range(k + 1):
                    total += factors[j, i, c] * factors[j, k, c]
                for a in range(m):
                    total -= gain[i, a] * gain[k, a]
                cov[i, k] = cov[k, i] = total
        cholesky(cov, factors[j])


@compiled
def draw_all(means, factors, scale, rng):
    """One draw from each N(mean, scale^2 L L^T), (n, N), and its log density, (N,), up to a constant."""
    n, size = means.shape
    states, logs, draws = means.copy(), np.zeros(size), np.empty(n)
    for j in range(size):
        density = 1.0
        for i in range(n):
            draws[i] = rng.standard_normal()
            logs[j] -= 0.5 * draws[i] * draws[i]
            density *= scale * factors[j, i, i]
            for k in range(i + 1):
                states[i, j] += scale * factors[j, i, k] * draws[k]
        logs[j] -= math.log(density)
    return states, logs


@compiled
def log_transition(states, centres, factor):
    """Log density (N,) of moving from centres (n, N) to states (n, N) by noise of that factor, up to a constant."""
    n, size = states.shape
    logs, off = np.zeros(size), np.empty(n)
    for j in range(size):
        for i in range(n):
            off[i] = states[i, j] - centres[i, j]
        forward_solve(factor, off)
        for i in range(n):
            logs[j] -= 0.5 * off[i] * off[i]
    return logs


@compiled
def reweigh(weights, logs):
    """Weights (N,) times exp(logs), summing to one; as they were if nothing is left of them. A NaN in logs is no
    weight.
    """
    size = weights.size
    after, peak, total = np.zeros(size), -math.inf, 0.0
    for j in range(size):
        if weights[j] > 0.0 and logs[j] > peak:
            peak = logs[j]
    for j in range(size):
        if weights[j] > 0.0 and logs[j] <= peak:
            after[j] = weights[j] * math.exp(logs[j] - peak)
            total += after[j]
    if not (0.0 < total < math.inf):
        return weights.copy()
    for j in range(size):
        after[j] /= total
    return after


@compiled
def weighted_moments(values, weights):
    """Mean (rows,) and covariance (rows, rows) of weighted columns; one without weight may hold anything."""
    rows, size = values.shape
    mean, cov = np.zeros(rows), np.zeros((rows, rows))
    for j in range(size):
        if weights[j] > 0.0:
            for i in range(rows):
                mean[i] += weights[j] * values[i, j]
    for j in range(size):
        if weights[j] > 0.0:
            for i in range(rows):
                off = weights[j] * (values[i, j] - mean[i])
                for k in range(i + 1):
                    cov[i, k] += off * (values[k, j] - mean[k])
    for i in range(rows):
        for k in range(i):
            cov[k, i] = cov[i, k]
    return mean, cov


@compiled
def alike(factor, size):
    """``size`` copies of a factor (n, n), (size, n, n)."""
    n = factor.shape[0]
    out = np.empty((size, n, n))
    for j in range(size):
        for i in range(n):
            for k in range(n):
                out[j, i, k] = factor[i, k]
    return out


@compiled
def proposal_step(held, states, factors, weights, memory, u, y, share, scale, carried, resample_below, rng):
    """A step of every particle's own filter, a draw from it, and the weight that makes up for the difference.

    w <- w p(y | x) p(x | x_old)/N(x; m, scale^2 P), where m and P are what the particle's filter says after y. While
    nothing is heard there is nothing to look at: p(x | x_old) proposes, and weights stay.

    Args:
        held: ``hold((rule, model))``; the rule has points, and may adapt the reading noise, one for all particles.
        states: (n, N).
        factors: Of the covariances of the particles' filters, (N, n, n).
        weights: (N,), summing to one.
        memory: Of rule and model.
        u, y: Inputs and reading.
        share: Cauchy share of the likelihood of each channel, (m,); the proposal is Gaussian.
        scale: Of the proposal's standard deviation.
        carried: Of a particle's standard deviation, what its next step starts from: 1 as published, 0 as if a particle
            were certain of where it is.
        resample_below: Effective sample size below which to resample, over N.
        rng: Where draws are taken from.

    Returns:
        states, factors, weights, memory, mean (n,), cov (n, n), output (6,): vx, vy, yaw rate, ax, ay and the effective
        sample size.
    """
    rule, model = held.value
    n, size = states.shape
    u = recall(model, memory, heed(model, u, y))
    means, roots, centres = predict_all(rule, model, states, factors, u)
    variances, memory = believe(rule, model, means[:, 0].copy(), roots[0], memory, u, y)
    correct_all(rule, model, means, roots, u, y, variances)
    noise = np.empty((n, n))
    cholesky(model.process_cov, noise)
    if channels_used(variances).size > 0:
        drawn, densities = draw_all(means, roots, scale, rng)
    else:
        drawn, densities = draw_all(centres, alike(noise, size), 1.0, rng)
    readings = observe(model, drawn, u)
    logs = log_likelihood(readings, y, variances, share) + log_transition(drawn, centres, noise) - densities
    after = reweigh(weights, logs)
    for j in range(size):
        fine = True
        for i in range(n):
            fine = fine and math.isfinite(drawn[i, j]) and math.isfinite(roots[j, i, i])
            if not fine:
                break
        if not fine:  # it has no weight, unless none has: it goes on from where it would have been
            drawn[:, j] = centres[:, j]
            roots[j] = noise
    mean, cov = weighted_moments(drawn, after)
    expected, spread = weighted_moments(readings, after)
    memory = learn_from(rule, memory, y, expected, np.diag(spread).copy(), variances)
    memory = remember(model, memory, mean, u)
    squares = 0.0
    for j in range(size):
        squares += after[j] * after[j]
    if squares * 2 * n > 1:  # so few carry the weight that their sample has hardly any rank: as for the bootstrap
        cov += squares * model.process_cov
    output = np.empty(6)
    output[:5] = report(model, mean, u)
    output[5] = 1 / squares
    for j in range(size):
        for i in range(n):
            for k in range(i + 1):
                roots[j, i, k] *= carried
    if not 1 / squares >= resample_below * size:
        picked = systematic(after, rng.random())
        drawn, roots = drawn[:, picked], roots[picked]
        after[:] = 1 / size
    return drawn, roots, after, memory, mean, cov, output
