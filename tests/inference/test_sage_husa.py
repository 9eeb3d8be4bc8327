"""Reading noise found on line: what is found, its bounds, and the recursion beside one in NumPy."""

import numpy as np
import pytest

from vse_gym.inference.gaussian import (
    Cubature,
    Extended,
    Gated,
    SageHusa,
    Unscented,
    believe,
    filter_drive,
    filter_step,
    untaught,
)

B = 0.98


def ready(model, rule, readings=0.0):
    return model._replace(memory=np.concatenate((model.memory, untaught(rule, model.R.size, readings))))


def noisy(linear, factor, steps, seed=1):
    """Inputs and readings of a drive of the model whose reading noise has ``factor`` times the variance it is said."""
    rng = np.random.default_rng(seed)
    x = rng.multivariate_normal(linear.prior_mean, linear.prior_cov)
    inputs, readings = np.sin(0.1 * np.arange(steps))[:, None], np.empty((steps, 3))
    for k, u in enumerate(inputs):
        x = rng.multivariate_normal(linear.F @ x + linear.G @ u, linear.process_cov)
        readings[k] = rng.normal(linear.H @ x, np.sqrt(factor * linear.R))
    return inputs, readings


def factors(rule, linear, inputs, readings):
    """What is found after every reading, (T, 3)."""
    model = ready(linear, rule)
    mean, cov, memory, out = model.prior_mean, model.prior_cov, model.memory, []
    for u, y in zip(inputs, readings, strict=True):
        mean, cov, memory, _, _ = filter_step(rule, model, mean, cov, memory, u, y)
        out.append(memory[-6:-3])
    return np.array(out)


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_a_wrong_noise_level_is_found(linear, factor):
    # With hardly any fading the factor is a mean over the drive. Its scatter is about sqrt(2/T), 3 % with 2000
    # readings, more on the channels that share what they say: 20 % is far from both "as told" and wrong.
    rule = SageHusa(Cubature(), forgetting=0.9999, floor=0.01, cap=100.0, limit=np.inf)
    found = factors(rule, linear, *noisy(linear, np.array([factor, 1.0, 1.0]), 2000))[-1]
    assert found[0] == pytest.approx(factor, rel=0.2)
    np.testing.assert_allclose(found[1:], 1.0, rtol=0.2)


def test_it_is_the_recursion_in_plain_numpy(linear, linear_drive):
    rule = SageHusa(Cubature(), forgetting=B, floor=0.2, cap=3.0, limit=16.0)
    F, G, H, Q = linear.F, linear.G, linear.H, linear.process_cov
    m, P, R, k = linear.prior_mean, linear.prior_cov, linear.R.copy(), np.zeros(3)
    model = ready(linear, rule)
    means, covs = filter_drive(rule, model, m, P, model.memory, linear_drive.inputs, linear_drive.readings)
    for t, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        heard = ~np.isnan(y)
        m, P = F @ m + G @ u, F @ P @ F.T + Q
        K = P @ H[heard].T @ np.linalg.inv(H[heard] @ P @ H[heard].T + np.diag(R[heard]))
        m, P = m + K @ (y - H @ m)[heard], P - K @ H[heard] @ P
        np.testing.assert_allclose(means[t], m, rtol=0, atol=1e-9)  # rounding only
        np.testing.assert_allclose(covs[t], P, rtol=0, atol=1e-9)
        left, doubt = (y - H @ m) ** 2, np.diag(H @ P @ H.T)
        for i in np.flatnonzero(heard & (left <= 16 * (R + doubt))):
            d = (1 - B) / (1 - B ** (k[i] + 1))
            R[i] = np.clip((1 - d) * R[i] + d * (left[i] + doubt[i]), 0.2 * linear.R[i], 3 * linear.R[i])
            k[i] += 1


def test_floor_and_cap_hold(linear):
    rule = SageHusa(Cubature(), forgetting=0.9, floor=0.5, cap=2.0, limit=np.inf)
    for factor, bound in ((1e-4, 0.5), (100.0, 2.0)):
        found = factors(rule, linear, *noisy(linear, factor, 300))
        assert found.min() >= 0.5 and found.max() <= 2.0
        assert np.median(found[50:]) == pytest.approx(bound, rel=0.2)


def test_what_a_gate_refuses_and_what_is_not_heard_teaches_nothing(linear):
    inner = SageHusa(Cubature(), forgetting=0.9)
    rule = Gated(inner, 9.0, 5.0)
    model = ready(linear, inner)
    model = model._replace(memory=np.concatenate((model.memory, np.zeros(3))))
    y = np.array([1e3, np.nan, 2.0])  # the first is refused
    _, _, memory, _, dof = filter_step(rule, model, model.prior_mean, model.prior_cov, model.memory, np.zeros(1), y)
    assert dof == 1
    np.testing.assert_array_equal(memory[:2], [1.0, 1.0])
    assert memory[2] != 1.0
    np.testing.assert_array_equal(memory[3:6], [1.0, 1.0, 0.9])
    np.testing.assert_array_equal(memory[6:], [1.0, 0.0, 0.0])


def test_a_reading_far_off_teaches_nothing_without_a_gate_either(linear):
    rule = SageHusa(Cubature(), forgetting=0.9)
    model = ready(linear, rule)
    arguments = model.prior_mean, model.prior_cov, model.memory, np.zeros(1)
    _, _, memory, _, dof = filter_step(rule, model, *arguments, np.array([1e3, np.nan, np.nan]))
    assert dof == 1
    np.testing.assert_array_equal(memory, model.memory)


def test_what_is_found_is_believed(linear):
    rule = SageHusa(Extended())
    memory = np.concatenate((linear.memory, [0.5, 2.0, 3.0, 1.0, 1.0, 1.0]))
    y = np.array([1.0, np.nan, 1.0])
    variances, after = believe(rule, linear, linear.prior_mean, linear.prior_cov, memory, np.zeros(1), y)
    np.testing.assert_array_equal(variances, [0.5 * linear.R[0], np.nan, 3 * linear.R[2]])
    np.testing.assert_array_equal(after, memory)


def test_it_stands_around_any_rule(linear, linear_drive):
    # On a linear model all rules are Kalman's, so whatever is learnt is the same.
    answers = []
    for inner in (Cubature(), Unscented(), Extended()):
        rule = SageHusa(inner)
        model = ready(linear, rule, 50.0)
        start = linear.prior_mean, linear.prior_cov, model.memory
        answers.append(filter_drive(rule, model, *start, linear_drive.inputs, linear_drive.readings))
    for means, covs in answers[1:]:
        np.testing.assert_allclose(means, answers[0][0], rtol=0, atol=1e-6)  # differences of a line: rounding
        np.testing.assert_allclose(covs, answers[0][1], rtol=0, atol=1e-6)
