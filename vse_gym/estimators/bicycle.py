"""The textbook's sideslip observer: a Kalman filter on the linear bicycle."""

from dataclasses import dataclass, field

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import Gate, GaussianState
from vse_gym.inference.linear import Kalman, kalman_update
from vse_gym.models import LinearBicycleTuning, Nominal
from vse_gym.types import Estimate, Reading


@dataclass(frozen=True)
class LinearKalmanFilter(Estimator):
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

    def estimate(self, state: GaussianState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        cov = np.full((3, 3), np.nan)
        cov[1:, 1:] = state.cov
        return Estimate(vx, vy, yaw_rate, ax, ay, cov)

    def innovation(self, state: GaussianState) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])
