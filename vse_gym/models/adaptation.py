"""Which channels' noise a filter finds on line, and how far it may go."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vse_gym.inference.gaussian.innovation_adaptive import InnovationAdaptive
from vse_gym.models.tuning import tunable
from vse_gym.types import CHANNELS


@dataclass(frozen=True)
class Adaptation:
    """Window matching of the innovations' variance, channel by channel, with a floor and a cap.

    Raises:
        ValueError: If the window is empty, the floor above the cap, or there is no such channel.
    """

    window: int = 30  # readings
    floor: float = tunable(0.1, 0.001, 1.0)  # of the factor on a channel's noise variance [-]
    cap: float = tunable(100.0, 1.0, 1000.0)  # [-]
    channels: tuple[str, ...] = ("ax", "ay", "yaw_rate")  # whose noise is adapted

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        if self.window != int(self.window) or self.window < 1:
            raise ValueError(f"window must be a whole number of readings, at least 1, not {self.window}")
        if not 0 < self.floor <= self.cap < math.inf:
            raise ValueError(f"floor and cap must be positive, finite and in order, not {self.floor} and {self.cap}")
        if wrong := set(self.channels) - set(CHANNELS):
            raise ValueError(f"channels names no such channel: {sorted(wrong)}; known: {', '.join(CHANNELS)}")

    def rule(self, inner: Any, limit: float = math.inf, patience: float = 0.0) -> InnovationAdaptive:
        """A Gaussian rule that adapts, behind a gate on each channel."""
        adapted = np.array([name in self.channels for name in CHANNELS])
        floor, cap = np.where(adapted, float(self.floor), 1.0), np.where(adapted, float(self.cap), 1.0)
        return InnovationAdaptive(inner, int(self.window), floor, cap, float(limit), float(patience))
