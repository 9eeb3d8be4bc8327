"""Each law against its density, its moments or its definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from vse_gym.noise import (
    CONTAMINATIONS,
    cauchy_gaussian,
    contamination,
    episodes,
    fisher_information,
    growing_sigma,
    random_walk,
    student_t,
)

DT = 0.01
SEEDS = [0, 1, 2]
every_rule = pytest.mark.parametrize("rule", CONTAMINATIONS)


def mixture(alpha, scale, rule="published"):
    """Distribution function of a Cauchy share and a normal one of variance 2 scale^2."""
    share = contamination(alpha, rule)
    heavy, core = stats.cauchy(scale=scale), stats.norm(scale=np.sqrt(2) * scale)
    return lambda x: share * heavy.cdf(x) + (1 - share) * core.cdf(x)


def assert_follows(draws, distribution):
    # Kolmogorov's bound at the 0.1 % level, for any sample size.
    assert stats.kstest(draws, distribution).statistic < 1.95 / np.sqrt(draws.size)


def runs(flags):
    """Lengths of the unbroken runs of true in a column."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return edges[1::2] - edges[::2]


@every_rule
def test_the_contamination_runs_from_all_cauchy_to_all_gaussian(rule):
    assert contamination(1, rule) == 1
    assert contamination(2, rule) == 0


def test_the_published_contamination_is_the_printed_one():
    assert contamination(1.3) == pytest.approx((4 - 1.69) / 5.07, rel=1e-12)


@every_rule
@given(st.floats(1, 2), st.floats(1, 2))
def test_heavier_tails_mean_more_contamination(rule, one, other):
    heavier, lighter = sorted((one, other))
    assert 1 >= contamination(heavier, rule) >= contamination(lighter, rule) >= 0


@given(st.floats(1, 2))
def test_the_log_moment_rule_gives_the_stable_laws_mean_of_log_x(alpha):
    # E log|x| of a symmetric stable law of scale 1 is gamma (1/alpha - 1), with Euler's gamma: of the Cauchy law 0, of
    # the normal law of variance 2 -gamma/2. A mixture's is the mean of its parts'.
    share = contamination(alpha, "log_moment")
    assert -(1 - share) * np.euler_gamma / 2 == pytest.approx(np.euler_gamma * (1 / alpha - 1), abs=1e-12)


@pytest.mark.parametrize("alpha", [1.1, 1.3, 1.5, 1.7])
def test_the_log_moment_rule_fits_the_stable_law_twice_as_well(alpha):
    x = np.concatenate(([0.0], np.logspace(-3, 3, 100)))
    stable = stats.levy_stable.cdf(x, alpha, 0.0)
    published, other = (np.abs(mixture(alpha, 1.0, rule)(x) - stable).max() for rule in ("published", "log_moment"))
    assert published < 0.015
    assert other < 0.55 * published  # 0.46 to 0.51: the stable law's parametrisation is exact, its cdf good to 1e-6


def test_an_unknown_rule_is_told_the_known_ones():
    with pytest.raises(ValueError, match=r"alpha_rule must be one of published, log_moment, not 'best'"):
        contamination(1.5, "best")


@pytest.mark.parametrize("alpha", [0.999, 2.001, -1.5, float("nan"), float("inf")])
def test_an_alpha_outside_one_to_two_is_refused(alpha):
    with pytest.raises(ValueError, match="alpha must lie"):
        contamination(alpha)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("alpha", [1.0, 1.3, 1.5, 1.9, 2.0])
@pytest.mark.parametrize("scale", [1.0, 0.05])
@every_rule
def test_draws_follow_the_cauchy_gaussian_density(alpha, scale, seed, rule):
    draws = cauchy_gaussian(alpha, scale, (100_000,), np.random.default_rng(seed), rule)
    assert_follows(draws, mixture(alpha, scale, rule))


def test_the_core_has_the_variance_that_a_kalman_filter_is_told():
    draws = cauchy_gaussian(2.0, 0.7, (100_000,), np.random.default_rng(0))
    assert draws.var() == pytest.approx(2 * 0.7**2, rel=0.02)  # a variance of n normal draws spreads by sqrt(2/n)


@pytest.mark.parametrize(
    ("alpha", "information"), [(2.0, 1.0), (1.9, 0.977), (1.75, 0.947), (1.5, 0.903), (1.3, 0.883)]
)
def test_the_mixture_tells_nearly_as_much_of_its_location_as_its_core_alone(alpha, information):
    assert fisher_information(contamination(alpha)) == pytest.approx(information, abs=6e-4)


@pytest.mark.parametrize(
    ("share", "narrow", "wide"),
    [(0.05, 0.949, 0.901), (0.10, 0.908, 0.822), (0.20, 0.839, 0.685), (0.50, 0.677, 0.364)],
)
def test_a_wider_cauchy_part_tells_less(share, narrow, wide):
    assert fisher_information(share, ratio=1.0) == pytest.approx(narrow, abs=6e-4)
    assert fisher_information(share, ratio=3.0) == pytest.approx(wide, abs=6e-4)


@given(st.floats(0.01, 100))
def test_fisher_information_of_the_pure_laws_is_theirs(sigma):
    assert fisher_information(0.0, sigma) == pytest.approx(1 / sigma**2, rel=1e-12)
    assert fisher_information(1.0, 1.0, sigma) == pytest.approx(1 / (2 * sigma**2), rel=1e-8)  # Cauchy of that scale


@given(st.floats(0, 1), st.floats(0.01, 100), st.floats(0.1, 10))
def test_fisher_information_falls_with_the_square_of_the_scale(share, sigma, ratio):
    assert fisher_information(share, sigma, ratio) * sigma**2 == pytest.approx(
        fisher_information(share, 1.0, ratio), rel=1e-12
    )


@given(st.floats(0, 1), st.floats(0.1, 10))
def test_a_mixture_tells_no_more_than_if_it_said_which_part_a_draw_is_from(share, ratio):
    assert fisher_information(share, ratio=ratio) <= (1 - share) + share / (2 * ratio**2) + 1e-9


@pytest.mark.parametrize("alpha", [1.3, 1.75])
def test_fisher_information_is_the_mean_squared_score_of_draws(alpha):
    share, size = contamination(alpha), 400_000
    z = cauchy_gaussian(alpha, np.sqrt(0.5), (size,), np.random.default_rng(0))
    density = lambda x: share * stats.cauchy.pdf(x, scale=np.sqrt(0.5)) + (1 - share) * stats.norm.pdf(x)  # noqa: E731
    square = ((np.log(density(z + 1e-5)) - np.log(density(z - 1e-5))) / 2e-5) ** 2
    assert square.mean() == pytest.approx(fisher_information(share), abs=4 * square.std() / np.sqrt(size))


@pytest.mark.parametrize(("share", "sigma", "ratio"), [(-0.1, 1, 1), (1.1, 1, 1), (0.5, 0, 1), (0.5, 1, -1)])
def test_fisher_information_of_no_law_is_refused(share, sigma, ratio):
    with pytest.raises(ValueError, match="share must lie in"):
        fisher_information(share, sigma, ratio)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("freedom", [1.0, 1.5, 3.0, 10.0])
def test_draws_follow_students_density_of_scale_one(freedom, seed):
    rng = np.random.default_rng(seed)
    assert_follows(student_t(rng.standard_normal(100_000), freedom, rng), stats.t(freedom).cdf)


def test_students_scale_is_not_its_standard_deviation():
    rng = np.random.default_rng(0)
    draws = student_t(rng.standard_normal(200_000), 10.0, rng)
    # Its kurtosis of 4 makes the standard deviation of so many draws spread by 0.2 %.
    assert draws.std() == pytest.approx(np.sqrt(10 / 8), rel=0.01)


@given(st.integers(0, 2**32), st.floats(1, 100))
def test_a_students_draw_has_the_sign_of_the_normal_one_it_came_from(seed, freedom):
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal((5, 3))
    np.testing.assert_array_equal(np.sign(student_t(normal, freedom, rng)), np.sign(normal))


def test_with_many_degrees_of_freedom_the_draws_are_the_normal_ones():
    rng = np.random.default_rng(0)
    normal = rng.standard_normal(1000)
    # The factor spreads by 1/sqrt(2 freedom), here 7e-6.
    np.testing.assert_allclose(student_t(normal, 1e10, rng), normal, rtol=1e-4)


@given(st.floats(0, 10), st.floats(0, 5), st.floats(0.1, 10))
def test_noise_grows_from_the_sheets_sigma_to_the_factor_and_its_variance_in_proportion(factor, begin, lasts):
    time = begin + lasts * np.array([-1.0, 0.0, 0.25, 0.5, 1.0, 2.0])
    variance = growing_sigma(time, factor, begin, begin + lasts) ** 2
    shares = [0.0, 0.0, 0.25, 0.5, 1.0, 1.0]
    # Subtracting times costs digits where a growth begins late and is short: some 1e-14.
    np.testing.assert_allclose(variance, 1 + (factor**2 - 1) * np.array(shares), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("dt", [0.01, 0.04])
def test_a_walk_begins_at_zero_and_its_steps_are_independent_normals_of_variance_dt(dt, seed):
    walk = random_walk(20_001, 3, dt, np.random.default_rng(seed))
    assert not walk[0].any()
    steps = np.diff(walk, axis=0) / np.sqrt(dt)
    assert_follows(steps.ravel(), stats.norm.cdf)
    both = np.column_stack((steps[1:], steps[:-1]))  # each channel, and each one step ago
    assert np.abs(np.corrcoef(both.T) - np.eye(6)).max() < 5 / np.sqrt(20_000)  # five standard deviations


@pytest.mark.parametrize("dt", [0.01, 0.1])
def test_a_walks_variance_is_the_time_however_fine_the_steps(dt):
    ends = np.array([random_walk(1 + round(2.0 / dt), 3, dt, np.random.default_rng(seed))[-1] for seed in range(400)])
    assert ends.var() == pytest.approx(2.0, rel=0.2)  # 1200 normals: five times 4 %


@pytest.mark.parametrize("seed", SEEDS)
def test_episodes_last_as_long_as_they_may(seed):
    hit = episodes(0.05, 0.05, 0.2, 20_000, 20, DT, np.random.default_rng(seed))
    lengths = np.concatenate([runs(column != 0) for column in hit.T])
    assert lengths.size > 100
    # The end of the record may cut one a channel short; an overlap, 1 % here, makes one longer.
    assert np.mean(lengths >= 5) > 0.97
    assert np.mean(lengths <= 20) > 0.97
    # Uniform from 5 to 20 steps: mean 12.5, spread 4.3, of some 200.
    assert lengths.mean() == pytest.approx(12.5, abs=1.5)
    assert {5, 6, 19, 20} <= set(range(lengths.min(), lengths.max() + 1))


def test_no_rate_means_no_episode():
    assert not episodes(0.0, 0.05, 0.1, 1000, 7, DT, np.random.default_rng(0)).any()
