"""Particle filters with a Gaussian filter in every particle: tunings of :mod:`vse_gym.inference.particle_proposal`."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator, found
from vse_gym.estimators.particle import cauchy_shares
from vse_gym.inference.gaussian import Unscented
from vse_gym.inference.linalg import cholesky
from vse_gym.inference.particle import draw
from vse_gym.inference.particle_proposal import proposal_step
from vse_gym.models import ModelTuning, Nominal, RollTrackTuning
from vse_gym.models.adaptation import SageHusaTuning
from vse_gym.models.tuning import check_channels, check_positive, check_range, tunable
from vse_gym.noise import contamination
from vse_gym.types import Array, Estimate, Reading

# From a random search for all members, on six drives of three cars. With the Kalman filters' numbers a particle's own
# doubt is many times the step that its state may take, and few of a hundred draws are worth anything.
TUNING = RollTrackTuning(
    vx_noise=0.11,
    vy_noise=0.44,
    yaw_noise=0.28,
    ax_error=3.0,
    ay_error=0.62,
    yaw_rate_error=0.03,
    wheel_error=0.03,
    roll_rate_noise=0.09,
    roll_noise=0.003,
)


class SigmaParticles(NamedTuple):
    """A weighted sample of the model's state, and every particle's own doubt."""

    constants: Any  # rule and model, held by compiled code
    states: Array  # (n, N)
    factors: Array  # of the particles' covariances, lower, (N, n, n)
    weights: Array  # (N,), summing to one
    memory: Array  # (k,)
    mean: Array  # (n,), of the weighted sample before resampling
    cov: Array  # (n, n), of the same
    output: Array  # vx, vy, yaw rate, ax, ay, effective sample size, (6,)

    @property
    def model(self) -> Any:
        """What is believed of the car."""
        return self.constants.value[1]


@dataclass(frozen=True)
class SigmaParticleFilter(Estimator):
    """One recursion for all members; each names its rule.

    As published a particle's covariance is carried on beside the particle (``carried`` 1). The doubt is counted twice
    then, by the sample and by every member of it, and the proposal is wider than the motion: of a state that hardly
    any sensor tells, few draws are likely to come from where they started. With ``carried`` 0 every particle is
    certain of where it is, and the proposal is the optimal one, linearised: Doucet, Godsill, Andrieu (2000).

    Raises:
        ValueError: If a number is out of range, or there is no such channel.
    """

    model: ModelTuning = TUNING
    size: int = 100  # N
    widening: float = tunable(1.0, 1.0, 2.0)  # c: of the proposal's covariance [-]
    carried: float = tunable(1.0, 0.0, 1.0)  # of a particle's deviation, what its next step has; 1 as published [-]
    alpha: float = 1.5  # characteristic exponent of the likelihood's noise, 2 is Gaussian; proposals are Gaussian [-]
    heavy: tuple[str, ...] = ("ax", "ay", "yaw_rate", "roll_rate")  # channels with such noise; others are Gaussian
    resample_below: float = 0.5  # effective sample size over N [-]

    def __post_init__(self) -> None:
        super().__post_init__()
        contamination(self.alpha)
        if self.size < 2:
            raise ValueError(f"size must be at least 2, not {self.size}")
        check_range(1, 2, widening=self.widening)
        check_range(0, 1, carried=self.carried, resample_below=self.resample_below)
        check_channels("heavy", self.heavy)

    @property
    @abstractmethod
    def rule(self) -> Any:
        """How a particle's Gaussian passes through a function, one of the rules with points."""

    def memory(self, model: Any) -> Array:
        """What rule and model remember at the start, (k,)."""
        memory: Array = model.memory
        return memory

    def init(self, nominal: Nominal, rng: np.random.Generator) -> SigmaParticles:
        model = self.model.build(nominal)
        mean, factor = model.prior_mean, np.empty_like(model.prior_cov)
        cholesky(model.prior_cov, factor)
        return SigmaParticles(
            constants=hold((self.rule, model)),
            states=draw(mean, model.prior_cov, self.size, rng),
            factors=np.tile(self.carried * factor, (self.size, 1, 1)),
            weights=np.full(self.size, 1 / self.size),
            memory=self.memory(model),
            mean=mean,
            cov=model.prior_cov,
            output=np.array([mean[0], mean[1], mean[2], 0.0, 0.0, self.size]),
        )

    def update(self, state: SigmaParticles, reading: Reading, rng: np.random.Generator) -> SigmaParticles:
        constants, states, factors, weights, memory, _, _, _ = state
        return SigmaParticles(
            constants,
            *proposal_step(
                constants,
                states,
                factors,
                weights,
                memory,
                reading.inputs,
                reading.y,
                cauchy_shares(contamination(self.alpha), self.heavy),
                float(self.widening) ** 0.5,
                float(self.carried),
                float(self.resample_below),
                rng,
            ),
        )

    def estimate(self, state: SigmaParticles) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3], **found(state.model, state.mean, state.cov))

    def effective_size(self, state: SigmaParticles) -> float:
        return float(state.output[5])

    def tell_friction(self, state: SigmaParticles, friction: float) -> SigmaParticles:
        rule, model = state.constants.value
        return state._replace(constants=hold((rule, model._replace(friction=float(friction)))))


@dataclass(frozen=True)
class UnscentedParticleFilter(SigmaParticleFilter):
    """Every particle looks ahead by an unscented Kalman filter. Van der Merwe, Doucet, de Freitas, Wan (2000).

    Raises:
        ValueError: If the spread is not positive.
    """

    spread: float = 1.0  # alpha of the sigma points [-]
    beta: float = 2.0  # 2 suits a Gaussian [-]
    kappa: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(spread=self.spread)

    @property
    def rule(self) -> Unscented:
        return Unscented(float(self.spread), float(self.beta), float(self.kappa))


@dataclass(frozen=True)
class AdaptiveCubatureParticleFilter(SageHusaTuning, SigmaParticleFilter):
    """Every particle looks ahead by a cubature filter with reading noise found on line. CN110532590A (2019).

    Sage and Husa's estimate of that noise is one for all particles, fed by their weighted mean.
    """

    def memory(self, model: Any) -> Array:
        return self.taught(model)
