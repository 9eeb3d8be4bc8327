"""The textbook's sideslip observer, a Kalman filter on the linear bicycle, and what its kind says."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import Gate, GaussianState
from vse_gym.inference.linear import Kalman, kalman_update
from vse_gym.models import LinearBicycleTuning, Nominal
from vse_gym.types import Estimate, Reading


class BicycleEstimator(Estimator):
    """Who believes vy and yaw rate and takes vx for known: what is said of a state with ``belief`` and ``cov`` (2, 2).

    A belief ends with vx, vy, yaw rate, ax, ay, NIS and its degrees of freedom.
    """

    def estimate(self, state: Any) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.belief[-7:].tolist()
        cov = np.full((3, 3), np.nan)
        cov[1:, 1:] = state.cov
        return Estimate(vx, vy, yaw_rate, ax, ay, cov)

    def innovation(self, state: Any) -> tuple[float, float]:
        nis, dof = state.belief[-2:].tolist()
        return nis, dof


@dataclass(frozen=True)
class LinearKalmanFilter(BicycleEstimator):
    """Kalman's filter on two axles with linear tyres, scheduled by the wheels' speed. Kalman (1960).

    vx is not in its state: it is the wheels' speed, and the covariance does not know it.
    """

    model: LinearBicycleTuning = field(default_factory=LinearBicycleTuning)
    gate: Gate = field(default=Gate(), kw_only=True)

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        model = self.gate.remembered(self.model.build(nominal))
        output = np.array([nominal.speed, *model.prior_mean, np.nan, 0.0, np.nan, 0.0])
        belief = np.concatenate((model.prior_mean, model.prior_cov.ravel(), model.memory, output))
        return GaussianState(hold((Kalman(self.gate.limit, self.gate.readings(nominal)), model)), belief)

    def update(self, state: GaussianState, reading: Reading, rng: np.random.Generator) -> GaussianState:
        constants, belief = state
        return GaussianState(constants, kalman_update(constants, belief, reading.inputs, reading.y))
