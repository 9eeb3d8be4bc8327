"""Moving-horizon estimation: Kalman's filter where that is exact, SciPy's least squares where it is not."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.differentiate import derivative
from scipy.optimize import least_squares

from vse_gym.compiled import hold
from vse_gym.inference.gaussian import Extended, filter_step
from vse_gym.inference.model import advance, observe
from vse_gym.inference.moving_horizon import CauchyGaussian, Huber, MovingHorizon, moving_horizon_update, weigh
from vse_gym.models import Nominal, SingleTrackTuning
from vse_gym.sensors import LOUD
from vse_gym.types import U_STEER, Y_AY, Y_YAW_RATE, Array
from vse_gym.vehicles import load

SQUARES = Huber()


class Found(NamedTuple):
    mean: Array
    cov: Array
    states: Array
    inputs: Array
    readings: Array
    variances: Array
    memory: Array
    newest_cov: Array
    output: Array


def follow(rule, model, inputs, readings):
    """What is found after each reading."""
    nothing = [np.empty((0, k)) for k in (inputs.shape[1], readings.shape[1], readings.shape[1])]
    parts = model.prior_mean, model.prior_cov, model.prior_mean[None].copy(), *nothing, model.memory
    constants, found = hold((rule, model)), []
    for u, y in zip(inputs, readings, strict=True):
        found.append(Found(*moving_horizon_update(constants, *parts, u, y)))
        parts = found[-1][:7]
    return found


@pytest.fixture(scope="module")
def car():
    return SingleTrackTuning(vy_noise=0.3, yaw_noise=0.2, ay_error=0.5).build(
        Nominal(load("qin2014_understeer"), LOUD, 25.0)
    )


@pytest.fixture(scope="module")
def car_drive(car):
    """Inputs and readings of a hard turn of the single track, its own noise and no silence."""
    rng, steps = np.random.default_rng(2), 30
    root = np.linalg.cholesky(car.process_cov)
    inputs, readings = np.zeros((steps, 9)), np.full((steps, 10), np.nan)
    inputs[:, U_STEER] = 0.14 * np.sin(np.arange(steps) / 8)
    x = car.prior_mean
    for k, u in enumerate(inputs):
        x = advance(car, x[:, None].copy(), u)[:, 0] + root @ rng.standard_normal(3)
        readings[k, :7] = rng.normal(observe(car, x[:, None].copy(), u)[:7, 0], np.sqrt(car.variances[:7]))
    assert np.abs(readings[:, Y_AY]).max() > 5.5  # beyond where the tyres are linear
    return inputs, readings


@pytest.mark.parametrize("iterations", [1, 3])
@pytest.mark.parametrize("horizon", [1, 2, 10, 200])
def test_on_a_linear_model_its_newest_state_is_kalmans_at_any_horizon(horizon, iterations, linear, linear_drive):
    rule = MovingHorizon(SQUARES, horizon, iterations)
    for k, found in enumerate(follow(rule, linear, linear_drive.inputs, linear_drive.readings)):
        # Rounding, which central differences enlarge by one over their step.
        np.testing.assert_allclose(found.states[-1], linear_drive.means[k], atol=1e-7)
        np.testing.assert_allclose(found.newest_cov, linear_drive.covs[k], atol=1e-7)
        assert found.states.shape == (min(k + 1, horizon) + 1, 2)


def test_on_a_linear_model_its_trajectory_is_that_of_all_readings_at_once(linear, linear_drive):
    # The normal equations of the stacked problem, solved as one dense system.
    steps, n = 20, 2
    root_q, root_p = np.linalg.cholesky(linear.process_cov), np.linalg.cholesky(linear.prior_cov)
    rows, right = [], []

    def add(columns, target, scale):
        row = np.zeros((target.size, (steps + 1) * n))
        for i, block in columns.items():
            row[:, i * n : (i + 1) * n] = scale @ block
        rows.append(row)
        right.append(scale @ target)

    add({0: np.eye(n)}, linear.prior_mean, np.linalg.inv(root_p))
    for i in range(steps):
        u, y = linear_drive.inputs[i], linear_drive.readings[i]
        add({i: -linear.F, i + 1: np.eye(n)}, linear.G @ u, np.linalg.inv(root_q))
        heard = np.isfinite(y)
        add({i + 1: linear.H[heard]}, y[heard], np.diag(1 / np.sqrt(linear.R[heard])))
    wanted, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)
    rule = MovingHorizon(SQUARES, steps, 1)
    found = follow(rule, linear, linear_drive.inputs[:steps], linear_drive.readings[:steps])[-1]
    np.testing.assert_allclose(found.states.ravel(), wanted, atol=1e-7)


def test_one_step_at_horizon_one_is_the_extended_filters_update(car, car_drive):
    inputs, readings = car_drive
    found = follow(MovingHorizon(SQUARES, 1, 1), car, inputs[:1], readings[:1])[0]
    mean, cov, memory, nis, dof = filter_step(
        Extended(), car, car.prior_mean, car.prior_cov, car.memory, inputs[0], readings[0]
    )
    # The same operations in the same order.
    np.testing.assert_allclose(found.states[-1], mean, rtol=1e-13)
    np.testing.assert_allclose(found.newest_cov, cov, rtol=1e-12)
    np.testing.assert_array_equal(found.memory, memory)
    assert found.output[5:] == pytest.approx([nis, dof], rel=1e-12)


def stacked(states, car, inputs, readings, variances, root=lambda z: z):
    """Residuals of the whole window in standard deviations; ``root`` of each reading's, signed, gives its loss."""
    states = states.reshape(-1, 3)
    parts = [np.linalg.solve(np.linalg.cholesky(car.prior_cov), states[0] - car.prior_mean)]
    for i, u in enumerate(inputs):
        ahead = advance(car, states[i][:, None].copy(), u)[:, 0]
        parts.append(np.linalg.solve(np.linalg.cholesky(car.process_cov), states[i + 1] - ahead))
        z = (readings[i] - observe(car, states[i + 1][:, None].copy(), u)[:, 0]) / np.sqrt(variances[i])
        parts.append(root(z[np.isfinite(z)]))
    return np.concatenate(parts)


def huber_root(z, limit=1.345):
    """Residual whose square is twice Huber's loss."""
    return np.sign(z) * np.where(np.abs(z) <= limit, np.abs(z), np.sqrt(np.abs(2 * limit * np.abs(z) - limit**2)))


@pytest.mark.parametrize(
    ("loss", "root"), [(SQUARES, lambda z: z), (Huber(1.345), huber_root)], ids=["least squares", "huber"]
)
def test_on_a_nonlinear_model_it_is_scipys_least_squares_of_the_stacked_problem(car, car_drive, loss, root):
    inputs, readings = car_drive[0], car_drive[1].copy()
    readings[20, Y_AY] += 6.0  # an outlier of a dozen standard deviations
    readings[9, Y_YAW_RATE] = np.nan
    found = follow(MovingHorizon(loss, inputs.shape[0], 100), car, inputs, readings)[-1]
    problem = car, inputs, readings, found.variances, root
    solution = least_squares(stacked, found.states[::-1].ravel() * 0.9, args=problem, xtol=1e-12, ftol=1e-14, gtol=1e-9)
    # Where the minimum is flat, SciPy's forward differences stop it a little early.
    np.testing.assert_allclose(found.states, solution.x.reshape(-1, 3), atol=2e-4)
    assert np.sum(stacked(found.states.ravel(), *problem) ** 2) <= 2 * solution.cost * (1 + 1e-7)


@given(st.floats(-8, 8), st.sampled_from([0.0, 0.05, 0.3, 1.0]))
def test_the_cauchy_gaussian_weight_is_the_slope_of_its_log_density(z, share):
    if abs(z) < 0.01:
        return

    def loss(x):
        return -np.log((1 - share) * stats.norm.pdf(x) + share * stats.cauchy.pdf(x, scale=np.sqrt(0.5)))

    slope = derivative(loss, z, initial_step=0.01).df
    assert weigh(CauchyGaussian(share), z) == pytest.approx(slope / z, rel=1e-6)


@given(st.floats(-1e6, 1e6))
def test_an_infinite_limit_is_least_squares_and_a_finite_one_pulls_no_harder_than_at_it(z):
    assert weigh(Huber(), z) == 1.0
    assert abs(weigh(Huber(2.0), z) * z) == pytest.approx(min(abs(z), 2.0), rel=1e-12)


def test_readings_beyond_all_range_have_a_weight():
    for share in (0.0, 0.1):
        assert np.isfinite(weigh(CauchyGaussian(share), 1e9)) and weigh(CauchyGaussian(share), 1e9) > 0


@pytest.mark.parametrize(
    ("loss", "share"), [(Huber(1.345), 0.3), (CauchyGaussian(0.1), 0.02)], ids=["huber", "cauchy-gaussian"]
)  # Huber's pull has a bound, the other's goes to zero
def test_a_robust_loss_shrugs_off_what_least_squares_falls_for(car, car_drive, loss, share):
    inputs, clean = car_drive
    wild = clean.copy()
    wild[20:24, Y_YAW_RATE] += 1.0  # a burst of gyro readings that say 57 deg/s too much
    moved = {}
    for kind in (loss, SQUARES):
        rule = MovingHorizon(kind, 15, 3)
        pair = [np.array([f.states[-1] for f in follow(rule, car, inputs, read)]) for read in (clean, wild)]
        moved[kind] = np.abs(pair[0] - pair[1])[:, 2].max()
    assert moved[SQUARES] > 0.5
    assert moved[loss] < share * moved[SQUARES]


def test_each_reading_is_judged_once(car, car_drive):
    # A window that is driven on holds the variances that the model gave when each reading came.
    inputs, readings = car_drive
    drive = follow(MovingHorizon(SQUARES, 5, 1), car, inputs, readings)
    first = [found.variances[-1] for found in drive]
    for k in range(5, len(drive)):
        np.testing.assert_array_equal(drive[k].variances, first[k - 4 : k + 1])
        np.testing.assert_array_equal(drive[k].readings, readings[k - 4 : k + 1])
