"""The square-root cubature rule beside the plain one, Kalman's equations and filterpy."""

import numpy as np
from filterpy.kalman import KalmanFilter

from vse_gym.inference.frozen import Frozen
from vse_gym.inference.gaussian import Cubature, covariance, filter_drive, filter_step, foresee, keep
from vse_gym.inference.gaussian.square_root_cubature import SquareRootCubature
from vse_gym.inference.linear import matrices
from vse_gym.models import SingleTrackTuning


def test_it_is_the_kalman_filter_on_a_linear_model(linear, linear_drive):
    start = linear.prior_mean, linear.prior_cov, linear.memory
    means, covs = filter_drive(SquareRootCubature(), linear, *start, linear_drive.inputs, linear_drive.readings)
    np.testing.assert_allclose(means, linear_drive.means, atol=1e-12)  # exact but for rounding
    np.testing.assert_allclose(covs, linear_drive.covs, atol=1e-12)


def test_on_the_car_it_is_the_plain_cubature_filter(nominal, readings):
    model = SingleTrackTuning().build(nominal)
    inputs, heard = np.array([r.inputs for r in readings]), np.array([r.y for r in readings])
    arguments = model, model.prior_mean, model.prior_cov, model.memory, inputs, heard
    plain, rooted = filter_drive(Cubature(), *arguments), filter_drive(SquareRootCubature(), *arguments)
    np.testing.assert_allclose(rooted[0], plain[0], atol=1e-9)  # 600 steps of rounding
    np.testing.assert_allclose(rooted[1], plain[1], atol=1e-9)


def test_it_foresees_what_the_plain_one_does(nominal, readings):
    model = SingleTrackTuning().build(nominal)
    root, plain, u = SquareRootCubature(), Cubature(), readings[100].inputs
    mine = foresee(root, model, model.prior_mean, keep(root, model.prior_cov), u)
    for a, b in zip(mine, foresee(plain, model, model.prior_mean, model.prior_cov, u), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)


def test_a_model_frozen_in_a_step_is_filterpys_linear_one(linear, linear_drive):
    # The route that a model scheduled by its memory takes, beside an independent library.
    theirs, rule = KalmanFilter(2, 3), SquareRootCubature()
    theirs.x, theirs.P, theirs.F, theirs.Q = linear.prior_mean, linear.prior_cov, linear.F, linear.process_cov
    mean, kept = linear.prior_mean, keep(rule, linear.prior_cov)
    for u, y in zip(linear_drive.inputs, linear_drive.readings, strict=True):
        F, g, H, d = matrices(linear, linear.memory, u)
        told = np.where(np.isnan(y), np.nan, linear.R)
        frozen = Frozen(F, g, H, d, linear.process_cov, told)
        mean, kept, _, nis, dof = filter_step(rule, frozen, mean, kept, linear.memory, u, y)
        theirs.predict(B=linear.G, u=u)
        heard = np.isfinite(y)
        if heard.any():
            theirs.update(y[heard], R=np.diag(linear.R[heard]), H=linear.H[heard])
            assert dof == heard.sum()
            np.testing.assert_allclose(nis, theirs.y @ theirs.SI @ theirs.y, rtol=1e-9)
        np.testing.assert_allclose(mean, theirs.x, atol=1e-12)
        np.testing.assert_allclose(covariance(rule, kept), theirs.P, atol=1e-12)
