"""Adaptive autoregressions: known processes, another library's least squares, poles, the printed gain."""

import numpy as np
import padasip
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from vse_gym.inference.autoregression import (
    AutoregressionTuning,
    adapt,
    autoregressions,
    coefficients_used,
    is_stable,
    retreat,
)

AR2 = np.array([1.6, -0.8])
AR3 = np.array([0.9, 0.3, -0.4])


def learning(order, rate=0.002, window=64.0, printed=0.0, radius=1.0, noise_rate=0.02):
    start = np.zeros(order)
    start[0] = 1.0
    return AutoregressionTuning(rate, noise_rate, printed, window, radius, start)


def process(coefficients, steps, seed, sigma=1.0):
    return lfilter([sigma], [1.0, *-coefficients], np.random.default_rng(seed).standard_normal(steps))


def follow(adaptation, series):
    """Autoregressions after every sample of series (T, n)."""
    ar, out = autoregressions(adaptation, series[0]), []
    for values in series[1:]:
        ar = adapt(adaptation, ar, values)
        out.append(ar)
    return out


@pytest.mark.parametrize("coefficients", [AR2, AR3], ids=["second order", "third order"])
def test_it_recovers_the_coefficients_of_a_known_process(coefficients):
    found = follow(learning(coefficients.size), process(coefficients, 20_000, 1)[:, None])[-1]
    # Forgetting leaves 2/UC samples: each coefficient's standard deviation is at most sqrt((1 - a_p^2) UC/2), 0.03.
    np.testing.assert_allclose(found.coefficients[0], coefficients, atol=4 * np.sqrt(0.001))
    assert found.variances[0] == pytest.approx(1.0, rel=0.5)  # of 2/0.02 samples: 14 %


def test_each_series_has_its_own():
    series = np.column_stack((process(AR2, 8000, 1), 1e-3 * process(np.array([0.5, 0.2]), 8000, 2)))
    together = follow(learning(2), series)[-1]
    for i in range(2):
        alone = follow(learning(2), series[:, i : i + 1])[-1]
        np.testing.assert_array_equal(together.coefficients[i], alone.coefficients[0])
        np.testing.assert_array_equal(together.variances[i], alone.variances[0])


def test_it_follows_a_change():
    after = np.array([0.5, -0.6])
    series = np.concatenate((process(AR2, 3000, 1), process(after, 3000, 2)))
    found = follow(learning(2, rate=0.01), series[:, None])
    # Five memories of 1/UC later the first process counts 0.7 %; standard deviation 0.07.
    np.testing.assert_allclose(found[-1].coefficients[0], after, atol=0.25)
    np.testing.assert_allclose(found[2900].coefficients[0], AR2, atol=0.25)


def test_it_is_padasips_least_squares():
    adaptation = learning(3, rate=0.01, window=0.0, radius=2.0)  # so that no step is cut short
    series = process(AR3, 400, 3)
    other = padasip.filters.FilterRLS(3, mu=0.99, eps=1 / 1e-2, w=adaptation.start.copy())  # eps: 1/A_0
    found = follow(adaptation, series[:, None])
    x = np.full(3, series[0])
    for ar, value in zip(found, series[1:], strict=True):
        other.adapt(value, x)
        np.testing.assert_allclose(ar.coefficients[0], other.w, rtol=1e-9, atol=1e-11)
        x = np.array([value, *x[:2]])


def test_it_is_weighted_least_squares_in_one_go():
    rate, series = 0.01, process(AR3, 300, 4)
    adaptation = learning(3, rate=rate, window=0.0, radius=2.0)
    ar = follow(adaptation, series[:, None])[-1]
    past = np.concatenate((np.full(3, series[0]), series[1:]))
    rows = np.column_stack([past[2 - k : 2 - k + 299] for k in range(3)])
    age = np.arange(298, -1, -1)
    weights = (1 - rate) ** age
    # What was known before the first sample has the oldest weight; A_0 is 0.01.
    prior = (1 - rate) ** 299 / 1e-2 * np.eye(3)
    normal = rows.T @ (weights[:, None] * rows) + prior
    wanted = np.linalg.solve(normal, rows.T @ (weights * series[1:]) + prior @ adaptation.start)
    np.testing.assert_allclose(ar.coefficients[0], wanted, rtol=1e-8)
    np.testing.assert_allclose(ar.covs[0], np.linalg.inv(normal), rtol=1e-6)


def test_the_first_window_is_plain_least_squares_and_until_then_everything_stays():
    adaptation, series = learning(2, window=64.0), process(AR2, 66, 5)
    found = follow(adaptation, series[:, None])
    for ar in found[:63]:
        np.testing.assert_array_equal(coefficients_used(adaptation, ar), [[1.0, 0.0]])
    past = np.concatenate((np.full(2, series[0]), series[1:]))
    rows = np.column_stack([past[1 - k : 1 - k + 64] for k in range(2)])
    wanted = np.linalg.lstsq(rows, series[1:65], rcond=None)[0]
    # Before it, each coefficient is known with a variance of half a million.
    np.testing.assert_allclose(coefficients_used(adaptation, found[63])[0], wanted, atol=1e-5)


# -- the printed gain -------------------------------------------------------------------------------------------------


def test_least_squares_knows_no_units_and_the_printed_gain_does():
    series = process(AR2, 2000, 6)
    ours, printed = {}, {}
    for scale in (0.01, 1.0, 100.0):
        ours[scale] = follow(learning(2), scale * series[:, None])[-1].coefficients[0]
        printed[scale] = follow(learning(2, printed=1.0, window=0.0), scale * series[:, None])[-1].coefficients[0]
    # What is known before the window, 1/A_0, has units; beside 64 samples of 0.01 it counts 2e-4.
    np.testing.assert_allclose(ours[0.01], ours[1.0], atol=2e-3)
    np.testing.assert_allclose(ours[100.0], ours[1.0], atol=2e-3)
    np.testing.assert_allclose(printed[0.01], [1.0, 0.0], atol=1e-4)  # a small series is not learnt from
    assert np.abs(printed[100.0] - AR2).max() > 0.1  # a large one takes the whole of each error


def test_the_printed_gain_takes_all_of_a_large_series_error_at_once():
    found = follow(learning(2, printed=1.0, window=0.0, radius=10.0), 1000.0 * np.array([[1.0], [1.2], [0.9], [1.1]]))
    for before, after, value in zip(found[:-1], found[1:], (900.0, 1100.0), strict=True):
        assert after.coefficients[0] @ before.past[0] == pytest.approx(value, rel=1e-6)


# -- poles ------------------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=5), st.floats(0.5, 1.0))
def test_stability_is_that_of_the_polynomials_roots(coefficients, radius):
    outermost = np.abs(np.roots([1.0, *(-a for a in coefficients)])).max(initial=0.0)
    if abs(outermost - radius) > 1e-3:  # multiple roots are known to a fifth root of rounding only
        assert is_stable(np.array(coefficients), radius) == (outermost < radius)


def test_a_constant_is_stable():
    assert is_stable(np.array([1.0, 0.0, 0.0]), 1.0)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_a_step_is_taken_as_far_as_the_poles_allow(wanted):
    wanted, still = np.array(wanted), np.array([1.0, 0.0, 0.0])
    found = wanted.copy()
    retreat(still, found, 1.0)
    assert is_stable(found, 1.0)
    if is_stable(wanted, 1.0):
        np.testing.assert_array_equal(found, wanted)
    along, way = found - still, wanted - still
    np.testing.assert_allclose(along * way[0], way * along[0], atol=1e-12)  # on the line between the two


def test_an_exploding_series_leaves_stable_poles():
    series = 1.05 ** np.arange(300)[:, None] * np.random.default_rng(7).normal(1, 0.1, (300, 1))
    for ar in follow(learning(3), series)[64:]:
        assert is_stable(ar.coefficients[0], 1.0)


@pytest.mark.parametrize("printed", [0.0, 1.0])
@pytest.mark.parametrize("value", [0.0, 20.0])
def test_a_series_that_says_nothing_winds_nothing_up(printed, value):
    adaptation = learning(3, rate=0.03, printed=printed)
    quiet = np.full((5000, 1), value)
    ar = follow(adaptation, quiet)[-1]
    assert np.isfinite(ar.coefficients).all()
    assert np.trace(ar.covs[0]) <= 1.1e6
    assert ar.coefficients[0].sum() == pytest.approx(1.0, abs=1e-6)  # it stays as it is
