"""The switching estimator: a tyre model while the car turns gently, an integral while it does not."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, hold
from vse_gym.estimators.bicycle import BicycleEstimator
from vse_gym.inference.linear import Kalman, kalman_step, report_linear
from vse_gym.inference.model import attend, heed
from vse_gym.models import Nominal
from vse_gym.models.schemes import (
    Schemes,
    SchemesTuning,
    kinematic_memory,
    kinematic_noise,
    kinematic_step,
    sense,
)
from vse_gym.types import CHANNELS, Array, Reading

# Where in a belief: vy and yaw rate, their covariance, the bicycle's memory with its ten counts of refusals, which
# scheme, and the kinematic scheme's memory; then what is reported: vx, vy, yaw rate, ax, ay, NIS, degrees of freedom
COV, WHEELS, KINEMATIC, SENSED, REPORTED = 2, 6, 21, 22, 7


class Switch(NamedTuple):
    """Both schemes, and when which is used."""

    schemes: Schemes
    rule: Kalman
    on: float  # the kinematic scheme begins above this |ay| [m/s2]
    off: float  # and ends at this one [m/s2]


class SwitchingState(NamedTuple):
    """Constants, and what is believed."""

    constants: Any  # a Switch, held by compiled code
    belief: Array

    @property
    def cov(self) -> Array:
        """Of vy and yaw rate, (2, 2)."""
        return self.belief[COV:WHEELS].reshape(2, 2)

    @property
    def kinematic(self) -> bool:
        """Whether the kinematic scheme gave the last estimate."""
        return bool(self.belief[KINEMATIC] > 0)


@compiled
def switching_update(constants, belief, u, y):
    """The belief after one more reading."""
    switch = constants.value
    schemes = switch.schemes
    bicycle = schemes.bicycle
    out = belief.copy()
    c = belief.size - REPORTED
    u = heed(bicycle, u, y)
    _, own = attend(bicycle, belief[WHEELS : WHEELS + 5], u, y)
    speed = own[4]
    ay, yaw_rate, median, heard = sense(schemes, out[SENSED:c], speed, u, y)
    was = belief[KINEMATIC] > 0.0
    if heard and abs(median) > (switch.off if was else switch.on):
        out[0] = kinematic_step(schemes, belief[0], ay, yaw_rate, speed)
        out[1] = yaw_rate
        out[COV] = belief[COV] + kinematic_noise(schemes, speed)
        out[COV + 1] = out[COV + 2] = 0.0
        out[COV + 3] = schemes.yaw_rate_variance
        for i in range(5):
            out[WHEELS + i] = own[i]
        out[KINEMATIC] = 1.0
        reported = np.array([speed, out[0], yaw_rate, np.nan, ay])
        nis, dof = np.nan, 0.0
    else:
        mean, cov, memory, expected, nis, dof = kalman_step(
            switch.rule, bicycle, belief[:2], belief[COV:WHEELS].reshape(2, 2), belief[WHEELS:KINEMATIC], u, y
        )
        for i in range(2):
            out[i] = mean[i]
            for j in range(2):
                out[COV + 2 * i + j] = cov[i, j]
        for i in range(memory.size):
            out[WHEELS + i] = memory[i]
        out[KINEMATIC] = 0.0
        reported = report_linear(bicycle, mean, memory, expected)
    for i in range(5):
        out[c + i] = reported[i]
    out[c + 5], out[c + 6] = nis, dof
    return out


@dataclass(frozen=True)
class SwitchingEstimator(SchemesTuning, BicycleEstimator):
    """A Kalman filter while the car turns gently, else the integral of ay - r vx. Chen, Wu, Ge, Zhao (2024).

    Automotive Engineering 46(2), doi:10.19562/j.chinasae.qcgc.2024.02.017. While the median-filtered |ay| is small, the
    filter on the linear bicycle hears ay and yaw rate as they are; else dvy/dt = ay - r vx is integrated from ay
    filtered and tested and the tested yaw rate: the paper's only use for it, as its dynamic scheme takes the raw one.
    The belief is handed from one scheme to the other, vy with the variance that it has; the integral takes readings for
    as noisy as the data sheet says, and knows nothing of their biases. While either sensor is silent for long, the
    dynamic scheme is on.

    Raises:
        ValueError: If the median's length is not odd, or the threshold below the hysteresis.
    """

    threshold: float = 1.5  # of |ay|, up to it the dynamic scheme; published, so not searched [m/s2]
    hysteresis: float = 0.0  # half of the distance between switching on and off; the paper has none [m/s2]
    median: int = 5  # values that the switch's median looks at (chosen)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.median % 2 == 0:
            raise ValueError(f"median must be odd, not {self.median}")
        if not 0 <= self.hysteresis <= self.threshold:
            raise ValueError(
                f"hysteresis must lie between 0 and the threshold, not {self.hysteresis} and {self.threshold}"
            )

    def init(self, nominal: Nominal, rng: np.random.Generator) -> SwitchingState:
        schemes = self.build(nominal)
        bicycle = schemes.bicycle
        hysteresis = 0.0 if math.isinf(self.threshold) else self.hysteresis
        switch = Switch(schemes, Kalman(), float(self.threshold + hysteresis), float(self.threshold - hysteresis))
        belief = np.concatenate(
            (
                bicycle.prior_mean,
                bicycle.prior_cov.ravel(),
                bicycle.memory,
                np.zeros(len(CHANNELS) + 1),
                kinematic_memory(self.median),
                [nominal.speed, *bicycle.prior_mean, np.nan, 0.0, np.nan, 0.0],
            )
        )
        return SwitchingState(hold(switch), belief)

    def update(self, state: SwitchingState, reading: Reading, rng: np.random.Generator) -> SwitchingState:
        constants, belief = state
        return SwitchingState(constants, switching_update(constants, belief, reading.inputs, reading.y))
