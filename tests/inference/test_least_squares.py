"""Recursive least squares: the same as all at once, as an independent library's, and calm when nothing is said."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from padasip.filters import FilterRLS

from vse_gym.inference.least_squares import LeastSquares, least_squares_step


def squares(p, forgetting=0.95, excitation=0.0, trace=np.inf, lower=-np.inf, upper=np.inf):
    return LeastSquares(forgetting, excitation, trace, np.full(p, float(lower)), np.full(p, float(upper)))


SPOKEN = st.floats(0.1, 3.0) | st.floats(-3.0, -0.1)


@given(st.data(), st.integers(1, 3), st.integers(1, 2), st.floats(0.8, 1.0))
def test_it_equals_weighted_least_squares_of_all_measurements_at_once(data, p, m, forgetting):
    steps = 8
    rows = data.draw(arrays(float, (steps, m, p), elements=SPOKEN))
    targets = data.draw(arrays(float, (steps, m), elements=st.floats(-5.0, 5.0)))
    variances = data.draw(arrays(float, m, elements=st.floats(0.1, 4.0)))
    start, cov = np.arange(1.0, p + 1), 2.0 * np.eye(p)
    found, found_cov = start, cov
    for phi, y in zip(rows, targets, strict=True):
        found, found_cov = least_squares_step(squares(p, forgetting), found, found_cov, phi, y, variances)
    weights = forgetting ** np.arange(steps - 1, -1, -1.0)
    information = forgetting**steps * np.linalg.inv(cov)
    moment = information @ start
    for w, phi, y in zip(weights, rows, targets, strict=True):
        information = information + w * phi.T @ (phi / variances[:, None])
        moment = moment + w * phi.T @ (y / variances)
    # Rounding, times the condition of the information: at most 16 rows of size 3, over variances of 0.1
    np.testing.assert_allclose(found, np.linalg.solve(information, moment), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found_cov, np.linalg.inv(information), rtol=1e-9, atol=1e-12)


def test_it_equals_padasips():
    rng = np.random.default_rng(2)
    rows, truth = rng.normal(size=(300, 3)), np.array([1.0, -2.0, 0.5])
    targets = rows @ truth + 0.1 * rng.normal(size=300)
    theirs = FilterRLS(3, mu=0.97, eps=0.5, w="zeros")
    found, cov = np.zeros(3), np.eye(3) / 0.5
    for phi, y in zip(rows, targets, strict=True):
        theirs.adapt(y, phi)
        found, cov = least_squares_step(squares(3, 0.97), found, cov, phi[None], np.array([y]), np.ones(1))
        np.testing.assert_allclose(found, theirs.w, rtol=1e-9, atol=1e-9)  # they subtract where we add squares
    np.testing.assert_allclose(found, truth, atol=0.05)


@pytest.mark.parametrize("row", [[0.01, 0.02], [np.nan, 1.0]], ids=["too small", "not a number"])
def test_without_excitation_nothing_winds_up(row):
    settings = squares(2, 0.9, excitation=0.01)
    start, cov = np.array([1.0, 2.0]), np.eye(2)
    for _ in range(1000):
        found, found_cov = least_squares_step(settings, start, cov, np.array([row]), np.array([7.0]), np.ones(1))
    np.testing.assert_array_equal(found, start)
    np.testing.assert_array_equal(found_cov, cov)


def test_a_parameter_that_no_row_speaks_of_is_not_forgotten():
    found, cov = np.zeros(2), np.eye(2)
    rows = np.array([[1.0, 0.0], [0.0, 1.0]])
    for _ in range(1000):
        found, cov = least_squares_step(squares(2, 0.9), found, cov, rows, np.array([3.0, np.nan]), np.ones(2))
    assert found[0] == pytest.approx(3.0)
    assert found[1] == 0.0
    assert cov[1, 1] == 1.0
    assert cov[0, 0] == pytest.approx(0.1)  # P = P/lam - (P/lam)^2/(1 + P/lam) has the fixed point 1 - lam


def test_the_covariance_does_not_outgrow_its_cap():
    found, cov = np.zeros(2), np.eye(2)
    for _ in range(2000):  # always the same direction: across it, forgetting has nothing to hold it
        found, cov = least_squares_step(
            squares(2, 0.9, trace=50.0), found, cov, np.ones((1, 2)), np.array([1.0]), np.ones(1)
        )
        assert np.trace(cov) <= 50.0 * (1 + 1e-12)
        assert np.linalg.eigvalsh(cov)[0] > 0
    assert found.sum() == pytest.approx(1.0, abs=1e-3)


@given(arrays(float, (20, 2), elements=st.floats(-1e6, 1e6)))
def test_parameters_keep_their_bounds(targets):
    found, cov = np.zeros(2), np.eye(2)
    for y in targets:
        found, cov = least_squares_step(squares(2, 0.9, lower=-1.0, upper=2.0), found, cov, np.eye(2), y, np.ones(2))
        assert np.all((found >= -1.0) & (found <= 2.0))


def test_what_it_is_given_stays_as_it_was():
    given_ = np.zeros(1), np.eye(1), np.ones((1, 1)), np.ones(1), np.ones(1)
    copies = [a.copy() for a in given_]
    least_squares_step(squares(1), *given_)
    for before, after in zip(copies, given_, strict=True):
        np.testing.assert_array_equal(before, after)
