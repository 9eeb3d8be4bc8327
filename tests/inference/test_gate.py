"""The innovation gate: what is far off is left out, what stays far off is believed in the end."""

import numpy as np
import pytest

from vse_gym.inference.gaussian import Extended, Gated, Unscented, correct, filter_drive, filter_step
from vse_gym.inference.gaussian.gate import refuse
from vse_gym.inference.linear import Kalman, kalman_drive

RULES = {"extended": Extended(), "unscented": Unscented()}
rules = pytest.mark.parametrize("rule", RULES.values(), ids=RULES)


def behind_gate(linear):
    """The model, with room to count refusals of its three channels."""
    return linear._replace(memory=np.zeros(3))


def test_a_channel_passes_up_to_the_limit_of_its_own_variance():
    y, expected, spread = np.array([2.9, 3.1, -3.1, np.nan]), np.zeros(4), np.array([0.5, 0.5, 0.5, 0.5])
    variances, refused = np.array([0.5, 0.5, 0.5, np.nan]), np.zeros(4)
    refuse(9.0, 5.0, y, expected, spread, variances, refused)
    np.testing.assert_array_equal(np.isnan(variances), [False, True, True, True])
    np.testing.assert_array_equal(refused, [0, 1, 1, 0])


def test_a_channel_refused_too_often_is_let_through_until_it_agrees_again():
    passed, refused = [], np.zeros(1)
    for reading in [9, 9, 9, 9, 9, 1, 9, 9]:  # of a limit of 3, with a patience of three
        variances = np.ones(1)
        refuse(9.0, 3.0, np.array([float(reading)]), np.zeros(1), np.zeros(1), variances, refused)
        passed.append(bool(np.isfinite(variances[0])))
    assert passed == [False, False, False, True, True, True, False, False]


@rules
def test_a_gate_that_lets_everything_pass_changes_nothing(rule, linear, linear_drive):
    model = behind_gate(linear)
    start = linear.prior_mean, linear.prior_cov
    gated = filter_drive(
        Gated(rule, np.inf, 5.0), model, *start, model.memory, linear_drive.inputs, linear_drive.readings
    )
    free = filter_drive(rule, linear, *start, linear.memory, linear_drive.inputs, linear_drive.readings)
    np.testing.assert_array_equal(gated[0], free[0])
    np.testing.assert_array_equal(gated[1], free[1])


@rules
def test_an_outlier_is_a_silent_channel_and_counts_for_nothing(rule, linear):
    model, gated, u = behind_gate(linear), Gated(rule, 9.0, 5.0), np.zeros(1)
    start = linear.prior_mean, linear.prior_cov
    wild, silent = np.array([1.0, 50.0, 2.0]), np.array([1.0, np.nan, 2.0])
    mean, cov, memory, nis, dof = filter_step(gated, model, *start, model.memory, u, wild)
    expected = filter_step(rule, linear, *start, linear.memory, u, silent)
    np.testing.assert_array_equal(mean, expected[0])
    np.testing.assert_array_equal(cov, expected[1])
    assert (nis, dof) == expected[3:]
    assert dof == 2
    np.testing.assert_array_equal(memory, [0, 1, 0])


def drives(linear, linear_drive, readings):
    """Means of the gated filters over readings: extended, unscented, Kalman's."""
    model = behind_gate(linear)
    arguments = model, linear.prior_mean, linear.prior_cov, model.memory, linear_drive.inputs, readings
    yield from (filter_drive(Gated(rule, 9.0, 5.0), *arguments)[0] for rule in RULES.values())
    yield kalman_drive(Kalman(9.0, 5.0), *arguments)[0]


def test_bursts_do_less_harm(linear, linear_drive):
    # Of up to four readings, 20 standard deviations high, in every third stretch of ten.
    readings = linear_drive.readings.copy()
    for k in range(10, 100, 30):
        readings[k : k + 4, 0] += 20.0
    start = linear.prior_mean, linear.prior_cov, linear.memory
    ungated, _ = filter_drive(Extended(), linear, *start, linear_drive.inputs, readings)
    harm = np.abs(ungated - linear_drive.means).max()
    for means in drives(linear, linear_drive, readings):
        assert np.abs(means - linear_drive.means).max() < 0.1 * harm


def test_a_filter_sure_of_a_wrong_state_finds_back(linear, linear_drive):
    model = behind_gate(linear)._replace(prior_mean=np.array([500.0, 500.0]), prior_cov=1e-3 * np.eye(2))
    arguments = model, model.prior_mean, model.prior_cov, model.memory, linear_drive.inputs, linear_drive.readings
    for means in (
        *(filter_drive(Gated(rule, 9.0, 5.0), *arguments)[0] for rule in RULES.values()),
        kalman_drive(Kalman(9.0, 5.0), *arguments)[0],
    ):
        assert np.abs(means - linear_drive.means)[40].max() < 0.5


@rules
def test_correct_is_that_of_the_rule_behind_it(rule, linear):
    arguments = linear, linear.prior_mean, linear.prior_cov, np.zeros(1), np.ones(3), linear.R
    for mine, theirs in zip(correct(Gated(rule, 9.0, 5.0), *arguments), correct(rule, *arguments), strict=True):
        np.testing.assert_array_equal(mine, theirs)
