"""Kalman filters: tunings, and which rule of :mod:`vse_gym.inference.gaussian` they follow."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.inference.gaussian import Extended, Unscented, filter_update
from vse_gym.models import Nominal, SingleTrack, SingleTrackTuning
from vse_gym.types import Array, Estimate, Reading


class GaussianState(NamedTuple):
    """A model, and a belief over its state."""

    constants: Any  # rule and model, held by compiled code
    belief: Array  # mean, cov, the model's memory and the output, flat: one array crosses faster than four

    @property
    def model(self) -> SingleTrack:
        """What is believed of the car."""
        model: SingleTrack = self.constants.value[1]
        return model

    @property
    def mean(self) -> Array:
        """Of the model's state, (n,)."""
        return self.belief[: self.model.prior_mean.size]

    @property
    def cov(self) -> Array:
        """Of the model's state, (n, n)."""
        n = self.model.prior_mean.size
        return self.belief[n : n + n * n].reshape(n, n)

    @property
    def output(self) -> Array:
        """vx, vy, yaw rate, ax, ay, NIS and its degrees of freedom, (7,)."""
        return self.belief[-7:]


# GaussianState(...) without the detour through its named arguments, which costs 0.1 us at every update
_state: Callable[[tuple[Any, Array]], GaussianState] = partial(tuple.__new__, GaussianState)


@dataclass(frozen=True)
class GaussianFilter(Estimator):
    """One recursion for all members; each names its rule."""

    model: SingleTrackTuning = field(default_factory=SingleTrackTuning)

    @property
    @abstractmethod
    def rule(self) -> Any:
        """How a Gaussian passes through a function, one of the rules of ``inference.gaussian``."""

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        model = self.model.build(nominal)
        mean = model.prior_mean
        output = np.array([mean[0], mean[1], mean[2], 0.0, 0.0, np.nan, 0.0])
        belief = np.concatenate((mean, model.prior_cov.ravel(), model.memory, output))
        return GaussianState(hold((self.rule, model)), belief)

    def update(self, state: GaussianState, reading: Reading, rng: np.random.Generator) -> GaussianState:
        constants, belief = state
        _, u, y = reading
        return _state((constants, filter_update(constants, belief, u, y)))

    def estimate(self, state: GaussianState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3])

    def innovation(self, state: GaussianState) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])

    def tell_friction(self, state: GaussianState, friction: float) -> GaussianState:
        if friction == state.model.friction:  # holding anew costs more than an update
            return state
        model = state.model._replace(friction=float(friction))
        return GaussianState(hold((self.rule, model)), state.belief)


@dataclass(frozen=True)
class ExtendedKalmanFilter(GaussianFilter):
    """Linearise about the mean, by central differences. Jazwinski (1970)."""

    rule: ClassVar[Extended] = Extended()


@dataclass(frozen=True)
class ToldExtendedKalmanFilter(ExtendedKalmanFilter):
    """The extended Kalman filter, told the friction of the road under the car: what knowing it would be worth."""

    @property
    def told_friction(self) -> bool:
        return True


@dataclass(frozen=True)
class UnscentedKalmanFilter(GaussianFilter):
    """Sigma points instead of derivatives. Julier, Uhlmann (1997); van der Merwe, Wan (2001)."""

    alpha: float = 1.0  # spread of the points [-]
    beta: float = 2.0  # 2 suits a Gaussian [-]
    kappa: float = 0.0

    @property
    def rule(self) -> Unscented:
        return Unscented(self.alpha, self.beta, self.kappa)
