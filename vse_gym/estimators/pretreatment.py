"""Another estimator behind the pre-treatment of its readings."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.models.pretreatment import Pretreatment, treat_reading, treated
from vse_gym.types import Array, Estimate, Reading

__all__ = ["Pretreated", "Pretreatment"]


class TreatedState(NamedTuple):
    """The pre-treatment's memory, and what the inner estimator believes."""

    constants: Any  # of the pre-treatment, held by compiled code
    memory: Array  # (16,)
    inner: Any


@dataclass(frozen=True)
class Pretreated(Estimator):
    """Hear ay and yaw rate as Chen, Wu, Ge, Zhao (2024) treat them: filtered, outliers replaced by the last good one.

    ``Pretreated(ExtendedKalmanFilter())`` is the extended Kalman filter with clean readings.
    """

    inner: Estimator
    treatment: Pretreatment = field(default_factory=Pretreatment)

    def init(self, nominal: Nominal, rng: np.random.Generator) -> TreatedState:
        constants, memory = treated(self.treatment, nominal)
        return TreatedState(hold(constants), memory, self.inner.init(nominal, rng))

    def update(self, state: TreatedState, reading: Reading, rng: np.random.Generator) -> TreatedState:
        memory, y = treat_reading(state.constants, state.memory, reading.inputs, reading.y)
        return TreatedState(state.constants, memory, self.inner.update(state.inner, reading._replace(y=y), rng))

    def estimate(self, state: TreatedState) -> Estimate:
        return self.inner.estimate(state.inner)

    def innovation(self, state: TreatedState) -> tuple[float, float]:
        return self.inner.innovation(state.inner)

    def effective_size(self, state: TreatedState) -> float:
        return self.inner.effective_size(state.inner)

    @property
    def told_friction(self) -> bool:
        return self.inner.told_friction

    def tell_friction(self, state: TreatedState, friction: float) -> TreatedState:
        return state._replace(inner=self.inner.tell_friction(state.inner, friction))
