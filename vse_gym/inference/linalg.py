"""Small dense linear algebra for kernels. At three to ten rows, loops beat LAPACK's call overhead many times over."""

import math

import numpy as np

from vse_gym.compiled import compiled

SINGULAR = 1e-15  # a pivot this small beside its diagonal entry is rounding


@compiled
def symmetrise(a):
    """Replace a square matrix by its symmetric part, in place."""
    for i in range(a.shape[0]):
        for j in range(i):
            a[i, j] = a[j, i] = 0.5 * (a[i, j] + a[j, i])


@compiled
def cholesky(a, factor):
    """Lower factor L of a symmetric matrix, a = L L^T, into ``factor``; says whether a is positive definite.

    In one that is not, the columns of failing pivots are left out, but for 1e-12 of the matrix's own diagonal entry
    (at least 1e-300): near a matrix that is singular only, and enough to keep a sigma-point filter alive.
    """
    n = a.shape[0]
    positive = True
    for j in range(n):
        pivot = a[j, j]
        for k in range(j):
            pivot -= factor[j, k] * factor[j, k]
        for i in range(j):
            factor[i, j] = 0.0
        if not pivot > SINGULAR * a[j, j]:
            positive = False
            factor[j, j] = math.sqrt(max(1e-300, 1e-12 * abs(a[j, j])))
            for i in range(j + 1, n):
                factor[i, j] = 0.0
            continue
        factor[j, j] = math.sqrt(pivot)
        for i in range(j + 1, n):
            total = a[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total / factor[j, j]
    return positive


@compiled
def forward_solve(factor, b):
    """Solve L x = b in place for a lower factor L, b of shape (n,) or its leading part."""
    for i in range(factor.shape[0]):
        total = b[i]
        for k in range(i):
            total -= factor[i, k] * b[k]
        b[i] = total / factor[i, i]


@compiled
def backward_solve(factor, b):
    """Solve L^T x = b in place for a lower factor L, b of shape (n,) or its leading part."""
    n = factor.shape[0]
    for i in range(n - 1, -1, -1):
        total = b[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * b[k]
        b[i] = total / factor[i, i]


@compiled
def product(factor):
    """L L^T (n, n) of a lower factor, (n, n) and whatever rows may stand below it."""
    n = factor.shape[1]
    out = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += factor[i, k] * factor[j, k]
            out[i, j] = out[j, i] = total
    return out


@compiled
def joseph_scalar(mean, cov, h, innovation, variance, gain, scratch):
    """Take one scalar measurement with row h (n,) into mean and cov, in place.

    Joseph's form, P' = B P B^T + r k k^T with B = I - k h^T: a sum of two non-negative matrices, so rounding cannot
    make it indefinite. ``gain`` (n,) and ``scratch`` (n, n) are work space.

    Returns:
        The innovation's variance.
    """
    n = mean.size
    spread = variance
    for i in range(n):
        gain[i] = 0.0
        for j in range(n):
            gain[i] += cov[i, j] * h[j]
        spread += h[i] * gain[i]
    for i in range(n):
        gain[i] /= spread
        mean[i] += gain[i] * innovation
    for j in range(n):  # scratch = B P
        projected = 0.0
        for k in range(n):
            projected += h[k] * cov[k, j]
        for i in range(n):
            scratch[i, j] = cov[i, j] - gain[i] * projected
    for i in range(n):  # cov = scratch B^T + r k k^T
        projected = 0.0
        for k in range(n):
            projected += scratch[i, k] * h[k]
        for j in range(i + 1):
            value = scratch[i, j] - projected * gain[j] + variance * gain[i] * gain[j]
            cov[i, j] = cov[j, i] = value
    return spread


TINIEST = 1e-150  # the square of a row below this is no number any more


@compiled
def triangularise(rows):
    """The lower factor L (n, n) with L L^T = A A^T of A (n, k >= n), by Householder reflections; A is used up.

    The diagonal is not negative. This is the QR decomposition of A^T, without Q.
    """
    n, k = rows.shape
    factor = np.zeros((n, n))
    for i in range(n):
        largest, square = 0.0, 0.0
        for j in range(i, k):
            largest = max(largest, abs(rows[i, j]))
            square += rows[i, j] * rows[i, j]
        norm = math.sqrt(square)
        if largest > TINIEST:
            # The reflection v = a + sign(a_i) |a| e_i takes the row to its i-th axis without cancellation.
            turned = math.copysign(norm, rows[i, i])
            rows[i, i] += turned
            scale = 1 / (turned * rows[i, i])
            for r in range(i + 1, n):
                dot = 0.0
                for j in range(i, k):
                    dot += rows[i, j] * rows[r, j]
                for j in range(i, k):
                    rows[r, j] -= dot * scale * rows[i, j]
            sign = -math.copysign(1.0, turned)
        else:
            norm, sign = 0.0, 1.0
        factor[i, i] = norm
        for r in range(i + 1, n):
            factor[r, i] = sign * rows[r, i]
    return factor


@compiled
def rank_one(factor, x, sign):
    """The factor of L L^T + sign x x^T, for a lower factor (n, n), in place; ``x`` (n,) is used up.

    Rotations for sign 1, hyperbolic ones for sign -1. Golub, Van Loan (2013), section 6.5.

    Returns:
        Whether the result is positive definite; if not, the factor is left half done.
    """
    n = x.size
    for k in range(n):
        pivot = factor[k, k] * factor[k, k]
        square = pivot + sign * x[k] * x[k]
        if not (pivot > 0.0 and square > SINGULAR * pivot):
            return False
        length = math.sqrt(square)
        c, s = length / factor[k, k], x[k] / factor[k, k]
        factor[k, k] = length
        for i in range(k + 1, n):
            factor[i, k] = (factor[i, k] + sign * s * x[i]) / c
            x[i] = c * x[i] - s * factor[i, k]
    return True
