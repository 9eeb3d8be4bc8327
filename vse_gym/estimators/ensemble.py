"""The ensemble Kalman filter: tunings of :mod:`vse_gym.inference.ensemble`."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.inference.ensemble import ensemble_step
from vse_gym.inference.particle import draw
from vse_gym.models import ModelTuning, Nominal, SingleTrackTuning
from vse_gym.models.tuning import check_range
from vse_gym.types import Array, Estimate, Reading


class Ensemble(NamedTuple):
    """A sample of the model's state, every member as likely as the next."""

    constants: Any  # the model, held by compiled code
    states: Array  # (n, N)
    memory: Array  # of the model, (k,)
    cov: Array  # (n, n), of the sample
    output: Array  # vx, vy, yaw rate, ax, ay, NIS and its degrees of freedom, (7,)

    @property
    def model(self) -> Any:
        """What is believed of the car."""
        return self.constants.value


@dataclass(frozen=True)
class EnsembleKalmanFilter(Estimator):
    """Move every member by Kalman's gain of their sample covariance. Evensen (1994), Burgers et al. (1998).

    Raises:
        ValueError: If the ensemble has fewer than four members, or inflation shrinks it.
    """

    model: ModelTuning = field(default_factory=SingleTrackTuning)
    size: int = 100  # N
    inflation: float = 1.0  # factor on the deviations from the mean, against the narrowness of small samples [-]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.size < 4:
            raise ValueError(f"size must be at least 4, not {self.size}")
        check_range(1, 2, inflation=self.inflation)

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Ensemble:
        model = self.model.build(nominal)
        mean = model.prior_mean
        output = np.array([mean[0], mean[1], mean[2], 0.0, 0.0, np.nan, 0.0])
        states = draw(mean, model.prior_cov, self.size, rng)
        return Ensemble(hold(model), states, model.memory, model.prior_cov, output)

    def update(self, state: Ensemble, reading: Reading, rng: np.random.Generator) -> Ensemble:
        constants, states, memory, _, _ = state
        inflation = float(self.inflation)
        return Ensemble(constants, *ensemble_step(constants, states, memory, reading.inputs, reading.y, inflation, rng))

    def estimate(self, state: Ensemble) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3])

    def innovation(self, state: Ensemble) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])

    def tell_friction(self, state: Ensemble, friction: float) -> Ensemble:
        return state._replace(constants=hold(state.model._replace(friction=float(friction))))
