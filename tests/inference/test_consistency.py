"""Filters are as wrong as they say: on drives of their own model, errors fit the covariances given with them."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import GaussianFilter
from vse_gym.inference.linear import matrices
from vse_gym.inference.model import advance, attend, heed, observe
from vse_gym.models import DoubleTrackTuning, LinearBicycleTuning, Nominal, SingleTrackTuning
from vse_gym.sensors import FITTED, LOUD
from vse_gym.types import U_STEER, Y_WHEEL, Reading
from vse_gym.vehicles import load

DRIVES, STEPS, STATES = 50, 100, 3
INSTANTS = [0, 24, 49, 74, 99]  # far enough apart for errors to be nearly independent
SURE = 0.9995  # quantile at either end: with five instants, one honest filter in two hundred would be accused
TRUST = {"vx_noise": 0.5, "vy_noise": 0.6, "yaw_noise": 0.5, "ax_error": 0.3, "ay_error": 0.6}
TUNINGS = {"single": SingleTrackTuning(**TRUST), "double": DoubleTrackTuning(**TRUST)}
# Whose model is another than those that the drives are drawn from, who hears otherwise, and who takes what fits its
# readings for the noise: each has tests of its own.
ELSEWHERE = ("ekf_cauchy_gaussian", "ekf_3dof", "ekf_3dof_car", "ukf_friction", "iae_ekf")
FILTERS = [
    # Fading only ever adds doubt, so a strong tracking filter is honest where nothing fades.
    (name, "double" if "double" in name else "single", {"weakening": 1e6} if name == "strong_tracking" else {})
    for name in ESTIMATORS
    if issubclass(ESTIMATORS[name], GaussianFilter) and name not in ELSEWHERE
] + [("enkf", "single", {"size": 2000}), ("ekf_cauchy_gaussian", "single", {"alpha": 2.0})]


@pytest.fixture(scope="module")
def nominal():
    return Nominal(load("qin2014_understeer"), LOUD, speed=20.0)


def steered(k):
    u = np.zeros(9)
    u[U_STEER] = 0.03 * np.sin(np.pi * k * 0.01)
    return u


@pytest.fixture(scope="module")
def drives(nominal):
    """For each model states (DRIVES, STEPS, STATES) and readings, one list per drive, drawn from that very model.

    The variance of a wheel's reading hangs on the speed; of the true instead of the read one, 0.5 % of noise apart.
    """
    return {name: drawn(tuning.build(nominal)) for name, tuning in TUNINGS.items()}


def drawn(model):
    root = np.linalg.cholesky(model.process_cov)
    states, readings = np.empty((DRIVES, STEPS, STATES)), []
    for drive in range(DRIVES):
        rng = np.random.default_rng(drive)
        x, memory, heard = rng.multivariate_normal(model.prior_mean, model.prior_cov), model.memory, []
        for k in range(STEPS):
            u, silent = steered(k), np.full(10, np.nan)
            taken = heed(model, u, silent)  # without brakes, what is read makes no difference to it
            x = advance(model, x[:, None].copy(), taken)[:, 0] + root @ rng.standard_normal(STATES)
            clean = observe(model, x[:, None].copy(), taken)[:, 0]
            clean[FITTED:] = np.nan
            variances, memory = attend(model, memory, taken, clean)
            heard.append(Reading(k * model.dt, u, rng.normal(clean, np.sqrt(variances))))
            states[drive, k] = x
        readings.append(heard)
    return states, readings


def follow(estimator, nominal, drives):
    """Squared errors in terms of the covariance (NEES), squared innovations in theirs (NIS) and the latter's number."""
    states, readings = drives
    nees, nis, dof = (np.empty((DRIVES, STEPS)) for _ in range(3))
    for drive in range(DRIVES):
        rng = np.random.default_rng([drive, 1])  # not the drive's own stream
        state = estimator.init(nominal, rng)
        for k, reading in enumerate(readings[drive]):
            if estimator.told_friction:
                state = estimator.tell_friction(state, nominal.friction)
            state = estimator.update(state, reading, rng)
            estimate = estimator.estimate(state)
            error = states[drive, k] - estimate[:STATES]
            nees[drive, k] = error @ np.linalg.pinv(estimate.cov, hermitian=True) @ error
            nis[drive, k], dof[drive, k] = estimator.innovation(state)
    return nees, nis, dof


@pytest.fixture(scope="module", params=FILTERS, ids=[name for name, _, _ in FILTERS])
def followed(request, nominal, drives):
    name, model, settings = request.param
    return follow(ESTIMATORS.make(name, model=TUNINGS[model], **settings), nominal, drives[model])


def test_errors_fit_their_covariance(followed):
    nees, _, _ = followed
    lower, upper = chi2.ppf([1 - SURE, SURE], DRIVES * STATES)
    totals = nees[:, INSTANTS].sum(axis=0)
    assert np.all((lower < totals) & (totals < upper)), totals / (DRIVES * STATES)


def test_innovations_fit_their_covariance(followed):
    # White, so that all of them count: a band of 2.5 %, narrow enough to see one wrong variance among seven.
    _, nis, dof = followed
    np.testing.assert_array_equal(dof, 7)
    lower, upper = chi2.ppf([1 - SURE, SURE], dof.sum())
    assert lower < nis.sum() < upper, nis.sum() / dof.sum()


def test_the_kalman_filter_is_as_wrong_as_it_says_on_its_linear_bicycle(nominal):
    estimator = ESTIMATORS.make("kf", model=LinearBicycleTuning(vy_noise=0.6, yaw_noise=0.5, ay_error=0.6))
    model = estimator.model.build(nominal)
    root, rows = np.linalg.cholesky(model.process_cov), np.isfinite(model.variances)
    nees, total, count = np.zeros(STEPS), 0.0, 0.0
    for drive in range(DRIVES):
        rng = np.random.default_rng(drive)
        x, state = rng.multivariate_normal(model.prior_mean, model.prior_cov), estimator.init(nominal, rng)
        y = np.full(10, np.nan)
        y[Y_WHEEL : Y_WHEEL + 4] = nominal.speed / model.car.wheel_radius  # what schedules it is read without noise
        for k in range(STEPS):
            F, g, H, d = matrices(model, model.memory, steered(k))
            x = F @ x + g + root @ rng.standard_normal(2)
            y[rows] = rng.normal(H[rows] @ x + d[rows], np.sqrt(model.variances[rows]))
            # The mean of the wheels is the speed whatever the yaw rate, but for the steered front wheels' turn.
            state = estimator.update(state, Reading(0.01 * k, steered(k), y.copy()), rng)
            error = x - state.mean
            nees[k] += error @ np.linalg.solve(state.cov, error)
            nis, dof = estimator.innovation(state)
            total, count = total + nis, count + dof
    lower, upper = chi2.ppf([1 - SURE, SURE], DRIVES * 2)
    assert np.all((lower < nees[INSTANTS]) & (nees[INSTANTS] < upper))
    lower, upper = chi2.ppf([1 - SURE, SURE], count)
    assert count == 2 * DRIVES * STEPS
    assert lower < total < upper, total / count


def test_errors_of_the_particle_filter_fit_their_covariance(nominal, drives):
    # Now and then a few particles carry all the weight, and the covariance of those few says nothing; their NEES has
    # no mean. So counts instead of sums: how many drives lie beyond the chi-square's median and beyond its 95 % line.
    # With an effective size of some hundred, Hotelling's statistic is 5 % larger than the chi-square; that and the few
    # that collapse are granted twice the 5 % beyond the line, and 60 % beyond the median.
    nees, _, _ = follow(ESTIMATORS.make("pf", model=TUNINGS["single"], size=5000), nominal, drives["single"])
    beyond_median = (nees[:, INSTANTS] > chi2.ppf(0.5, STATES)).sum(axis=0)
    beyond_line = (nees[:, INSTANTS] > chi2.ppf(0.95, STATES)).sum(axis=0)
    assert np.all(beyond_median >= binom.ppf(1 - SURE, DRIVES, 0.5)), beyond_median
    assert np.all(beyond_median <= binom.ppf(SURE, DRIVES, 0.6)), beyond_median
    assert np.all(beyond_line <= binom.ppf(SURE, DRIVES, 0.1)), beyond_line
