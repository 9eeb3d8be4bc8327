"""Kalman filters: tunings, and which rule of :mod:`vse_gym.inference.gaussian` they follow."""

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from statistics import NormalDist
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator, found
from vse_gym.inference.gaussian import (
    Cubature,
    Extended,
    Gated,
    HeavyTailed,
    SquareRootUnscented,
    Unscented,
    cauchy_rungs,
    covariance,
    filter_update,
    keep,
)
from vse_gym.models import DoubleTrackTuning, ModelTuning, Nominal, SingleTrackTuning
from vse_gym.models.tuning import Settings, check_channels, check_positive, tunable
from vse_gym.noise import contamination
from vse_gym.types import CHANNELS, Array, Estimate, Reading


class GaussianState(NamedTuple):
    """A model, and a belief over its state."""

    constants: Any  # rule and model, held by compiled code
    belief: Array  # mean, what is kept of cov, memory and output, flat: one array crosses faster than four

    @property
    def model(self) -> Any:
        """What is believed of the car."""
        return self.constants.value[1]

    @property
    def mean(self) -> Array:
        """Of the model's state, (n,)."""
        return self.belief[: self.model.prior_mean.size]

    @property
    def kept(self) -> Array:
        """What the rule carries in place of a covariance, (k, n)."""
        model = self.model
        n = model.prior_mean.size
        return self.belief[n : self.belief.size - 7 - model.memory.size].reshape(-1, n)

    @property
    def cov(self) -> Array:
        """Of the model's state, (n, n)."""
        cov: Array = covariance(self.constants.value[0], self.kept)
        return cov

    @property
    def output(self) -> Array:
        """vx, vy, yaw rate, ax, ay, NIS and its degrees of freedom, (7,)."""
        return self.belief[-7:]


# GaussianState(...) without the detour through its named arguments, which costs 0.1 us at every update
_state: Callable[[tuple[Any, Array]], GaussianState] = partial(tuple.__new__, GaussianState)


@dataclass(frozen=True)
class Gate(Settings):
    """Which innovations are too large to be believed, channel by channel.

    Raises:
        ValueError: If ``passing`` is no share, or the patience negative.
    """

    passing: float = 1.0  # share of a channel's good readings that pass; 1: no gate [-]
    patience: float = 0.15  # a channel refused for this long is believed, whatever it says [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (0 < self.passing <= 1 and 0 <= self.patience < math.inf):
            raise ValueError(
                f"passing must lie in (0, 1] and patience not be negative, not {self.passing} and {self.patience}"
            )

    @property
    def limit(self) -> float:
        """Quantile of chi-square with one degree of freedom: the square of a normal one [-]."""
        return NormalDist().inv_cdf(0.5 + 0.5 * self.passing) ** 2 if self.passing < 1 else math.inf

    def readings(self, nominal: Nominal) -> float:
        """The patience in readings."""
        return float(round(self.patience / nominal.dt))

    def remembered(self, model: Any) -> Any:
        """The model with room for how often each channel has been refused."""
        return model._replace(memory=np.concatenate((model.memory, np.zeros(model.variances.size))))


@dataclass(frozen=True)
class GaussianFilter(Estimator):
    """One recursion for all members; each names its rule."""

    model: ModelTuning = field(default_factory=SingleTrackTuning)
    gate: Gate = field(default=Gate(), kw_only=True)

    @property
    @abstractmethod
    def rule(self) -> Any:
        """How a Gaussian passes through a function, one of the rules of ``inference.gaussian``."""

    def believed(self, nominal: Nominal) -> Any:
        """The model of a nominal car."""
        return self.model.build(nominal)

    def remembered(self, model: Any) -> Any:
        """The model with room for what the rule remembers; most remember nothing."""
        return model

    def gated(self, model: Any, nominal: Nominal) -> tuple[Any, Any]:
        """The rule, behind the gate if there is one, and the model with room for what both remember."""
        rule, model = self.rule, self.remembered(model)
        if self.gate.passing < 1:
            return Gated(rule, self.gate.limit, self.gate.readings(nominal)), self.gate.remembered(model)
        return rule, model

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        rule, model = self.gated(self.believed(nominal), nominal)
        mean = model.prior_mean
        output = np.array([mean[0], mean[1], mean[2], 0.0, 0.0, np.nan, 0.0])
        belief = np.concatenate((mean, keep(rule, model.prior_cov).ravel(), model.memory, output))
        return GaussianState(hold((rule, model)), belief)

    def update(self, state: GaussianState, reading: Reading, rng: np.random.Generator) -> GaussianState:
        constants, belief = state
        _, u, y = reading
        return _state((constants, filter_update(constants, belief, u, y)))

    def estimate(self, state: GaussianState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        model, cov = state.model, state.cov
        return Estimate(vx, vy, yaw_rate, ax, ay, cov[:3, :3], **found(model, state.belief, cov))

    def innovation(self, state: GaussianState) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])

    def tell_friction(self, state: GaussianState, friction: float) -> GaussianState:
        known = getattr(state.model, "friction", None)
        if friction == known:  # holding anew costs more than an update
            return state
        if known is None:
            raise TypeError(f"{type(state.model).__name__} cannot be told the friction")
        rule, model = state.constants.value
        return GaussianState(hold((rule, model._replace(friction=float(friction)))), state.belief)


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
    """Sigma points instead of derivatives. Julier, Uhlmann (1997); van der Merwe, Wan (2001).

    Raises:
        ValueError: If alpha is not positive.
    """

    alpha: float = 1.0  # spread of the points [-]
    beta: float = 2.0  # 2 suits a Gaussian [-]
    kappa: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(alpha=self.alpha)

    @property
    def rule(self) -> Unscented:
        return Unscented(self.alpha, self.beta, self.kappa)


@dataclass(frozen=True)
class SquareRootUnscentedKalmanFilter(UnscentedKalmanFilter):
    """The unscented filter on a factor of the covariance, by QR and rank-one updates. Van der Merwe, Wan (2001)."""

    @property
    def rule(self) -> SquareRootUnscented:  # type: ignore[override]
        return SquareRootUnscented(self.alpha, self.beta, self.kappa)


@dataclass(frozen=True)
class CubatureKalmanFilter(GaussianFilter):
    """Points along the axes of the covariance, all of one weight. Arasaratnam, Haykin (2009)."""

    rule: ClassVar[Cubature] = Cubature()


@dataclass(frozen=True)
class CauchyGaussianKalmanFilter(GaussianFilter):
    """The extended filter that expects heavy tails: Masreliez (1975), for the noise law of Qin et al. (2014).

    Raises:
        ValueError: If alpha lies outside [1, 2], or there is no such channel.
    """

    alpha: float = tunable(1.5, 1.0, 2.0)  # characteristic exponent of the noise, 2 is Gaussian [-]
    heavy: tuple[str, ...] = ("ax", "ay", "yaw_rate", "roll_rate")  # channels with such noise; others are Gaussian

    def __post_init__(self) -> None:
        super().__post_init__()
        contamination(self.alpha)
        check_channels("heavy", self.heavy)

    @property
    def rule(self) -> HeavyTailed:
        weights, variances = cauchy_rungs()
        share = np.array([[contamination(self.alpha) * (name in self.heavy)] for name in CHANNELS])
        # The Cauchy part's scale is the core's sigma over sqrt 2
        return HeavyTailed(np.hstack((1 - share, share * weights)), np.concatenate(([1.0], 0.5 * variances)))


@dataclass(frozen=True)
class DoubleTrackExtendedKalmanFilter(ExtendedKalmanFilter):
    """The extended filter on four wheels with the car's own tyres, whose slips it sees."""

    model: ModelTuning = field(default_factory=DoubleTrackTuning)


@dataclass(frozen=True)
class DoubleTrackUnscentedKalmanFilter(UnscentedKalmanFilter):
    """The unscented filter on four wheels with the car's own tyres, whose slips it sees."""

    model: ModelTuning = field(default_factory=DoubleTrackTuning)
