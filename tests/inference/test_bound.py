"""The bound: Riccati's covariance where that is exact, a scalar's closed form, never above what a filter reaches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vse_gym.inference.bound import Expectations, bound, draw_states, expectations, slopes, stencils
from vse_gym.inference.gaussian import Extended, filter_drive
from vse_gym.inference.gaussian.extended import jacobian, stencil
from vse_gym.inference.model import advance, heed, observe
from vse_gym.inference.particle import bootstrap_step, draw
from vse_gym.models import DoubleTrackTuning, Nominal, SingleTrackTuning
from vse_gym.noise import cauchy_gaussian, contamination, fisher_information
from vse_gym.sensors import LOUD
from vse_gym.types import U_STEER
from vse_gym.vehicles import load

MODELS = [tuning.build(Nominal(load("qin2014"), LOUD, 20.0)) for tuning in (SingleTrackTuning(), DoubleTrackTuning())]
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)


def bound_of(model, inputs, readings, information, size=5):
    states = draw_states(model, inputs, readings, size, np.random.default_rng(0))
    precision = np.linalg.inv(model.process_cov)
    e = Expectations(*expectations(model, inputs, readings, states, precision, information))
    return bound(model.prior_cov, precision, e)


def test_where_all_is_linear_and_gaussian_the_bound_is_riccati_s_covariance(linear, linear_drive):
    # Steps where channels are silent, too. Central differences of a line err by rounding alone, 1e-16/6e-6.
    least = bound_of(linear, linear_drive.inputs, linear_drive.readings, np.ones(3))
    np.testing.assert_allclose(least, linear_drive.covs, rtol=0, atol=1e-9)


@given(st.floats(0.1, 1.2), st.floats(0.01, 10.0), st.floats(0.01, 10.0), st.floats(0.1, 1.0))
def test_a_scalar_s_bound_settles_where_prediction_and_reading_balance(f, q, r, information):
    # 1/P = 1/(f^2 P + q) + I/r, a quadratic in P.
    steps, i = 400, information / r
    e = Expectations(*(np.full((steps, 1, 1), value) for value in (f * f / q, f, i)))
    last = bound(np.eye(1), np.full((1, 1), 1 / q), e)[-1, 0, 0]
    a, b, c = f * f * i, 1 - f * f + q * i, -q
    assert last == pytest.approx((-b + np.sqrt(b * b - 4 * a * c)) / (2 * a), rel=1e-6)


def test_noise_that_tells_less_is_as_a_variance_that_is_larger(linear, linear_drive):
    information = np.array([0.5, 0.8, 0.9])
    least = bound_of(linear, linear_drive.inputs, linear_drive.readings, information)
    louder = linear._replace(R=linear.R / information)
    np.testing.assert_allclose(
        least, bound_of(louder, linear_drive.inputs, linear_drive.readings, np.ones(3)), rtol=1e-9, atol=1e-12
    )


@given(
    arrays(float, (2, 2), elements=st.floats(-1, 1)),
    arrays(float, (4, 2), elements=st.floats(-3, 3)),
    arrays(bool, (20, 4)),
    arrays(bool, (20, 4)),
)
def test_more_channels_never_raise_the_bound(f, h, heard, beside):
    def least(heard):
        readings = np.einsum("tc,ci,cj->tij", heard.astype(float), h, h)
        terms = np.tile(f.T @ precision @ f, (20, 1, 1)), np.tile(f, (20, 1, 1)), readings
        return bound(np.eye(2), precision, Expectations(*terms))

    precision = np.linalg.inv(np.array([[0.2, 0.05], [0.05, 0.1]]))
    some, more = least(heard), least(heard | beside)
    gain = np.linalg.eigvalsh(some - more)  # in every direction
    largest = np.abs(some).max(axis=(1, 2))  # rounding is relative, and what nobody hears of may grow without end
    assert np.all(gain.min(axis=1) >= -1e-12 * np.maximum(1.0, largest))


def noisy_drives(model, drives, steps, alpha):
    """Drives of the linear model: states (T, n, drives) and readings (drives, T, m), noise of Qin's mixture."""
    rng, inputs = np.random.default_rng(1), np.sin(0.1 * np.arange(steps))[:, None]
    states = draw_states(model, inputs, np.zeros((steps, 3)), drives, rng)[1:]
    clean = np.einsum("mn,tnd->dtm", model.H, states)
    return inputs, states, clean + np.sqrt(model.R) * cauchy_gaussian(alpha, np.sqrt(0.5), clean.shape, rng)


def assert_not_below(errors, least):
    """Mean squared errors (drives, T, n) against the bound's variances (T, n), within four standard errors."""
    ratio = (errors**2 / least).mean(axis=(1, 2))
    spread = ratio.std() / np.sqrt(ratio.size)
    assert ratio.mean() > 1 - 4 * spread
    return ratio.mean(), spread


def test_kalman_s_filter_meets_the_bound_under_gaussian_noise(linear):
    inputs, states, readings = noisy_drives(linear, 300, 50, 2.0)
    least = bound_of(linear, inputs, readings[0], np.ones(3))
    prior = linear.prior_mean, linear.prior_cov, linear.memory
    means = np.array([filter_drive(Extended(), linear, *prior, inputs, y)[0] for y in readings])
    variances = least.diagonal(axis1=1, axis2=2)
    ratio, spread = assert_not_below(means - states.transpose(2, 0, 1), variances)
    assert ratio < 1 + 4 * spread


def test_no_particle_filter_is_below_the_bound_under_cauchy_gaussian_noise(linear):
    alpha, size, drives = 1.5, 1000, 100
    inputs, states, readings = noisy_drives(linear, drives, 30, alpha)
    share = contamination(alpha)
    least = bound_of(linear, inputs, readings[0], np.full(3, fisher_information(share)))
    errors = np.empty((drives, 30, 2))
    for d in range(drives):
        rng = np.random.default_rng([d, 1])
        particles = draw(linear.prior_mean, linear.prior_cov, size, rng)
        weights, memory = np.full(size, 1 / size), linear.memory
        for t in range(30):
            before, u, y = (particles, weights, memory), inputs[t], readings[d, t]
            particles, weights, memory, _, output = bootstrap_step(linear, *before, u, y, share, 0.5, rng)
            errors[d, t] = output[:2] - states[t, :, d]
    ratio, _ = assert_not_below(errors, least.diagonal(axis1=1, axis2=2))
    assert ratio < 1.5  # what tails that Fisher's information does not see cost here: 1.10


@every_model
def test_jacobians_are_those_of_the_extended_filter(model):
    rng, u = np.random.default_rng(0), np.zeros(9)
    u[U_STEER] = 0.03
    held = heed(model, u, np.full(10, np.nan))
    states = np.array([[20.0], [0.5], [0.3]]) + rng.normal(0, 0.1, (3, 4))
    for function in (advance, observe):
        columns = stencils(states)
        found = slopes(columns, function(model, columns, held))
        for j in range(4):
            wanted = jacobian(alone := stencil(states[:, j].copy(), 6e-6), function(model, alone, held))
            np.testing.assert_allclose(found[:, :, j].T, wanted, rtol=1e-12, atol=1e-12)


@every_model
def test_states_are_drawn_with_the_noise_that_a_filter_is_told(model):
    size, u = 20_000, np.zeros((2, 9))
    states = draw_states(model, u, np.full((2, 10), np.nan), size, np.random.default_rng(0))
    noise = states[2] - advance(model, states[1].copy(), heed(model, u[0], np.full(10, np.nan)))
    np.testing.assert_allclose(states[0].mean(axis=1), model.prior_mean, atol=5 * model.prior_cov.max() ** 0.5 / 141)
    for found, wanted in ((np.cov(states[0]), model.prior_cov), (np.cov(noise), model.process_cov)):
        scale = np.sqrt(wanted.diagonal())
        # A correlation or variance of so many draws spreads by 0.7 and 1 %.
        np.testing.assert_allclose(found / np.outer(scale, scale), np.eye(3), atol=0.05)
