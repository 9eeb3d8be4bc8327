"""An estimator made worse on purpose: a judge that does not see it is no judge."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.types import Estimate, Reading


class Past(NamedTuple):
    """What the inner estimator believes, and what it said before."""

    inner: Any
    said: tuple[Estimate, ...]  # oldest first
    steps: int  # age of what is handed on


@dataclass(frozen=True)
class Degraded(Estimator):
    """Another estimator's estimate, late, its vy times a gain and plus a bias; as sure of itself as that one.

    Raises:
        ValueError: If delay is negative.
    """

    inner: Estimator
    gain: float = 1.0  # on vy [-]
    delay: float = 0.0  # age of the whole estimate [s]
    bias: float = 0.0  # added to vy after the gain [m/s]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.delay >= 0:
            raise ValueError(f"delay must not be negative, not {self.delay}")

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Past:
        inner = self.inner.init(nominal, rng)
        return Past(inner, (self.inner.estimate(inner),), round(self.delay / nominal.dt))

    def update(self, state: Past, reading: Reading, rng: np.random.Generator) -> Past:
        inner = self.inner.update(state.inner, reading, rng)
        said = (*state.said, self.inner.estimate(inner))
        return state._replace(inner=inner, said=said[-state.steps - 1 :])

    def estimate(self, state: Past) -> Estimate:
        old = state.said[0]
        return old._replace(vy=self.gain * old.vy + self.bias)

    def innovation(self, state: Past) -> tuple[float, float]:
        return self.inner.innovation(state.inner)

    def effective_size(self, state: Past) -> float:
        return self.inner.effective_size(state.inner)

    @property
    def told_friction(self) -> bool:
        return self.inner.told_friction

    def tell_friction(self, state: Past, friction: float) -> Past:
        return state._replace(inner=self.inner.tell_friction(state.inner, friction))
