"""Moving-horizon estimation: tunings of :mod:`vse_gym.inference.moving_horizon`."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import hold
from vse_gym.estimators.base import Estimator
from vse_gym.inference.moving_horizon import CauchyGaussian, Huber, MovingHorizon, moving_horizon_update
from vse_gym.models import ModelTuning, Nominal, SingleTrackTuning
from vse_gym.models.tuning import tunable
from vse_gym.noise import contamination
from vse_gym.types import CHANNELS, INPUT_CHANNELS, Array, Estimate, Reading

LOSSES = ("cauchy_gaussian", "huber", "least_squares")


class Window(NamedTuple):
    """The last readings, the trajectory that fits them best, and what was known before them."""

    constants: Any  # rule and model, held by compiled code
    mean: Array  # of the state before the window's first reading, (n,)
    cov: Array  # (n, n)
    states: Array  # from that state on, (readings + 1, n)
    inputs: Array  # as the model has heeded and recalled them, (readings, k)
    readings: Array  # (readings, 10)
    variances: Array  # of their noise; NaN: not used; (readings, 10)
    memory: Array  # of the model, (k,)
    newest_cov: Array  # (n, n)
    output: Array  # vx, vy, yaw rate, ax, ay, NIS and its degrees of freedom, (7,)

    @property
    def model(self) -> Any:
        """What is believed of the car."""
        return self.constants.value[1]


@dataclass(frozen=True)
class MovingHorizonEstimator(Estimator):
    """The trajectory that fits the last readings best, outliers weighed down. Rao, Rawlings, Mayne (2003).

    Raises:
        ValueError: If there is no such loss, the limit is not positive, or alpha lies outside [1, 2].
    """

    model: ModelTuning = field(default_factory=SingleTrackTuning)
    horizon: int = 10  # readings
    iterations: int = 2  # Gauss-Newton steps for each reading
    loss: str = "cauchy_gaussian"  # or "huber" or "least_squares"
    alpha: float = tunable(1.5, 1.0, 2.0)  # characteristic exponent of the Cauchy-Gaussian loss, 2 is Gaussian [-]
    limit: float = 1.345  # where Huber's loss turns into a line [standard deviations]

    def __post_init__(self) -> None:
        super().__post_init__()
        contamination(self.alpha)
        if self.loss not in LOSSES:
            raise ValueError(f"loss must be one of {', '.join(LOSSES)}, not {self.loss!r}")
        if not self.limit > 0:
            raise ValueError(f"limit must be positive, not {self.limit}")

    @property
    def rule(self) -> MovingHorizon:
        """Loss, horizon and iterations."""
        loss = {
            "huber": Huber(float(self.limit)),
            "cauchy_gaussian": CauchyGaussian(float(contamination(self.alpha))),
            "least_squares": Huber(),
        }
        return MovingHorizon(loss[self.loss], int(self.horizon), int(self.iterations))

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Window:
        model: Any = self.model.build(nominal)
        mean, cov = model.prior_mean, model.prior_cov
        inputs, readings = np.empty((0, len(INPUT_CHANNELS))), np.empty((0, len(CHANNELS)))
        window = mean[None].copy(), inputs, readings, readings
        output = np.array([*mean[:3], 0.0, 0.0, math.nan, 0.0])
        return Window(hold((self.rule, model)), mean, cov, *window, model.memory, cov, output)

    def update(self, state: Window, reading: Reading, rng: np.random.Generator) -> Window:
        return Window(state.constants, *moving_horizon_update(*state[:8], reading.inputs, reading.y))

    def estimate(self, state: Window) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.newest_cov[:3, :3])

    def innovation(self, state: Window) -> tuple[float, float]:
        return float(state.output[5]), float(state.output[6])

    def tell_friction(self, state: Window, friction: float) -> Window:
        rule, model = state.constants.value
        return state._replace(constants=hold((rule, model._replace(friction=float(friction)))))
