"""filterpy's Kalman filters on the recorded drive of speed.py, for peers.py.

They are given every advantage that their structure allows: the model is this package's, compiled; all points of a
stencil, all sigma points and all members of an ensemble go through it in one call; a call from Python does as much of
the model's work as fits between two calls of the library. The algebra is the library's own.
"""

import pickle
import sys
from pathlib import Path

import numpy as np
from filterpy.kalman import (
    CubatureKalmanFilter,
    EnsembleKalmanFilter,
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)
from filterpy.kalman.CubatureKalmanFilter import spherical_radial_sigmas

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.extended import jacobian, stencil
from vse_gym.inference.linear import matrices
from vse_gym.inference.model import advance, attend, heed, observe
from vse_gym.sensors import FITTED
from vse_gym.types import Y_AY, Y_YAW_RATE

STEP = 6e-6  # of the central differences, as in vse_gym.inference.gaussian.Extended
model, bicycle, inputs, readings = pickle.loads(Path(sys.argv[1]).read_bytes())
heeded = np.array([heed(model, u, y) for u, y in zip(inputs, readings, strict=True)])


# -- extended -------------------------------------------------------------------------------------------------------


@compiled
def advance_linearised(model, mean, u, step):
    """The mean one step on (n,), and the Jacobian there (n, n)."""
    columns = stencil(mean, step)
    values = advance(model, columns, u)
    return values[:, 0].copy(), jacobian(columns, values)


@compiled
def observe_linearised(model, memory, mean, u, y, step):
    """Of the channels to be believed: reading, expected reading, Jacobian, noise covariance; and the memory."""
    variances, memory = attend(model, memory, u, y)
    used = np.nonzero(~np.isnan(variances))[0]
    columns = stencil(mean, step)
    values = observe(model, columns, u)[used]
    return y[used], values[:, 0].copy(), jacobian(columns, values), np.diag(variances[used]), memory


class Extended(ExtendedKalmanFilter):
    """filterpy's, with the nonlinear prediction that its documentation leaves to a subclass."""

    def predict_x(self, u=0):
        """Set the mean and the transition matrix; filterpy's ``predict`` does the covariance."""
        self.x, self.F = advance_linearised(model, self.x, u, STEP)


def drive_extended():
    """Means (T, 3) and covariances (T, 3, 3) of the recorded drive."""
    kalman = Extended(dim_x=3, dim_z=FITTED)
    kalman.x, kalman.P, kalman.Q = model.prior_mean, model.prior_cov, model.process_cov
    memory, means, covs = model.memory, np.empty((len(readings), 3)), np.empty((len(readings), 3, 3))
    for k, (u, y) in enumerate(zip(heeded, readings, strict=True)):
        kalman.predict(u)
        z, expected, jacobian, noise, memory = observe_linearised(model, memory, kalman.x, u, y, STEP)
        kalman.update(z, lambda _, j=jacobian: j, lambda _, e=expected: e, noise)
        means[k], covs[k] = kalman.x, kalman.P
    return means, covs


# -- unscented ------------------------------------------------------------------------------------------------------


@compiled
def advance_rows(model, points, u):
    """Sigma points as rows (2n + 1, n), one step on."""
    return advance(model, points.T.copy(), u).T.copy()


@compiled
def observe_rows(model, memory, points, u, y):
    """Of the channels to be believed: reading, expected reading of each point, noise covariance; and the memory."""
    variances, memory = attend(model, memory, u, y)
    used = np.nonzero(~np.isnan(variances))[0]
    return y[used], observe(model, points.T.copy(), u)[used].T.copy(), np.diag(variances[used]), memory


class Unscented(UnscentedKalmanFilter):
    """filterpy's, with all sigma points through the model in one call instead of one call each."""

    def compute_process_sigmas(self, dt, fx=None, **fx_args):
        """Draw the points and advance them."""
        self.sigmas_f = advance_rows(model, self.points_fn.sigma_points(self.x, self.P), fx_args["u"])


def drive_unscented():
    """Means (T, 3) and covariances (T, 3, 3) of the recorded drive."""
    kalman = Unscented(3, FITTED, model.dt, None, None, MerweScaledSigmaPoints(3, alpha=1.0, beta=2.0, kappa=0.0))
    kalman.x, kalman.P, kalman.Q = model.prior_mean, model.prior_cov, model.process_cov
    memory, means, covs = model.memory, np.empty((len(readings), 3)), np.empty((len(readings), 3, 3))
    for k, (u, y) in enumerate(zip(heeded, readings, strict=True)):
        kalman.predict(u=u)
        z, rows, noise, memory = observe_rows(model, memory, kalman.sigmas_f, u, y)
        expected = iter(rows)  # update() asks for the points' readings one by one, in their order
        kalman.update(z, noise, hx=lambda _, expected=expected: next(expected))
        means[k], covs[k] = kalman.x, kalman.P
    return means, covs


# -- cubature -------------------------------------------------------------------------------------------------------


def drive_cubature():
    """Means (T, 3) and covariances (T, 3, 3); its points are drawn anew before the update, as the paper has it."""
    rows = iter(())  # fx() and hx() are asked for the points one by one, in their order
    kalman = CubatureKalmanFilter(3, FITTED, model.dt, lambda _: next(rows), lambda *_: next(rows))
    kalman.x, kalman.P, kalman.Q = model.prior_mean[:, None], model.prior_cov, model.process_cov
    memory, means, covs = model.memory, np.empty((len(readings), 3)), np.empty((len(readings), 3, 3))
    for k, (u, y) in enumerate(zip(heeded, readings, strict=True)):
        rows = iter(advance_rows(model, spherical_radial_sigmas(kalman.x, kalman.P), u))
        kalman.predict()
        kalman.sigmas_f = spherical_radial_sigmas(kalman.x, kalman.P)
        z, expected, noise, memory = observe_rows(model, memory, kalman.sigmas_f, u, y)
        rows, kalman.sigmas_h = iter(expected), np.empty(expected.shape)
        kalman.update(z[:, None], noise)
        means[k], covs[k] = kalman.x.ravel(), kalman.P
    return means, covs


# -- ensemble -------------------------------------------------------------------------------------------------------


def drive_ensemble(size):
    """Means (T, 3) and covariances (T, 3, 3)."""
    np.random.seed(0)  # noqa: NPY002  (the library draws from the global generator)
    rows = iter(())
    kalman = EnsembleKalmanFilter(
        model.prior_mean, model.prior_cov, FITTED, model.dt, size, lambda _: next(rows), lambda *_: next(rows)
    )
    kalman.Q = model.process_cov
    memory, means, covs = model.memory, np.empty((len(readings), 3)), np.empty((len(readings), 3, 3))
    for k, (u, y) in enumerate(zip(heeded, readings, strict=True)):
        rows = iter(advance_rows(model, kalman.sigmas, u))
        kalman.predict()
        z, expected, noise, memory = observe_rows(model, memory, kalman.sigmas, u, y)
        rows, kalman._mean_z = iter(expected), np.zeros(z.size)
        kalman.update(z, noise)
        means[k], covs[k] = kalman.x, kalman.P
    return means, covs


# -- the linear bicycle ---------------------------------------------------------------------------------------------


@compiled
def bicycle_matrices(model, memory, u, y):
    """Of one step: F, g, the rows of H and d that are heard, their variances as R; and the memory."""
    variances, memory = attend(model, memory, u, y)
    F, g, H, d = matrices(model, memory, u)
    rows = np.array([Y_AY, Y_YAW_RATE])
    return F, g, H[rows], y[rows] - d[rows], np.diag(variances[rows]), memory


def drive_linear():
    """Means (T, 2) and covariances (T, 2, 2)."""
    kalman = KalmanFilter(dim_x=2, dim_z=2)
    kalman.x, kalman.P, kalman.Q = bicycle.prior_mean, bicycle.prior_cov, bicycle.process_cov
    memory, means, covs = bicycle.memory, np.empty((len(readings), 2)), np.empty((len(readings), 2, 2))
    one = np.eye(2)
    for k, (u, y) in enumerate(zip(heeded, readings, strict=True)):
        F, g, H, z, R, memory = bicycle_matrices(bicycle, memory, u, y)
        kalman.predict(g, one, F)
        kalman.update(z, R, H)
        means[k], covs[k] = kalman.x, kalman.P
    return means, covs


DRIVES = {
    "ekf": drive_extended,
    "ukf": drive_unscented,
    "ckf": drive_cubature,
    "sr_ukf": drive_unscented,  # it has no square-root form of it; the results are the same
    "enkf": drive_ensemble,
    "kf": drive_linear,
}
