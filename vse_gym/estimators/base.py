"""What every estimator is."""

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from vse_gym.models import Nominal
from vse_gym.models.tuning import Settings
from vse_gym.types import Array, Estimate, Reading


def found(model: Any, mean: Array, cov: Array) -> dict[str, float]:
    """Fields of the estimate that a model's further states fill, with their standard deviations.

    A model names them in ``found``, a dictionary of fields and places in its state; most have none.
    """
    out = {}
    for name, i in getattr(model, "found", {}).items():
        out[name], out[f"{name}_std"] = float(mean[i]), math.sqrt(max(0.0, cov[i, i]))
    return out


class Estimator(Settings, ABC):
    """A frozen set of tunings; what it believes travels in a state that it is handed and hands back.

    An estimator knows ``Nominal`` and readings, nothing else. Randomness comes from ``rng`` alone.
    """

    @abstractmethod
    def init(self, nominal: Nominal, rng: np.random.Generator) -> Any:
        """The state one step before the first reading."""

    @abstractmethod
    def update(self, state: Any, reading: Reading, rng: np.random.Generator) -> Any:
        """The state after one more reading; ``state`` stays as it was."""

    @abstractmethod
    def estimate(self, state: Any) -> Estimate:
        """What the state says of the car."""

    def innovation(self, state: Any) -> tuple[float, float]:
        """NIS of the last update and its degrees of freedom; NaN and 0 for who has none."""
        return float("nan"), 0.0

    def effective_size(self, state: Any) -> float:
        """Effective sample size of the last update [-]; NaN for who has no particles."""
        return float("nan")

    @property
    def told_friction(self) -> bool:
        """Whether the loop shall call ``tell_friction`` with the road's true friction; a row's name must say so."""
        return False

    def tell_friction(self, state: Any, friction: float) -> Any:
        """The state after being told the road's friction; only rows whose name says so are told."""
        raise TypeError(f"{type(self).__name__} cannot be told the friction")
