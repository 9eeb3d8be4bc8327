"""Kalman filters: tunings, and which rule of :mod:`vse_gym.inference.gaussian` they follow."""

from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.inference.gaussian import Extended, Unscented, filter_step
from vse_gym.models import Nominal, SingleTrack, SingleTrackTuning
from vse_gym.types import Array, Estimate, Reading


class GaussianState(NamedTuple):
    """A model, a belief over its state, and what the model remembers."""

    model: SingleTrack
    mean: Array  # (n,)
    cov: Array  # (n, n)
    memory: Array  # (k,)
    output: Array  # vx, vy, yaw rate, ax, ay, NIS, its degrees of freedom, (7,)


@dataclass(frozen=True)
class GaussianFilter(Estimator):
    """One recursion for all members; each names its rule."""

    model: SingleTrackTuning = field(default_factory=SingleTrackTuning)

    @property
    def rule(self) -> Any:
        """How a Gaussian passes through a function, one of the rules of ``inference.gaussian``."""
        raise NotImplementedError

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        model = self.model.build(nominal)
        mean = model.prior_mean
        output = np.array([mean[0], mean[1], mean[2], 0.0, 0.0, np.nan, 0.0])
        return GaussianState(model, mean, model.prior_cov, model.memory, output)

    def update(self, state: GaussianState, reading: Reading, rng: np.random.Generator) -> GaussianState:
        model, mean, cov, memory, _ = state
        return GaussianState(model, *filter_step(self.rule, model, mean, cov, memory, reading.inputs, reading.y))

    def estimate(self, state: GaussianState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3])

    def innovation(self, state: GaussianState) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])

    def tell_friction(self, state: GaussianState, friction: float) -> GaussianState:
        return state._replace(model=state.model._replace(friction=float(friction)))


@dataclass(frozen=True)
class ExtendedKalmanFilter(GaussianFilter):
    """Linearise about the mean, by central differences. Jazwinski (1970)."""

    rule: ClassVar[Extended] = Extended()


@dataclass(frozen=True)
class ToldExtendedKalmanFilter(ExtendedKalmanFilter):
    """The extended Kalman filter, told the friction of the road under the car: what knowing it would be worth."""

    told_friction: ClassVar[bool] = True


@dataclass(frozen=True)
class UnscentedKalmanFilter(GaussianFilter):
    """Sigma points instead of derivatives. Julier, Uhlmann (1997); van der Merwe, Wan (2001)."""

    alpha: float = 1.0  # spread of the points [-]
    beta: float = 2.0  # 2 suits a Gaussian [-]
    kappa: float = 0.0

    @property
    def rule(self) -> Unscented:
        return Unscented(self.alpha, self.beta, self.kappa)
