"""Particle filters: tunings of :mod:`vse_gym.inference.particle`."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.inference.particle import bootstrap_step, draw
from vse_gym.models import ModelTuning, Nominal, SingleTrackTuning
from vse_gym.models.tuning import check_channels, check_range, tunable
from vse_gym.noise import contamination
from vse_gym.types import CHANNELS, Array, Estimate, Reading

# From the random search that the Kalman filters' defaults come from, with the same budget. Theirs starves a
# bootstrap filter: among particles spread by that much process noise, a good gyro would leave a handful alive.
TUNING = SingleTrackTuning(
    vx_noise=0.87,
    vy_noise=0.29,
    yaw_noise=0.036,
    ax_error=0.11,
    ay_error=4.3,
    yaw_rate_error=0.036,
    wheel_error=0.16,
)


@lru_cache(maxsize=64)
def cauchy_shares(share: float, heavy: tuple[str, ...]) -> Array:
    """Cauchy share of each channel, (10,)."""
    return np.array([share * (name in heavy) for name in CHANNELS])


class Particles(NamedTuple):
    """A weighted sample of the model's state."""

    model: Any
    states: Array  # (n, N)
    weights: Array  # (N,), summing to one
    memory: Array  # (k,)
    cov: Array  # (n, n), of the weighted sample before resampling
    output: Array  # vx, vy, yaw rate, ax, ay, effective sample size, (6,)


@dataclass(frozen=True)
class BootstrapParticleFilter(Estimator):
    """Propose from the model, weigh by the likelihood. Gordon, Salmond, Smith (1993).

    Raises:
        ValueError: If the likelihood is neither "gaussian" nor "cauchy_gaussian", a number is out of range, or there is
            no such channel.
    """

    model: ModelTuning = TUNING
    size: int = 500  # N
    likelihood: str = "gaussian"
    alpha: float = 1.5  # characteristic exponent of the Cauchy-Gaussian likelihood, 2 is Gaussian [-]
    heavy: tuple[str, ...] = CHANNELS  # channels whose likelihood is Cauchy-Gaussian, if any is; others are Gaussian
    resample_below: float = 0.5  # effective sample size over N [-]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.likelihood not in ("gaussian", "cauchy_gaussian"):
            raise ValueError(f"likelihood must be 'gaussian' or 'cauchy_gaussian', not {self.likelihood!r}")
        contamination(self.alpha)
        if self.size < 2:
            raise ValueError(f"size must be at least 2, not {self.size}")
        check_range(0, 1, resample_below=self.resample_below)
        check_channels("heavy", self.heavy)

    @property
    def cauchy_share(self) -> float:
        """Weight of the Cauchy part in the likelihood [-]. Qin et al. (2014)."""
        return 0.0 if self.likelihood == "gaussian" else contamination(self.alpha)

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Particles:
        model = self.model.build(nominal)
        mean = model.prior_mean
        output = np.array([mean[0], mean[1], mean[2], 0.0, 0.0, self.size])
        states = draw(mean, model.prior_cov, self.size, rng)
        return Particles(model, states, np.full(self.size, 1 / self.size), model.memory, model.prior_cov, output)

    def update(self, state: Particles, reading: Reading, rng: np.random.Generator) -> Particles:
        model, states, weights, memory, _, _ = state
        return Particles(
            model,
            *bootstrap_step(
                model,
                states,
                weights,
                memory,
                reading.inputs,
                reading.y,
                cauchy_shares(self.cauchy_share, self.heavy),
                float(self.resample_below),
                rng,
            ),
        )

    def estimate(self, state: Particles) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3])

    def effective_size(self, state: Particles) -> float:
        return float(state.output[5])

    def tell_friction(self, state: Particles, friction: float) -> Particles:
        return state._replace(model=state.model._replace(friction=float(friction)))


@dataclass(frozen=True)
class CauchyGaussianParticleFilter(BootstrapParticleFilter):
    """The bootstrap filter that expects heavy tails: the likelihood of Qin et al. (2014)."""

    likelihood: str = "cauchy_gaussian"
    alpha: float = tunable(1.5, 1.0, 2.0)  # the Gaussian filter has it too, but does not read it
