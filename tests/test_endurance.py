"""Covariances stay covariances over long drives; ``benchmarks/endurance.py`` says so of fifty times as long ones."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.types import Estimate

PROGRAM = Path(__file__).parent.parent / "benchmarks" / "endurance.py"
WITHOUT = {"truth", "truth_velocity", "zero", "kinematic"}  # a covariance that would be theirs to keep


@pytest.fixture(scope="module")
def endurance():
    spec = importlib.util.spec_from_file_location("endurance", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def long_drive(endurance):
    return endurance.endurance_drive(seed=1)


@pytest.mark.parametrize("name", [name for name in ESTIMATORS if name not in WITHOUT])
def test_a_covariance_outlives_silence_and_repetition(name, endurance, long_drive):
    nominal, readings = long_drive
    estimator = ESTIMATORS.make(name)
    steps = 500 if endurance.samples(estimator, nominal, readings[0]) else 2000
    found = endurance.endure(estimator, nominal, readings, steps)
    if found is None:  # one from elsewhere may have none
        assert np.isnan(estimator.estimate(estimator.init(nominal, np.random.default_rng(0))).cov).all()
        return
    assert (found.broken, found.steps) == ("", steps)
    assert found.eigenvalue > 0
    assert found.asymmetry < 1e-12


class Tells(Estimator):
    """Hands out what it is made of."""

    def __init__(self, cov):
        self.cov = np.asarray(cov, dtype=float)

    def init(self, nominal, rng):
        return None

    def update(self, state, reading, rng):
        return None

    def estimate(self, state):
        return Estimate(1.0, cov=self.cov)


@pytest.mark.parametrize(
    ("cov", "told"),
    [
        (np.diag([1.0, 1.0, -1e-9]), "not positive definite"),
        ([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], "not symmetric"),
        (np.diag([1.0, np.inf, 1.0]), "not finite"),
        (np.diag([1.0, 1.0, 1e-9]), ""),
    ],
)
def test_what_breaks_is_named(cov, told, endurance, long_drive):
    assert endurance.endure(Tells(cov), *long_drive, 10).broken == told


@pytest.mark.parametrize("name", sorted(WITHOUT))
def test_who_has_no_covariance_is_not_judged(name, endurance, long_drive):
    assert endurance.endure(ESTIMATORS.make(name), *long_drive, 10) is None
