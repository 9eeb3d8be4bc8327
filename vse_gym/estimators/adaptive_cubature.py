"""The adaptive cubature Kalman filter: noise levels found on line, on the double track with roll."""

from dataclasses import dataclass, field
from typing import Any

from vse_gym.estimators.gaussian import GaussianFilter
from vse_gym.models import ModelTuning, RollTrackTuning
from vse_gym.models.adaptation import SageHusaTuning


@dataclass(frozen=True)
class AdaptiveCubatureKalmanFilter(SageHusaTuning, GaussianFilter):
    """The cubature filter with Sage and Husa's estimate of the reading noise: a particle of CN110532590A (2019) alone.

    Arasaratnam, Haykin (2009); Sage, Husa (1969).
    """

    model: ModelTuning = field(default_factory=RollTrackTuning)

    def remembered(self, model: Any) -> Any:
        return model._replace(memory=self.taught(model))
