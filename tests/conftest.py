"""What the tests share: a drive to run the conformance checks on, and a linear model with its exact solution."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import settings

from vse_gym.compiled import compiled
from vse_gym.inference.linear import matrices, report_linear
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.testing import example_drive
from vse_gym.types import Array

settings.register_profile("vse_gym", deadline=None)  # an example may be the one that compiles a kernel
settings.load_profile("vse_gym")


@pytest.fixture(scope="session")
def drive():
    return example_drive(seed=1)


@pytest.fixture(scope="session")
def nominal(drive):
    return drive.nominal


@pytest.fixture(scope="session")
def readings(drive):
    return drive.readings


@pytest.fixture(scope="session")
def estimates(drive):
    return drive.estimates


# A model from outside the package, registered as its users would. It stands here, where every test session imports
# it, because registering changes the folder in which compiled kernels are kept.


class Linear(NamedTuple):
    """x' = F x + G u + noise of process_cov, y = H x + noise: Kalman (1960) solved it exactly."""

    F: Array  # (n, n)
    G: Array  # (n, k)
    H: Array  # (m, n)
    R: Array  # variances of the channels, (m,)
    prior_mean: Array  # (n,)
    prior_cov: Array  # (n, n)
    process_cov: Array  # (n, n)
    memory: Array  # (0,)


@compiled
def product(matrix, columns):
    """Row by row, so that a row's result does not depend on which other rows there are, as BLAS's may."""
    out = np.zeros((matrix.shape[0], columns.shape[1]))
    for i in range(matrix.shape[0]):
        for k in range(matrix.shape[1]):
            for j in range(columns.shape[1]):
                out[i, j] += matrix[i, k] * columns[k, j]
    return out


@advance.register(Linear)
@compiled
def _(model, states, u):
    return product(model.F, states) + product(model.G, u.reshape(-1, 1))


@observe.register(Linear)
@compiled
def _(model, states, u):
    return product(model.H, states)


@heed.register(Linear)
@compiled
def _(model, u, y):
    return u


@attend.register(Linear)
@compiled
def _(model, memory, u, y):
    return np.where(np.isnan(y), np.nan, model.R), memory


@report.register(Linear)
@compiled
def _(model, state, u):
    return np.array([state[0], state[1], np.nan, np.nan, np.nan])


@matrices.register(Linear)
@compiled
def _(model, memory, u):
    return model.F, product(model.G, u.reshape(-1, 1))[:, 0].copy(), model.H, np.zeros(model.H.shape[0])


@report_linear.register(Linear)
@compiled
def _(model, mean, memory, expected):
    return np.array([mean[0], mean[1], np.nan, np.nan, np.nan])


@pytest.fixture(scope="session")
def linear():
    """A damped oscillator that is pushed, seen through three channels."""
    return Linear(
        F=np.array([[0.95, 0.2], [-0.2, 0.9]]),
        G=np.array([[0.0], [0.5]]),
        H=np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]]),
        R=np.array([0.5, 0.2, 1.0]),
        prior_mean=np.array([1.0, -1.0]),
        prior_cov=np.array([[2.0, 0.3], [0.3, 1.0]]),
        process_cov=np.array([[0.1, 0.02], [0.02, 0.2]]),
        memory=np.empty(0),
    )


class LinearDrive(NamedTuple):
    """Inputs and readings of the linear model, and the belief that Kalman's equations give after each reading."""

    inputs: Array  # (T, k)
    readings: Array  # (T, m), NaN where silent
    means: Array  # (T, n)
    covs: Array  # (T, n, n)


@pytest.fixture(scope="session")
def linear_drive(linear):
    """A hundred steps; one channel in five is silent, all of them for a while."""
    rng = np.random.default_rng(1)
    F, G, H, R, Q = linear.F, linear.G, linear.H, linear.R, linear.process_cov
    steps = 100
    inputs = np.sin(0.1 * np.arange(steps))[:, None]
    readings, means, covs = np.empty((steps, 3)), np.empty((steps, 2)), np.empty((steps, 2, 2))
    x = rng.multivariate_normal(linear.prior_mean, linear.prior_cov)
    m, P = linear.prior_mean, linear.prior_cov
    for k, u in enumerate(inputs):
        x = rng.multivariate_normal(F @ x + G @ u, Q)
        silent = (rng.random(3) < 0.2) | (50 <= k < 55)
        readings[k] = np.where(silent, np.nan, rng.normal(H @ x, np.sqrt(R)))
        m, P = F @ m + G @ u, F @ P @ F.T + Q
        heard = H[~silent]
        K = P @ heard.T @ np.linalg.inv(heard @ P @ heard.T + np.diag(R[~silent]))
        m, P = m + K @ (readings[k, ~silent] - heard @ m), P - K @ heard @ P
        means[k], covs[k] = m, P
    return LinearDrive(inputs, readings, means, covs)


# A study that is driven in a second, as a file
TOML = """# Two short drives.
version = 1
seeds = 2
estimators = ["truth", "ekf"]
[randomise]
speed_kmh = 3
mass = [1.0, 1.25]
[[cell]]
name = "held, slippery"
manoeuvre = "held_steer"
sensors = "outliers"
settings = { friction = 0.5, duration = 1.0 }
[[cell]]
name = "straight on"
benign = true
manoeuvre = "straight_driving"
controller = "sideslip_esc"
settings = { duration = 1.0 }
"""


@pytest.fixture
def study_file(tmp_path):
    path = tmp_path / "brief.toml"
    path.write_text(TOML)
    return path
