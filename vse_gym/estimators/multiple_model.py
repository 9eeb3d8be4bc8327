"""The interacting multiple model filter: tunings of :mod:`vse_gym.inference.multiple_model`."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import Gate
from vse_gym.inference.gaussian import Extended, Unscented
from vse_gym.inference.multiple_model import Interacting, moments, multiple_model_update
from vse_gym.models import ModelTuning, Nominal, SingleTrackTuning
from vse_gym.models.tuning import tunable
from vse_gym.types import Array, Estimate, Reading

RULES = {"extended": Extended(), "unscented": Unscented()}


class Modes(NamedTuple):
    """A belief over the model's state for each friction, and which friction is how likely."""

    constants: Any  # filter and models, held by compiled code
    probabilities: Array  # (M,)
    means: Array  # (M, n)
    covs: Array  # (M, n, n)
    memory: Array  # of the models and the gate, (k,)
    output: Array  # vx, vy, yaw rate, ax, ay, NIS and its degrees of freedom, (7,)

    @property
    def cov(self) -> Array:
        """Of all modes together, (n, n)."""
        cov: Array = moments(self.probabilities, self.means, self.covs)[1]
        return cov


@dataclass(frozen=True)
class InteractingMultipleModel(Estimator):
    """Several roads at once, each with its own Kalman filter. Blom, Bar-Shalom (1988).

    The road is drawn anew at random times, each friction with its share: while nothing tells them apart the
    probabilities return to the shares.

    Raises:
        ValueError: If frictions or shares cannot be, their numbers differ, switching is negative, or there is no such
            rule.
    """

    model: ModelTuning = field(default_factory=SingleTrackTuning)
    frictions: tuple[float, ...] = (0.9, 0.3)  # one per mode [-]
    shares: tuple[float, ...] = (0.9, 0.1)  # of each friction in the long run, and at the start; summing to one [-]
    switching: float = tunable(2.0, 0.02, 20.0)  # how often the road is drawn anew [1/s]
    rule: str = "extended"  # or "unscented"
    gate: Gate = field(default=Gate(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.frictions and all(0 < friction <= 2 for friction in self.frictions)):
            raise ValueError(f"frictions must lie in (0, 2], not {self.frictions}")
        if not (len(self.shares) == len(self.frictions) and min(self.shares) > 0 and abs(sum(self.shares) - 1) < 1e-9):
            raise ValueError(f"shares must be positive, one per friction, and sum to one, not {self.shares}")
        if not 0 <= self.switching < math.inf:
            raise ValueError(f"switching must be finite and not negative, not {self.switching}")
        if self.rule not in RULES:
            raise ValueError(f"rule must be one of {', '.join(RULES)}, not {self.rule!r}")

    @property
    def resolution(self) -> float:
        """Mean distance from one mode's friction to the next [-]."""
        return (max(self.frictions) - min(self.frictions)) / max(1, len(self.frictions) - 1)

    def transition(self, dt: float) -> Array:
        """Row i: probabilities of the modes a time dt after mode i, (M, M)."""
        stays = math.exp(-self.switching * dt)
        return stays * np.eye(len(self.shares)) + (1 - stays) * np.array(self.shares)

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Modes:
        model: Any = self.gate.remembered(self.model.build(nominal))
        modes = len(self.frictions)
        models = tuple(model._replace(friction=float(friction)) for friction in self.frictions)
        limits = self.gate.limit, self.gate.readings(nominal)
        constants = hold((Interacting(RULES[self.rule], self.transition(nominal.dt), *limits), models))
        means, covs = np.tile(model.prior_mean, (modes, 1)), np.tile(model.prior_cov, (modes, 1, 1))
        output = np.array([*model.prior_mean[:3], 0.0, 0.0, np.nan, 0.0])
        return Modes(constants, np.array(self.shares, dtype=float), means, covs, model.memory, output)

    def update(self, state: Modes, reading: Reading, rng: np.random.Generator) -> Modes:
        constants, probabilities, means, covs, memory, _ = state
        return Modes(
            constants,
            *multiple_model_update(constants, probabilities, means, covs, memory, reading.inputs, reading.y),
        )

    def estimate(self, state: Modes) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        weighted = list(zip(state.probabilities.tolist(), self.frictions, strict=True))
        friction = sum(p * f for p, f in weighted)
        within = self.resolution**2 / 12  # a road between two modes is taken for the nearer
        std = math.sqrt(within + sum(p * (f - friction) ** 2 for p, f in weighted))
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3], friction=friction, friction_std=std)

    def innovation(self, state: Modes) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])
