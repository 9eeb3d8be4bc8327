"""The extended filter of three degrees of freedom, plain, and with its mass found and its noise adapted."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vse_gym.estimators.gaussian import ExtendedKalmanFilter, GaussianState
from vse_gym.estimators.identifying import IdentifyingFilter, IdentifyingState, Start
from vse_gym.inference.fuzzy import rule_surface
from vse_gym.inference.gaussian import Extended
from vse_gym.inference.gaussian.fuzzy_adaptive import FuzzyAdaptive
from vse_gym.inference.least_squares import LeastSquares
from vse_gym.models import ModelTuning, Nominal
from vse_gym.models.three_dof import CAR_SENSORS, HEARD, ThreeDofTuning
from vse_gym.models.tuning import check_channels, tunable
from vse_gym.types import Array, Estimate


def motion_cov(mean: Array, cov: Array) -> Array:
    """Covariance of vx, vy = beta vx and yaw rate from that of yaw rate, beta and vx, (3, 3) both."""
    _, beta, vx = mean
    jacobian = np.array([[0.0, 0.0, 1.0], [0.0, vx, beta], [1.0, 0.0, 0.0]])
    out = jacobian @ cov @ jacobian.T
    return np.asarray(0.5 * (out + out.T))


@dataclass(frozen=True)
class ThreeDofExtendedKalmanFilter(ExtendedKalmanFilter):
    """The extended filter on linear tyres, driven by the measured ax: the comparison of Wang, Wei et al. (2017).

    doi:10.3969/j.issn.1004-132X.2017.06.019. It believes the data sheet's mass and its own R, and gives no ax, which is
    an input of its model.
    """

    model: ModelTuning = field(default_factory=ThreeDofTuning)

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        constants, belief = super().init(nominal, rng)
        belief[-7:-4] = nominal.speed, 0.0, 0.0
        return GaussianState(constants, belief)

    def estimate(self, state: GaussianState) -> Estimate:
        return super().estimate(state)._replace(cov=motion_cov(state.mean, state.cov))


@dataclass(frozen=True)
class CarThreeDofExtendedKalmanFilter(ThreeDofExtendedKalmanFilter):
    """The same in a car with a gyro and wheel speeds, which it hears too; the paper's has an accelerometer alone."""

    model: ModelTuning = CAR_SENSORS


@dataclass(frozen=True)
class FuzzyAdaptiveKalmanFilter(IdentifyingFilter):
    """Mass by recursive least squares, measurement variance by fuzzy rules: Wang, Wei, Zhao, Zhang, Yan (2017).

    RLS-FAEKF, doi:10.3969/j.issn.1004-132X.2017.06.019. The mass is what the lateral balance says at the sideslip
    angle of the filter's previous posterior; the sideslip angle of the paper's own figures is the true one.

    Raises:
        ValueError: If a number cannot be; the message names it.
    """

    model: ThreeDofTuning = field(default_factory=ThreeDofTuning)
    # Recursive least squares
    mass_start: float = 1.0  # over the nominal mass; in the published test 1000 kg over 1370 kg [-]
    mass_prior: float = 0.3  # its standard deviation at the start, over the nominal mass [-]
    forgetting: float = tunable(0.998, 0.98, 1.0)  # not published [-]
    least_ay: float = 0.5  # below this lateral acceleration the mass stays as it is [m/s2]
    mass_bounds: tuple[float, float] = (0.5, 2.0)  # over the nominal mass [-]
    # Fuzzy controller: the published ranges are lost
    adapted: tuple[str, ...] = ("ay",)  # channels whose variance it adapts, among those that the model hears
    window: float = tunable(30.0, 5.0, 200.0)  # readings over which the innovation variance is averaged [-]
    decades: float = tunable(2.0, 0.3, 3.0)  # log10 of actual over theoretical variance that is as large as e gets [-]
    change: float = 0.1  # change of e between two readings that is as large as it gets [-]

    def __post_init__(self) -> None:
        check_channels("adapted", self.adapted, HEARD)
        if not 0 < self.forgetting <= 1:
            raise ValueError(f"forgetting must lie in (0, 1], not {self.forgetting}")
        if not 0 < self.mass_bounds[0] <= self.mass_start <= self.mass_bounds[1] < np.inf:
            raise ValueError(
                f"mass_start must lie within mass_bounds, positive and finite, not {self.mass_start} and "
                f"{self.mass_bounds}"
            )
        if not 1 <= self.window < np.inf:
            raise ValueError(f"window must be finite and at least 1, not {self.window}")
        if not 0 <= self.least_ay < np.inf:
            raise ValueError(f"least_ay must be finite and not negative, not {self.least_ay}")
        for name in ("decades", "change", "mass_prior"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive and finite, not {getattr(self, name)}")

    def start(self, nominal: Nominal) -> Start:
        model, mass = self.model.build(nominal), nominal.vehicle.mass
        adapted = np.zeros(model.variances.size)
        adapted[[channel for name in self.adapted for channel in HEARD[name]]] = 1.0
        ranges = float(self.window), float(self.decades), float(self.change)
        rule = FuzzyAdaptive(Extended(), adapted, rule_surface(), *ranges)
        channels = np.zeros((model.variances.size, 2))
        channels[:, 0] = -1.0  # no innovation yet
        cov = np.array([[(self.mass_prior * mass) ** 2]])
        squares = LeastSquares(
            forgetting=float(self.forgetting),
            excitation=float(self.least_ay**2),
            trace=float(cov[0, 0]),
            lower=np.array([self.mass_bounds[0] * mass]),
            upper=np.array([self.mass_bounds[1] * mass]),
        )
        model = model._replace(memory=np.concatenate((model.memory, channels.ravel())))
        return Start(rule, model, squares, np.array([self.mass_start * mass]), cov)

    def motion_cov(self, state: IdentifyingState) -> Array:
        return motion_cov(state.mean, state.cov)

    def found(self, parameters: list[float], std: list[float]) -> Mapping[str, float]:
        return {"mass": parameters[0], "mass_std": std[0]}


@dataclass(frozen=True)
class CarFuzzyAdaptiveKalmanFilter(FuzzyAdaptiveKalmanFilter):
    """The same in a car with a gyro and wheel speeds, which it hears too; the paper's has an accelerometer alone."""

    model: ThreeDofTuning = CAR_SENSORS
