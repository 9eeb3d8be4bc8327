"""What filters share that find parameters of their model by recursive least squares while they run."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import GaussianState
from vse_gym.inference.gaussian import keep
from vse_gym.inference.identification import identify_update
from vse_gym.inference.least_squares import LeastSquares
from vse_gym.models import Nominal
from vse_gym.types import Array, Estimate, Reading


class Start(NamedTuple):
    """A filter before its first reading."""

    rule: Any
    model: Any
    squares: LeastSquares
    parameters: Array  # (p,)
    parameter_cov: Array  # (p, p)


class IdentifyingState(GaussianState):
    """A model, a belief over its state, and one over its parameters, which the model does not know."""

    __slots__ = ()  # constants: rule, model and least squares; belief: as of ``identify_update``

    @property
    def kept(self) -> Array:
        """What the rule carries in place of a covariance, (k, n)."""
        n, p = self.mean.size, self.parameters.size
        return self.belief[n : self.belief.size - 7 - p - p * p - self.model.memory.size].reshape(-1, n)

    @property
    def parameters(self) -> Array:
        """That least squares find, (p,)."""
        p = self.constants.value[2].lower.size
        return self.belief[self.belief.size - 7 - p - p * p :][:p]

    @property
    def parameter_cov(self) -> Array:
        """Of the parameters, (p, p)."""
        p = self.constants.value[2].lower.size
        return self.belief[self.belief.size - 7 - p * p : self.belief.size - 7].reshape(p, p)


@dataclass(frozen=True)
class IdentifyingFilter(Estimator):
    """One recursion for all members; each names its rule, its model and where its parameters start."""

    @abstractmethod
    def start(self, nominal: Nominal) -> Start:
        """The filter before its first reading."""

    @abstractmethod
    def motion_cov(self, state: IdentifyingState) -> Array:
        """Covariance of vx, vy and yaw rate, (3, 3)."""

    @abstractmethod
    def found(self, parameters: list[float], std: list[float]) -> Mapping[str, float]:
        """The parameters and their standard deviations as fields of an :class:`Estimate`."""

    def init(self, nominal: Nominal, rng: np.random.Generator) -> IdentifyingState:
        rule, model, squares, parameters, cov = self.start(nominal)
        parts = (model.prior_mean, keep(rule, model.prior_cov).ravel(), model.memory, parameters, cov.ravel())
        output = np.array([nominal.speed, 0.0, 0.0, np.nan, 0.0, np.nan, 0.0])
        return IdentifyingState(hold((rule, model, squares)), np.concatenate((*parts, output)))

    def update(self, state: IdentifyingState, reading: Reading, rng: np.random.Generator) -> IdentifyingState:
        constants, belief = state
        return IdentifyingState(constants, identify_update(constants, belief, reading.inputs, reading.y))

    def estimate(self, state: IdentifyingState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        std = np.sqrt(np.diag(state.parameter_cov)).tolist()
        found = self.found(state.parameters.tolist(), std)
        return Estimate(vx, vy, yaw_rate, ax, ay, self.motion_cov(state), **found)

    def innovation(self, state: IdentifyingState) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])
