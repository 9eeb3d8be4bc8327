"""The strong tracking filter: an extended Kalman filter that forgets where its innovations are too large."""

from dataclasses import dataclass

import numpy as np

from vse_gym.estimators.gaussian import GaussianFilter, GaussianState
from vse_gym.inference.gaussian import StrongTracking
from vse_gym.models import Nominal
from vse_gym.models.tuning import check_channels, tunable
from vse_gym.types import CHANNELS


@dataclass(frozen=True)
class StrongTrackingKalmanFilter(GaussianFilter):
    """The extended filter with a fading factor for each state. Zhou, Frank (1996).

    To it an outlier is a change of the model: where there are bursts, give it a gate. ``largest`` is an addition to the
    paper, without which the speed runs away when the wheels are silent.

    Raises:
        ValueError: If a number is out of range, a share is missing, or there is no such channel.
    """

    forgetting: float = tunable(0.95, 0.5, 0.99)  # rho: of the innovations' mean square [-]
    weakening: float = tunable(1.5, 1.0, 4.5)  # beta: by how much innovations may exceed what is expected [-]
    shares: tuple[float, ...] = (1.0, 1.0, 1.0)  # a_i: which states change rather than others; alike: one factor [-]
    watched: tuple[str, ...] = CHANNELS  # channels whose innovations tell a change
    largest: float = tunable(1.0, 0.1, 100.0)  # variance up to which a state fades, over its prior's; inf: as printed
    whitened: bool = True  # each channel in units of its own noise; False: a trace over different units, as printed

    def __post_init__(self) -> None:
        if not (0 <= self.forgetting <= 1 and 0 < self.weakening < np.inf):
            raise ValueError(
                f"forgetting must lie in [0, 1] and weakening be positive, not {self.forgetting} and {self.weakening}"
            )
        if not (all(0 <= share < np.inf for share in self.shares) and any(self.shares)):
            raise ValueError(f"shares must not be negative, and one positive, not {self.shares}")
        if not self.largest > 0:
            raise ValueError(f"largest must be positive, not {self.largest}")
        check_channels("watched", self.watched)

    @property
    def rule(self) -> StrongTracking:
        return StrongTracking(
            forgetting=float(self.forgetting),
            weakening=float(self.weakening),
            shares=np.array(self.shares, dtype=float),
            watched=np.array([float(name in self.watched) for name in CHANNELS]),
            whitened=float(self.whitened),
            largest=float(self.largest),
        )

    def init(self, nominal: Nominal, rng: np.random.Generator) -> GaussianState:
        states = self.model.build(nominal).prior_mean.size
        if len(self.shares) != states:
            raise ValueError(f"shares must be one for each of the model's {states} states, not {self.shares}")
        return super().init(nominal, rng)
