"""Which channels' noise a filter finds on line, and how far it may go."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vse_gym.inference.gaussian import Cubature, SageHusa, untaught
from vse_gym.inference.gaussian.innovation_adaptive import InnovationAdaptive
from vse_gym.models.tuning import Settings, check_channels, tunable
from vse_gym.types import CHANNELS, Array


@dataclass(frozen=True)
class Adaptation(Settings):
    """Window matching of the innovations' variance, channel by channel, with a floor and a cap. Mehra (1972).

    Raises:
        ValueError: If floor and cap cannot be, or there is no such channel.
    """

    window: int = 30  # readings
    floor: float = tunable(0.1, 0.001, 1.0)  # of the factor on a channel's noise variance [-]
    cap: float = tunable(100.0, 1.0, 1000.0)  # [-]
    channels: tuple[str, ...] = ("ax", "ay", "yaw_rate")  # whose noise is adapted

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "channels", tuple(self.channels))
        if not 0 < self.floor <= self.cap < math.inf:
            raise ValueError(f"floor and cap must be positive, finite and in order, not {self.floor} and {self.cap}")
        check_channels("channels", self.channels)

    def rule(self, inner: Any, limit: float = math.inf, patience: float = 0.0) -> InnovationAdaptive:
        """A Gaussian rule that adapts, behind a gate on each channel."""
        adapted = np.array([name in self.channels for name in CHANNELS])
        floor, cap = np.where(adapted, float(self.floor), 1.0), np.where(adapted, float(self.cap), 1.0)
        return InnovationAdaptive(inner, int(self.window), floor, cap, float(limit), float(patience))


@dataclass(frozen=True)
class SageHusaTuning(Settings):
    """The cubature rule with Sage and Husa's estimate of the reading noise, for a filter or for every particle.

    Raises:
        ValueError: If a number is out of range.
    """

    forgetting: float = tunable(0.98, 0.9, 0.999)  # b [-]
    floor: float = 0.1  # least factor on the variance that the model gives [-]
    cap: float = 10.0  # greatest [-]
    limit: float = 9.0  # squared innovation over its variance beyond which a reading teaches nothing [-]
    head_start: float = 50.0  # readings that count as having agreed with the model before the first [-]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.forgetting < 1:
            raise ValueError(f"forgetting must lie in (0, 1), not {self.forgetting}")
        if not 0 < self.floor <= self.cap < math.inf:
            raise ValueError(f"floor and cap must be positive, finite and in order, not {self.floor} and {self.cap}")
        if not (self.limit > 0 and 0 <= self.head_start < math.inf):
            raise ValueError(
                f"limit must be positive and head_start not negative, not {self.limit} and {self.head_start}"
            )

    @property
    def rule(self) -> SageHusa:
        """Cubature points, and what adapts the reading noise."""
        return SageHusa(Cubature(), *map(float, (self.forgetting, self.floor, self.cap, self.limit)))

    def taught(self, model: Any) -> Array:
        """The model's memory at the start with room for what is learnt, (k,)."""
        return np.concatenate((model.memory, untaught(self.rule, model.variances.size, self.head_start)))
