"""The unscented filter that finds the friction of the road beside the car's motion."""

import math
from dataclasses import dataclass, field

from vse_gym.estimators.gaussian import Gate, GaussianState, UnscentedKalmanFilter
from vse_gym.models import Nominal, SingleTrackTuning
from vse_gym.models.single_track_friction import FrictionSingleTrack, with_friction, within
from vse_gym.models.tuning import tunable
from vse_gym.types import Estimate


@dataclass(frozen=True)
class FrictionUnscentedKalmanFilter(UnscentedKalmanFilter):
    """The unscented filter with the road's friction as a fourth state. Julier, Uhlmann (1997); Ray (1997).

    Sigma points, since a derivative by friction is zero until the tyres are near it. It begins with the friction that
    is told, and returns to it while nothing says otherwise.

    Raises:
        ValueError: If the noise or the prior of friction is negative, or its decay not positive.
    """

    model: SingleTrackTuning = field(default_factory=SingleTrackTuning)
    noise: float = tunable(0.3, 0.02, 3.0)  # density of the friction's random walk [1/sqrt(s)]
    prior: float = 0.2  # standard deviation of friction at the start [-]
    decay: float = tunable(2.0, 0.2, 50.0)  # time after which a third of what friction departs by is left [s]
    # An outlier that throws the car sideways is soon taken for a slippery road, and nothing calls it back from there.
    gate: Gate = field(default=Gate(0.999), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.noise < math.inf and 0 <= self.prior < math.inf and self.decay > 0):
            raise ValueError(
                f"noise and prior must not be negative and decay positive, not {self.noise}, {self.prior} and "
                f"{self.decay}"
            )

    def believed(self, nominal: Nominal) -> FrictionSingleTrack:
        car = self.model.build(nominal)
        return with_friction(car, float(self.noise), float(self.prior), float(self.decay))

    def estimate(self, state: GaussianState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.output.tolist()
        cov = state.cov
        friction, std = within(float(state.mean[3])), math.sqrt(max(0.0, cov[3, 3]))
        return Estimate(vx, vy, yaw_rate, ax, ay, cov[:3, :3], friction=friction, friction_std=std)
