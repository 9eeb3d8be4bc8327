"""Rank correlations are those of scipy, and their intervals cover."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from vse_gym.report.rank_correlation import kendall, resampled, spearman

RNG = np.random.default_rng


def noisy(means, seeds, noise, rng):
    """Runs (E, S) about the means of estimators."""
    return np.asarray(means, float)[:, None] + noise * rng.normal(size=(len(means), seeds))


few = st.integers(0, 4).map(float)  # ties, often


@given(arrays(float, (2, 7), elements=few))
def test_rank_correlations_are_those_of_scipy(pair):
    x, y = pair
    with np.errstate(all="ignore"):
        if np.ptp(x) == 0 or np.ptp(y) == 0:
            assert np.isnan(spearman(x, y)) and np.isnan(kendall(x, y))
        else:
            assert spearman(x, y) == pytest.approx(stats.spearmanr(x, y).statistic)
            assert kendall(x, y) == pytest.approx(stats.kendalltau(x, y).statistic)


def test_many_samples_at_once_are_each_by_itself():
    x, y = RNG(0).normal(size=(2, 3, 4, 6))
    for rank in (spearman, kendall):
        np.testing.assert_allclose(rank(x, y)[2, 1], rank(x[2, 1], y[2, 1]))
    assert np.isnan(spearman(np.array([1.0, np.nan, 2.0]), np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize(("regret", "rho"), [([1, 4, 2, 0, 3], 0.0), ([0, 2, 1, 3, 4], 0.9)])
def test_the_interval_over_seeds_covers_at_least_as_often_as_it_says(regret, rho):
    # The estimators are as they are, and their true means have this rank correlation exactly; seeds are the chance.
    error, trials, inside, rng = np.arange(5), 100, 0, RNG(1)
    assert spearman(error, np.array(regret)) == pytest.approx(rho)
    for _ in range(trials):
        x, y = (noisy(means, 12, 1.5, rng) for means in (error, regret))

        def rank(seeds, x=x, y=y):
            return spearman(x[:, seeds].mean(axis=-1).T, y[:, seeds].mean(axis=-1).T)[:, None]

        _, low, high = resampled(rank, 12)
        inside += low[0] - 1e-9 <= rho <= high[0] + 1e-9
    # A bootstrap of ranks errs to the side of too wide; 100 trials of 95 % scatter by 2.2 %.
    assert inside / trials >= 0.91


def test_the_interval_covers_a_clear_order_though_noise_pulls_the_value_towards_0():
    trials, inside, rng = 100, 0, RNG(3)
    for _ in range(trials):
        means = rng.normal(size=12)
        other = 0.8 * means + 0.6 * rng.normal(size=12)
        x, y = (noisy(of, 10, 1.0, rng) for of in (means, other))  # noise: 1/11 of the variance of means

        def rank(seeds, x=x, y=y):
            return spearman(x[:, seeds].mean(axis=-1).T, y[:, seeds].mean(axis=-1).T)[:, None]

        _, low, high = resampled(rank, 10)
        inside += low[0] <= spearman(means, other) <= high[0]
    assert inside / trials >= 0.91  # 100 trials of 95 % scatter by 2.2 %; percentiles alone cover 83 %


def test_the_interval_reaches_to_both_sides_of_the_value_and_no_farther_than_a_figure_can():
    draws = {"rho": 0.9, "gain": 1.5}

    def statistic(seeds):  # what is drawn lies below the value
        whole = (seeds == np.arange(8)).all(axis=1)
        return np.where(whole[:, None], list(draws.values()), [[0.5, 0.7]])

    value, low, high = resampled(statistic, 8, largest=np.array([1, 2]))
    assert value.tolist() == [0.9, 1.5] and low.tolist() == [0.5, 0.7] and high.tolist() == [1, 2]
