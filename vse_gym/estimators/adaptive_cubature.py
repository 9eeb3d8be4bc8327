"""The adaptive cubature Kalman filter: noise levels found on line, on the double track with roll."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vse_gym.estimators.gaussian import GaussianFilter
from vse_gym.inference.gaussian import Cubature, SageHusa, untaught
from vse_gym.models import ModelTuning, RollTrackTuning
from vse_gym.models.tuning import tunable


@dataclass(frozen=True)
class AdaptiveCubatureKalmanFilter(GaussianFilter):
    """The cubature filter with Sage and Husa's estimate of the reading noise.

    Arasaratnam, Haykin (2009); Sage, Husa (1969). What each particle of CN110532590A (2019) does.
    """

    model: ModelTuning = field(default_factory=RollTrackTuning)
    forgetting: float = tunable(0.98, 0.9, 0.999)  # b [-]
    floor: float = 0.1  # least factor on the variance that the model gives [-]
    cap: float = 10.0  # greatest [-]
    limit: float = 9.0  # squared innovation over its variance beyond which a reading teaches nothing [-]
    head_start: float = 50.0  # readings that count as having agreed with the model before the first [-]

    @property
    def rule(self) -> SageHusa:
        return SageHusa(Cubature(), *map(float, (self.forgetting, self.floor, self.cap, self.limit)))

    def remembered(self, model: Any) -> Any:
        taught = untaught(self.rule, model.variances.size, self.head_start)
        return model._replace(memory=np.concatenate((model.memory, taught)))
