"""The fuzzy controller: monotone, one at rest, and what scikit-fuzzy makes of the same rules."""

import numpy as np
import pytest
import skfuzzy
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.inference.fuzzy import CENTRES, OUTPUTS, RULES, SETS, fuzzy_factor, rule_surface
from vse_gym.inference.gaussian import Extended, filter_step
from vse_gym.inference.gaussian.fuzzy_adaptive import FuzzyAdaptive

UNIT = st.floats(-1.5, 1.5)


@given(UNIT, UNIT, st.floats(0.0, 1.0))
def test_the_factor_never_falls_as_an_input_rises(e, change, more):
    surface = rule_surface()
    here = fuzzy_factor(surface, e, change)
    assert fuzzy_factor(surface, e + more, change) >= here * (1 - 1e-12)
    assert fuzzy_factor(surface, e, change + more) >= here * (1 - 1e-12)


@given(UNIT, UNIT)
def test_more_than_expected_raises_the_noise_and_less_lowers_it_within_bounds(e, change):
    factor = fuzzy_factor(rule_surface(), e, change)
    assert 0.1 <= factor <= 100 * (1 + 1e-12)
    assert fuzzy_factor(rule_surface(), 0.0, change) == 1.0
    assert factor >= 1 if e > 0 else factor <= 1
    if abs(e) > 1e-6:
        assert factor != 1


@pytest.mark.parametrize("inputs", [(np.nan, 0.0), (0.5, np.nan), (np.nan, np.nan)])
def test_where_nothing_is_known_the_noise_stays(inputs):
    assert fuzzy_factor(rule_surface(), *inputs) == 1.0


def test_it_is_what_scikit_fuzzy_makes_of_the_rules():
    universe, log_u = np.linspace(-1, 1, 601), np.linspace(-1.2, 2.4, 3601)  # wide enough for whole outer sets
    centres = np.linspace(-1, 1, len(SETS))
    inputs = [skfuzzy.trimf(universe, [c - 1 / 3, c, c + 1 / 3]) for c in centres]
    outputs = dict(zip(OUTPUTS, (skfuzzy.trimf(log_u, [c - 0.4, c, c + 0.4]) for c in CENTRES), strict=True))
    rules = [line.split() for line in RULES.strip().splitlines()]
    for e, change in np.random.default_rng(0).uniform(-1, 1, (60, 2)):
        first, second = ([skfuzzy.interp_membership(universe, mf, value) for mf in inputs] for value in (e, change))
        total = sum(a * b * outputs[rules[i][j]] for i, a in enumerate(first) for j, b in enumerate(second))
        expected = skfuzzy.defuzz(log_u, total, "centroid")
        # The universes are sampled in steps of 1/300 and 1e-3
        assert np.log10(fuzzy_factor(rule_surface(), e, change)) == pytest.approx(expected, abs=1e-3)


# -- the rule that adapts measurement variances with it ---------------------------------------------------------------


def fuzzy(surface, window=30.0):
    return FuzzyAdaptive(Extended(), np.ones(3), surface, window, 2.0, 0.1)


def drive(rule, model, readings):
    """Means (T, n), and the variances' factors (T, m) by what the memory says of them."""
    mean, cov = model.prior_mean, model.prior_cov
    memory = np.tile([-1.0, 0.0], 3) if isinstance(rule, FuzzyAdaptive) else np.empty(0)
    means, ratios = [], []
    for y in readings:
        mean, cov, memory, _, _ = filter_step(rule, model, mean, cov, memory, np.zeros(1), y)
        means.append(mean)
        ratios.append(10 ** (2.0 * memory[1::2]))
    return np.array(means), np.array(ratios)


def test_with_a_flat_surface_it_is_the_rule_inside(linear, linear_drive):
    adapted, _ = drive(fuzzy(np.zeros((7, 7))), linear, linear_drive.readings)
    plain, _ = drive(Extended(), linear, linear_drive.readings)
    np.testing.assert_array_equal(adapted, plain)


@pytest.mark.parametrize("times", [1.0, 30.0])
def test_it_sees_how_much_the_noise_has_grown(linear, times):
    rng, steps = np.random.default_rng(3), 1500
    x, readings = linear.prior_mean, np.empty((steps, 3))
    for k in range(steps):
        x = rng.multivariate_normal(linear.F @ x, linear.process_cov)
        readings[k] = rng.normal(linear.H @ x, np.sqrt(times * linear.R))
    _, ratios = drive(fuzzy(rule_surface()), linear, readings)
    seen = np.exp(np.log(ratios[100:]).mean(axis=0))  # the doubt about the state, in both variances, dilutes it
    assert np.all(seen > 0.3 * times) and np.all(seen < 1.5 * times)


def test_noise_that_has_grown_harms_it_less(linear):
    rng, steps = np.random.default_rng(4), 1500
    x, states, readings = linear.prior_mean, np.empty((steps, 2)), np.empty((steps, 3))
    for k in range(steps):
        states[k] = x = rng.multivariate_normal(linear.F @ x, linear.process_cov)
        readings[k] = rng.normal(linear.H @ x, np.sqrt(50 * linear.R))
    plain, adapted = (
        np.sqrt(np.mean((drive(rule, linear, readings)[0] - states) ** 2))
        for rule in (Extended(), fuzzy(rule_surface()))
    )
    assert adapted < 0.7 * plain
