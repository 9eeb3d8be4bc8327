"""The strong tracking rule: orthogonal innovations after a change, the extended rule before it, bursts."""

import numpy as np
import pytest

from vse_gym.inference.gaussian import (
    Extended,
    Gated,
    StrongTracking,
    covariance,
    fading_factors,
    filter_drive,
    filter_step,
    keep,
    predict,
)
from vse_gym.inference.gaussian.strong_tracking import fade

NOTHING = np.empty(0)


def tracking(states=2, channels=3, forgetting=0.95, weakening=1.5, shares=None, **more):
    shares = np.ones(states) if shares is None else np.array(shares)
    return StrongTracking(forgetting, weakening, shares, np.ones(channels), **{"whitened": 1.0, **more})


@pytest.fixture(scope="module")
def cart(linear):
    """Position and speed of a cart that is believed to keep its speed; its position is read."""
    return linear._replace(
        F=np.array([[1.0, 0.1], [0.0, 1.0]]),
        G=np.zeros((2, 1)),
        H=np.array([[1.0, 0.0]]),
        R=np.array([0.01]),
        prior_mean=np.zeros(2),
        prior_cov=0.01 * np.eye(2),
        process_cov=np.diag([1e-6, 1e-5]),
    )


def shoved(seed, steps=300, push=1.0):
    """Readings of a cart that stands, and from the 100th step on is pushed."""
    time = 0.1 * np.maximum(0, np.arange(steps) - 100)
    return 0.5 * push * time**2 + np.random.default_rng(seed).normal(0, 0.1, steps)


def ride(rule, cart, readings):
    """Innovations and fading factors of a drive."""
    mean, kept, memory = cart.prior_mean, keep(rule, cart.prior_cov), NOTHING
    innovations, factors, u = [], [], np.zeros(1)
    for reading in readings:
        expected = cart.H @ predict(rule, cart, mean, kept, u)[0]
        innovations.append(reading - expected[0])
        mean, kept, memory, _, _ = filter_step(rule, cart, mean, kept, memory, u, np.array([reading]))
        factors.append(fading_factors(kept) if isinstance(rule, StrongTracking) else np.ones(2))
    return np.array(innovations), np.array(factors)


def correlation(innovations, lag):
    return np.sum(innovations[lag:] * innovations[:-lag]) / np.sum(innovations**2)


def test_when_nothing_fades_it_is_the_extended_rule_to_the_last_bit(linear, linear_drive):
    start = linear.prior_mean, linear.prior_cov, linear.memory
    ours = filter_drive(tracking(weakening=1e6), linear, *start, linear_drive.inputs, linear_drive.readings)
    theirs = filter_drive(Extended(), linear, *start, linear_drive.inputs, linear_drive.readings)
    np.testing.assert_array_equal(ours[0], theirs[0])
    np.testing.assert_array_equal(ours[1], theirs[1])


def test_it_makes_innovations_orthogonal_after_a_change_and_the_extended_rule_does_not(cart):
    for seed in range(5):
        readings = shoved(seed)
        after = [ride(rule, cart, readings)[0][110:] for rule in (Extended(), tracking(channels=1, weakening=1.0))]
        # Of 190 white innovations a correlation has a standard deviation of 0.07.
        assert min(correlation(after[0], lag) for lag in (1, 2, 5)) > 0.8
        assert max(abs(correlation(after[1], lag)) for lag in (1, 2, 5)) < 0.3


def test_factors_rise_at_the_change_and_fall_again(cart):
    # Pushed for 3 s, 60 times harder than its noise expects, then left alone: it keeps its speed, as it is believed to.
    time = 0.1 * np.maximum(0, np.arange(400) - 100)
    course = np.where(time < 3, 10 * time**2, 90 + 60 * (time - 3))
    readings = course + np.random.default_rng(1).normal(0, 0.1, 400)
    _, factors = ride(tracking(channels=1), cart, readings)
    assert np.median(factors[20:100]) == 1.0
    assert factors[101:130].max() > 5
    assert np.median(factors[250:]) == 1.0


def test_what_a_factor_is():
    # One state, one channel: F P F^T = P- - Q = 3, H = 2, N = v^2 - H Q H^T - beta R, M = H 3 H.
    rule = tracking(1, 1, weakening=1.5, whitened=0.0)
    kept = keep(rule, np.array([[3.5]]))
    known = np.array([[1.0]]), np.array([[0.5]]), np.array([[2.0]])  # prior, Q and H
    after = fade(rule, kept, *known, np.array([8.0]), np.array([4.0]))
    wanted = (64 - 4 * 0.5 - 1.5 * 4) / (4 * 3)
    assert fading_factors(after)[0] == pytest.approx(wanted)
    assert covariance(rule, after)[0, 0] == pytest.approx(wanted * 3 + 0.5)
    # The second innovation is weighed with the first: V = (0.95 64 + 144)/1.95.
    again = fade(rule, after, *known, np.array([12.0]), np.array([4.0]))
    held = covariance(rule, after)[0, 0] - 0.5
    assert fading_factors(again)[0] == pytest.approx(((0.95 * 64 + 144) / 1.95 - 8) / (4 * held))


def test_a_state_fades_up_to_a_multiple_of_its_prior_and_never_shrinks(cart):
    readings = shoved(1, push=100.0)
    for largest in (0.5, 20.0):
        rule = tracking(channels=1, shares=[1.0, 10.0], largest=largest)
        mean, kept, u = cart.prior_mean, keep(rule, cart.prior_cov), np.zeros(1)
        limited = 0
        for reading in readings:
            _, before = predict(rule, cart, mean, kept, u)
            columns = cart.H, np.array([reading]) - cart.H @ (cart.F @ mean), cart.R
            faded = fade(rule, before, cart.prior_cov, cart.process_cov, *columns)
            held = np.diag(covariance(rule, before) - cart.process_cov)
            after = np.diag(covariance(rule, faded) - cart.process_cov)
            assert np.all(after <= np.maximum(held, largest * np.diag(cart.prior_cov)) * (1 + 1e-9))
            assert np.all(after >= held * (1 - 1e-9))
            limited += np.any(np.isclose(after, largest * np.diag(cart.prior_cov), rtol=1e-9))
            mean, kept, *_ = filter_step(rule, cart, mean, kept, NOTHING, u, np.array([reading]))
        assert limited > 10


def test_whitened_it_knows_no_units(linear, linear_drive):
    scale = np.array([1.0, 100.0, 0.01])
    other = linear._replace(H=scale[:, None] * linear.H, R=scale**2 * linear.R)
    readings = linear_drive.readings + np.array([0.0, 3.0, 0.0])  # off, so that it fades
    start = linear.prior_mean, linear.prior_cov, linear.memory
    found = {
        whitened: [
            filter_drive(tracking(whitened=whitened, weakening=1.0), model, *start, linear_drive.inputs, y)[0]
            for model, y in ((linear, readings), (other, scale * readings))
        ]
        for whitened in (0.0, 1.0)
    }
    np.testing.assert_allclose(found[1.0][0], found[1.0][1], atol=1e-6)  # central differences
    assert np.abs(found[0.0][0] - found[0.0][1]).max() > 1e-3


def test_shares_say_which_state_fades(cart):
    readings = shoved(2)
    _, alike = ride(tracking(channels=1), cart, readings)
    np.testing.assert_array_equal(alike[:, 0], alike[:, 1])
    _, speed = ride(tracking(channels=1, shares=[1.0, 10.0]), cart, readings)
    both = speed[:, 0] > 1
    assert both.any()
    np.testing.assert_allclose(speed[both, 1], 10 * speed[both, 0], rtol=1e-12)


def test_faded_covariances_stay_positive_definite(linear, linear_drive):
    readings = linear_drive.readings + 50.0 * (np.arange(100)[:, None] % 7 == 0)
    rule = tracking(shares=[1.0, 20.0])
    _, covs = filter_drive(
        rule, linear, linear.prior_mean, linear.prior_cov, linear.memory, linear_drive.inputs, readings
    )
    assert np.linalg.eigvalsh(covs).min() > 0


def test_an_outlier_is_a_change_to_it_unless_a_gate_refuses_it(cart):
    readings = np.random.default_rng(3).normal(0, 0.1, 200)
    readings[150] += 5.0
    free = tracking(channels=1)
    moved = {}
    for name, rule in (("extended", Extended()), ("free", free), ("gated", Gated(free, 16.0, 5.0))):
        model = cart._replace(memory=np.zeros(1)) if name == "gated" else cart
        means, _ = filter_drive(
            rule, model, cart.prior_mean, cart.prior_cov, model.memory, np.zeros((200, 1)), readings[:, None]
        )
        moved[name] = np.abs(means[150:170, 0]).max()
    assert moved["free"] > 4 * moved["extended"]  # it follows the outlier nearly all the way
    assert moved["free"] > 2.5
    assert moved["gated"] < 0.3
    _, factors = ride(free, cart, readings)
    assert factors[150].max() > 100


def test_a_silent_channel_is_not_counted(linear):
    rule, u = tracking(), np.zeros(1)
    kept = keep(rule, linear.prior_cov)
    _, after, _, _, dof = filter_step(rule, linear, linear.prior_mean, kept, NOTHING, u, np.full(3, np.nan))
    assert dof == 0
    np.testing.assert_array_equal(fading_factors(after), 1.0)
    np.testing.assert_array_equal(after[3:], -1.0)
