"""The unscented filter that finds the friction of the road beside the car's motion."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import Gate, GaussianState
from vse_gym.inference.gaussian import Gated, Unscented, filter_update
from vse_gym.models import Nominal, SingleTrackTuning
from vse_gym.models.single_track_friction import with_friction, within
from vse_gym.models.tuning import tunable
from vse_gym.types import Estimate, Reading


@dataclass(frozen=True)
class FrictionUnscentedKalmanFilter(Estimator):
    """Friction as a fourth state, for sigma points: a derivative by friction is zero until the tyres are near it.

    Julier, Uhlmann (1997); friction as a state for tyre models as in Ray (1997). It begins with the friction that is
    told, and returns to it while nothing says otherwise.

    Raises:
        ValueError: If the noise or the prior of friction is negative, or its decay not positive.
    """

    model: SingleTrackTuning = field(default_factory=SingleTrackTuning)
    noise: float = tunable(0.3, 0.02, 3.0)  # density of the friction's random walk [1/sqrt(s)]
    prior: float = 0.2  # standard deviation of friction at the start [-]
    decay: float = tunable(2.0, 0.2, 50.0)  # time after which a third of what friction departs by is left [s]
    alpha: float = 1.0  # spread of the points [-]
    beta: float = 2.0  # 2 suits a Gaussian [-]
    kappa: float = 0.0
    # An outlier that throws the car sideways is soon taken for a slippery road, and nothing calls it back from there.
    gate: Gate = field(default=Gate(0.999), kw_only=True)

    def __post_init__(self) -> None:
        if not (0 <= self.noise < math.inf and 0 <= self.prior < math.inf and self.decay > 0):
            raise ValueError(
                f"noise and prior must not be negative and decay positive, not {self.noise}, {self.prior} and "
                f"{self.decay}"
            )

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        model = with_friction(self.model.build(nominal), float(self.noise), float(self.prior), float(self.decay))
        rule: Any = Unscented(float(self.alpha), float(self.beta), float(self.kappa))
        if self.gate.passing < 1:
            rule, model = Gated(rule, self.gate.limit, self.gate.readings(nominal)), self.gate.remembered(model)
        output = np.array([*model.prior_mean[:3], 0.0, 0.0, np.nan, 0.0])
        belief = np.concatenate((model.prior_mean, model.prior_cov.ravel(), model.memory, output))
        return GaussianState(hold((rule, model)), belief)

    def update(self, state: GaussianState, reading: Reading, rng: np.random.Generator) -> GaussianState:
        constants, belief = state
        return GaussianState(constants, filter_update(constants, belief, reading.inputs, reading.y))

    def estimate(self, state: GaussianState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        cov = state.cov
        friction, std = within(float(state.mean[3])), math.sqrt(max(0.0, cov[3, 3]))
        return Estimate(vx, vy, yaw_rate, ax, ay, cov[:3, :3], friction=friction, friction_std=std)

    def innovation(self, state: GaussianState) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])
