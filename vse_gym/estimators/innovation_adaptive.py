"""The extended Kalman filter that finds its measurement noise on line."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from vse_gym.estimators.gaussian import GaussianFilter
from vse_gym.inference.gaussian import Extended
from vse_gym.inference.gaussian.innovation_adaptive import adaptive_memory
from vse_gym.models import Nominal
from vse_gym.models.adaptation import Adaptation
from vse_gym.types import CHANNELS


@dataclass(frozen=True)
class InnovationAdaptiveKalmanFilter(GaussianFilter):
    """Match the innovations' variance over a window with its theory, and rescale R by it: Mehra (1972).

    IEEE Transactions on Automatic Control 17(5); with the window of Mohamed, Schwarz (1999), Journal of Geodesy 73(4).
    Readings that the gate refuses teach nothing.
    """

    adaptation: Adaptation = field(default_factory=Adaptation)
    rule: ClassVar[Extended] = Extended()

    def gated(self, model: Any, nominal: Nominal) -> tuple[Any, Any]:
        rule = self.adaptation.rule(self.rule, self.gate.limit, self.gate.readings(nominal))
        memory = np.concatenate((model.memory, adaptive_memory(len(CHANNELS), rule.window)))
        return rule, model._replace(memory=memory)
