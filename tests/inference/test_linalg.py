"""Small dense linear algebra against LAPACK and textbook formulas."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import solve_triangular

from vse_gym.inference.linalg import (
    backward_solve,
    cholesky,
    forward_solve,
    joseph_scalar,
    rank_one,
    symmetrise,
    triangularise,
)

EPS = np.finfo(float).eps
SIZES = st.integers(1, 6)


def matrices(rows, columns):
    return arrays(float, (rows, columns), elements=st.floats(-3.0, 3.0))


def factored(matrix):
    """Factor and verdict of our cholesky; the factor starts as NaN to show that all of it is written."""
    factor = np.full_like(matrix, np.nan)
    return factor, cholesky(matrix, factor)


@st.composite
def definite(draw, sizes=SIZES):
    """A positive definite matrix whose condition number is below about 400."""
    n = draw(sizes)
    root = draw(matrices(n, n))
    return root @ root.T + np.eye(n)


@st.composite
def singular(draw):
    """A covariance whose last states are combinations of the first, well-conditioned ones."""
    cov = draw(definite(st.integers(1, 4)))
    extended = np.vstack([np.eye(len(cov)), draw(matrices(draw(st.integers(1, 3)), len(cov)))])
    return extended @ cov @ extended.T


@st.composite
def updates(draw):
    """A belief, and independent measurements of it: mean, cov, rows H, variances, innovations."""
    cov = draw(definite())
    n, m = cov.shape[0], draw(st.integers(1, 7))
    mean = draw(arrays(float, n, elements=st.floats(-3.0, 3.0)))
    innovations = draw(arrays(float, m, elements=st.floats(-3.0, 3.0)))
    variances = draw(arrays(float, m, elements=st.floats(0.01, 10.0)))
    return mean, cov, draw(matrices(m, n)), variances, innovations


@given(definite())
def test_cholesky_is_lapacks(matrix):
    # Backward stable: the error is a small multiple of eps times the condition number, 400.
    factor, positive = factored(matrix)
    assert positive
    np.testing.assert_allclose(factor, np.linalg.cholesky(matrix), atol=1e-12 * np.abs(matrix).max())


@given(definite(), st.data())
def test_cholesky_does_not_depend_on_units(matrix, data):
    # Powers of two only move the exponent: exact, but for numbers too small to keep their digits. States may be
    # stiffnesses and yaw rates side by side.
    n = matrix.shape[0]
    units = 2.0 ** data.draw(arrays(np.int64, n, elements=st.integers(-20, 20)))
    factor, positive = factored(units[:, None] * matrix * units)
    assert positive
    np.testing.assert_allclose(factor, units[:, None] * factored(matrix)[0], rtol=0, atol=1e-290)


@given(definite(), st.floats(0.01, 10.0))
def test_cholesky_says_what_is_not_positive_definite(matrix, shortfall):
    values, vectors = np.linalg.eigh(matrix)
    values[0] = -shortfall
    factor, positive = factored(vectors * values @ vectors.T)
    assert not positive
    np.testing.assert_array_equal(factor, np.tril(factor))


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.diag([1.0, 0.0, 2.0]), np.diag([1.0, np.nan, 2.0])])
def test_cholesky_says_what_is_singular_or_not_a_number(matrix):
    factor, positive = factored(matrix)
    assert not positive
    assert np.all(np.isfinite(factor))


def test_cholesky_replaces_a_failing_pivot_by_a_small_one():
    factor, positive = factored(np.diag([4.0, -1.0]))
    assert not positive
    np.testing.assert_allclose(factor @ factor.T, np.diag([4.0, 1e-12]), rtol=1e-12)


@example(9.6 * np.outer([1.0, 1.0, -1.2, -1.5], [1.0, 1.0, -1.2, -1.5]))  # one source of noise moves four states
@given(singular())
def test_cholesky_of_a_singular_covariance_is_near_it(matrix):
    # Its sigma points must still spread like it. A failing pivot adds 1e-12 of its variance; the rounding
    # beside it, 1e-14, is divided by the pivot's root, 1e-6.
    factor, _ = factored(matrix)
    np.testing.assert_allclose(factor @ factor.T, matrix, rtol=0, atol=1e-10 * matrix.diagonal().max())


@given(definite(), st.data())
def test_forward_solve_solves(matrix, data):
    factor = np.linalg.cholesky(matrix)
    b = data.draw(arrays(float, matrix.shape[0], elements=st.floats(-3.0, 3.0)))
    x = b.copy()
    forward_solve(factor, x)
    np.testing.assert_allclose(x, solve_triangular(factor, b, lower=True), rtol=1e-12, atol=1e-12)


def test_forward_solve_takes_the_leading_part_of_a_longer_vector():
    x = np.array([2.0, 5.0, 7.0])
    forward_solve(np.array([[2.0, 0.0], [1.0, 4.0]]), x)
    np.testing.assert_array_equal(x, [1.0, 1.0, 7.0])


@given(SIZES.flatmap(lambda n: matrices(n, n)))
def test_symmetrise_takes_the_symmetric_part(matrix):
    expected = 0.5 * (matrix + matrix.T)
    symmetrise(matrix)
    np.testing.assert_array_equal(matrix, expected)


@given(updates())
def test_one_measurement_after_the_other_is_the_joint_update(update):
    mean, cov, H, variances, innovations = update
    S = H @ cov @ H.T + np.diag(variances)
    K = cov @ H.T @ np.linalg.inv(S)
    new_mean, new_cov = mean.copy(), cov.copy()
    gain, scratch = np.empty(mean.size), np.empty(cov.shape)
    length = 0.0
    for row, variance, innovation in zip(H, variances, innovations, strict=True):
        left = innovation - row @ (new_mean - mean)
        spread = joseph_scalar(new_mean, new_cov, row, left, variance, gain, scratch)
        length += left * left / spread
    # The inverse of S loses its condition number: up to 1e6 here, a variance of 0.01 beside an H P H^T of 1e4.
    lost = 1e-14 * np.linalg.cond(S) * np.abs(cov).max()
    np.testing.assert_allclose(new_mean, mean + K @ innovations, rtol=1e-8, atol=1e-8 + lost)
    np.testing.assert_allclose(new_cov, cov - K @ S @ K.T, rtol=1e-8, atol=1e-8 + lost)
    assert length == pytest.approx(innovations @ np.linalg.solve(S, innovations), rel=1e-8, abs=1e-8)


@given(updates())
def test_a_measurement_narrows_the_belief_and_keeps_it_symmetric_and_positive(update):
    mean, cov, H, variances, innovations = update
    after = cov.copy()
    joseph_scalar(mean, after, H[0], innovations[0], variances[0], np.empty(mean.size), np.empty(cov.shape))
    np.testing.assert_array_equal(after, after.T)
    rounding = 1e-12 * np.abs(cov).max()
    assert np.linalg.eigvalsh(after).min() > -rounding
    assert np.linalg.eigvalsh(cov - after).min() > -rounding


@pytest.mark.parametrize("directions", ["one", "two", "all"])
def test_a_hundred_thousand_updates_with_tiny_noise_leave_a_covariance(directions):
    rng = np.random.default_rng(1)
    mean, cov = (
        np.zeros(4),
        np.array([[4.0, 1.0, 0.5, 0.0], [1.0, 3.0, 0.0, 0.5], [0.5, 0.0, 2.0, 1.0], [0.0, 0.5, 1.0, 5.0]]),
    )
    gain, scratch = np.empty(4), np.empty((4, 4))
    rows = rng.standard_normal(({"one": 1, "two": 2, "all": 1000}[directions], 4))
    for k in range(100_000):
        joseph_scalar(mean, cov, rows[k % len(rows)], 0.0, 1e-12, gain, scratch)
    np.testing.assert_array_equal(cov, cov.T)
    # What was never measured keeps its size, so that rounding is relative to the largest variance.
    assert np.linalg.eigvalsh(cov).min() >= -4 * EPS * cov.diagonal().max()
    assert cov.diagonal().min() > 0


# -- square roots -----------------------------------------------------------------------------------------------------


@given(definite(), st.data())
def test_backward_solve_solves(matrix, data):
    factor, _ = factored(matrix)
    b = data.draw(arrays(float, len(matrix), elements=st.floats(-3.0, 3.0)))
    x = b.copy()
    backward_solve(factor, x)
    np.testing.assert_allclose(x, solve_triangular(factor.T, b), rtol=1e-9, atol=1e-12)


@given(SIZES.flatmap(lambda n: st.integers(n, n + 4).flatmap(lambda k: matrices(n, k))))
def test_triangularise_makes_a_factor_of_the_same_square(a):
    factor = triangularise(a.copy())
    assert np.all(np.triu(factor, 1) == 0)
    assert np.all(np.diag(factor) >= 0)
    # Householder's reflections are stable: the error is one of rounding in the entries that were there.
    np.testing.assert_allclose(factor @ factor.T, a @ a.T, atol=1e-13 * max(1.0, np.abs(a).max() ** 2))


@given(definite(), st.data(), st.sampled_from([1.0, -1.0]))
def test_a_rank_one_change_is_that_of_the_square(matrix, data, sign):
    direction = data.draw(arrays(float, len(matrix), elements=st.floats(-3.0, 3.0)))
    factor, _ = factored(matrix)
    # A downdate by less than all of it: x^T A^-1 x stays below one half.
    x = direction / np.sqrt(1 + 2 * direction @ np.linalg.solve(matrix, direction))
    assert rank_one(factor, x.copy(), sign)
    assert np.all(np.triu(factor, 1) == 0)
    np.testing.assert_allclose(factor @ factor.T, matrix + sign * np.outer(x, x), rtol=0, atol=1e-11)


@given(definite(), st.data())
def test_a_downdate_that_leaves_nothing_says_so(matrix, data):
    direction = data.draw(arrays(float, len(matrix), elements=st.floats(0.1, 3.0)))
    factor, _ = factored(matrix)
    x = 1.01 * direction / np.sqrt(direction @ np.linalg.solve(matrix, direction))
    assert not rank_one(factor, x, -1.0)
