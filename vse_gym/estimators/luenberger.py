"""The sideslip observer with placed poles."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.inference.luenberger import Placed, luenberger_update
from vse_gym.models import LinearBicycleTuning, Nominal
from vse_gym.models.tuning import tunable
from vse_gym.types import Y_AY, Y_YAW_RATE, Array, Estimate, Reading


class ObserverState(NamedTuple):
    """Constants, and what is believed."""

    constants: Any  # poles and model, held by compiled code
    belief: Array  # vy, yaw rate, the model's memory, then vx, vy, yaw rate, ax, ay


@dataclass(frozen=True)
class LuenbergerObserver(Estimator):
    """The linear bicycle, corrected with the innovations of ay and yaw rate by pole placement at the wheels' speed.

    Luenberger (1971), IEEE Transactions on Automatic Control 16(6); for the car: Kiencke, Nielsen (2005), "Automotive
    Control Systems". Through two channels each state's error can be given a rate of its own. A slow one of vy makes it
    the integral of ay - r vx, one as fast as the car's own leaves it to the tyres.

    Of the model's settings only those of its speed and its brakes count; noises are for Kalman filters.

    Raises:
        ValueError: If a rate is not positive.
    """

    vy_rate: float = tunable(2.0, 0.3, 30.0)  # at which an error of vy decays: a pole at minus this (chosen) [1/s]
    yaw_rate: float = tunable(20.0, 3.0, 100.0)  # the same of the yaw rate (chosen) [1/s]
    model: LinearBicycleTuning = field(default_factory=LinearBicycleTuning)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (0 < self.vy_rate < math.inf and 0 < self.yaw_rate < math.inf):
            raise ValueError(f"rates must be positive and finite, not {self.vy_rate} and {self.yaw_rate}")

    def init(self, nominal: Nominal, rng: np.random.Generator) -> ObserverState:
        model = self.model.build(nominal)
        vy_left, yaw_left = (math.exp(-rate * nominal.dt) for rate in (self.vy_rate, self.yaw_rate))
        mean = model.prior_mean
        belief = np.concatenate((mean, model.memory, [nominal.speed, *mean, np.nan, 0.0]))
        return ObserverState(hold((Placed(vy_left, yaw_left, Y_AY, Y_YAW_RATE), model)), belief)

    def update(self, state: ObserverState, reading: Reading, rng: np.random.Generator) -> ObserverState:
        constants, belief = state
        return ObserverState(constants, luenberger_update(constants, belief, reading.inputs, reading.y))

    def estimate(self, state: ObserverState) -> Estimate:
        vx, vy, yaw_rate, ax, ay = state.belief[-5:].tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay)
