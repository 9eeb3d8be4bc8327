"""The square-root unscented filter whose cornering stiffnesses recursive least squares find while it runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vse_gym.estimators.identifying import IdentifyingFilter, IdentifyingState, Start
from vse_gym.inference.gaussian import SquareRootUnscented
from vse_gym.inference.least_squares import LeastSquares
from vse_gym.models import ModelTuning, Nominal
from vse_gym.models.force_bicycle import ForceBicycleTuning
from vse_gym.models.tuning import tunable
from vse_gym.types import Array

STATES = 3  # of the bicycle


@dataclass(frozen=True)
class StiffnessAdaptiveKalmanFilter(IdentifyingFilter):
    """SR-UKF on the bicycle, fed the stiffnesses that forgetting least squares find. Tian, Zhang, Wang, Chen (2018).

    J. Jilin University (Engineering). An axle's stiffness is its lateral force over its slip angle at the sideslip of
    the filter's previous posterior; it is bounded, and stays as it is near zero steer.

    Raises:
        ValueError: If a number cannot be; the message names it.
    """

    model: ModelTuning = field(default_factory=ForceBicycleTuning)
    forgetting: float = tunable(0.95, 0.7, 0.9995)  # a stiffness falls within a turn: memory of 0.2 s [-]
    stiffness_prior: float = 0.3  # standard deviation at the start, over the nominal stiffness [-]
    stiffness_bounds: tuple[float, float] = (0.1, 5.0)  # over the nominal; a sliding axle's falls to a tenth [-]
    adapts: bool = True  # False: the stiffnesses stay nominal, to show what adapting is worth
    alpha: float = 1.0  # spread of the sigma points [-]
    beta: float = 2.0  # 2 suits a Gaussian [-]
    kappa: float = 0.0

    def __post_init__(self) -> None:
        low, high = self.stiffness_bounds
        if not 0 < low <= 1 <= high < np.inf:
            raise ValueError(
                f"stiffness_bounds must be positive, finite and hold 1, the nominal, not {self.stiffness_bounds}"
            )
        if not (0 < self.forgetting <= 1 and 0 < self.stiffness_prior < np.inf):
            raise ValueError(
                f"forgetting must lie in (0, 1] and stiffness_prior be positive, not {self.forgetting} and "
                f"{self.stiffness_prior}"
            )
        if not (0 < self.alpha < np.inf and 0 <= self.beta < np.inf and -STATES < self.kappa < np.inf):
            raise ValueError(
                f"alpha must be positive, beta not negative and kappa larger than {-STATES}, not {self.alpha}, "
                f"{self.beta} and {self.kappa}"
            )

    def start(self, nominal: Nominal) -> Start:
        car = nominal.vehicle
        stiffness = np.array([2 * car.front_tyre.cornering_stiffness, 2 * car.rear_tyre.cornering_stiffness])
        cov = np.diag((self.stiffness_prior * stiffness) ** 2)
        squares = LeastSquares(
            forgetting=float(self.forgetting),
            excitation=0.0 if self.adapts else np.inf,  # what excites is the model's to say
            trace=float(np.trace(cov)),
            lower=self.stiffness_bounds[0] * stiffness,
            upper=self.stiffness_bounds[1] * stiffness,
        )
        rule = SquareRootUnscented(float(self.alpha), float(self.beta), float(self.kappa))
        return Start(rule, self.model.build(nominal), squares, stiffness, cov)

    def motion_cov(self, state: IdentifyingState) -> Array:
        return state.cov

    def found(self, parameters: list[float], std: list[float]) -> Mapping[str, float]:
        names = ("stiffness_front", "stiffness_rear")
        return dict(zip(names, parameters, strict=True)) | dict(zip((f"{n}_std" for n in names), std, strict=True))
