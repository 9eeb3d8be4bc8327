"""The fusion estimator: a tyre model and an integral at once, each where it is good."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, hold
from vse_gym.estimators.base import Estimator
from vse_gym.inference.frozen import Frozen
from vse_gym.inference.gaussian.innovation_adaptive import InnovationAdaptive, adaptive_memory
from vse_gym.inference.gaussian.recursion import covariance, filter_step, keep
from vse_gym.inference.gaussian.square_root_cubature import SquareRootCubature
from vse_gym.inference.linear import matrices, report_linear
from vse_gym.inference.model import attend, heed
from vse_gym.models import Nominal
from vse_gym.models.adaptation import Adaptation
from vse_gym.models.schemes import Schemes, SchemesTuning, kinematic_memory, kinematic_step, sense
from vse_gym.models.tuning import tunable
from vse_gym.types import CHANNELS, Array, Estimate, Reading

# Where in a belief: vy and yaw rate of the dynamic scheme, their factor, the fused vy, the kinematic scheme's memory,
# the bicycle's with the adaptation's; then what is reported: vx, vy, yaw rate, ax, ay, NIS, degrees of freedom
FACTOR, FUSED, SENSED, REPORTED = 2, 6, 7, 7
SENSED_SIZE = kinematic_memory(1).size


class Fusion(NamedTuple):
    """Both schemes, and how they are put together."""

    schemes: Schemes
    rule: InnovationAdaptive
    share: float  # of the integral in a step [-]


class FusionState(NamedTuple):
    """Constants, and what is believed."""

    constants: Any  # a Fusion, held by compiled code
    belief: Array

    @property
    def cov(self) -> Array:
        """Of vy and yaw rate in the dynamic scheme, (2, 2)."""
        cov: Array = covariance(self.constants.value.rule, self.belief[FACTOR:FUSED].reshape(2, 2))
        return cov


@compiled
def fusion_update(constants, belief, u, y):
    """The belief after one more reading."""
    fusion = constants.value
    schemes = fusion.schemes
    bicycle = schemes.bicycle
    out = belief.copy()
    c, b = belief.size - REPORTED, SENSED + SENSED_SIZE
    u = heed(bicycle, u, y)
    told, own = attend(bicycle, belief[b : b + 5], u, y)
    speed = own[4]
    ay, yaw_rate, _, heard = sense(schemes, out[SENSED:b], speed, u, y)
    F, g, H, d = matrices(bicycle, own, u)
    frozen = Frozen(F, g, H, d, bicycle.process_cov, told)
    mean, factor, memory, nis, dof = filter_step(
        fusion.rule, frozen, belief[:2], belief[FACTOR:FUSED].reshape(2, 2), belief[b:c], u, y
    )
    integral = kinematic_step(schemes, belief[FUSED], ay, yaw_rate, speed)
    out[FUSED] = fusion.share * integral + (1 - fusion.share) * mean[0] if heard else mean[0]
    for i in range(2):
        out[i] = mean[i]
        for j in range(2):
            out[FACTOR + 2 * i + j] = factor[i, j]
    for i in range(memory.size):
        out[b + i] = memory[i]
    expected = d.copy()
    for i in range(d.size):
        expected[i] += H[i, 0] * mean[0] + H[i, 1] * mean[1]
    for i in range(5):
        out[b + i] = own[i]
    reported = report_linear(bicycle, mean, own, expected)
    for i in range(5):
        out[c + i] = reported[i]
    out[c + 1], out[c + 5], out[c + 6] = out[FUSED], nis, dof
    return out


@dataclass(frozen=True)
class FusionEstimator(SchemesTuning, Estimator):
    """An adaptive square-root cubature Kalman filter with integral correction: after Cheng, Li, Chen (2018).

    IEEE Transactions on Industrial Electronics 65(7); the competitor of :class:`SwitchingEstimator`. Only its outline
    is known here, so the rest is this project's reading. The dynamic scheme, a cubature filter on the linear bicycle
    that finds its measurement noise on line, and the kinematic scheme run always, on the same readings as the
    switching estimator's. The integral of ay - r vx is drawn to the dynamic scheme's vy at the rate ``gain``: of what
    changes more slowly the result is the dynamic scheme's, of the rest the integral's. While a sensor that is
    integrated is silent for long, all of it is the dynamic scheme's. Covariance and NIS belong to the dynamic scheme.

    Raises:
        ValueError: If the gain is negative.
    """

    gain: float = tunable(2.0, 0.1, 50.0)  # 0: the kinematic scheme alone; infinite: the dynamic one (chosen) [1/s]
    adaptation: Adaptation = field(default_factory=Adaptation)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.gain >= 0:
            raise ValueError(f"gain must not be negative, not {self.gain}")

    def init(self, nominal: Nominal, rng: np.random.Generator) -> FusionState:
        schemes = self.build(nominal)
        bicycle = schemes.bicycle
        rule = self.adaptation.rule(SquareRootCubature())
        fusion = Fusion(schemes, rule, math.exp(-self.gain * nominal.dt))
        belief = np.concatenate(
            (
                bicycle.prior_mean,
                keep(rule, bicycle.prior_cov).ravel(),
                bicycle.prior_mean[:1],
                kinematic_memory(1),
                bicycle.memory,
                adaptive_memory(len(CHANNELS), rule.window),
                [nominal.speed, *bicycle.prior_mean, np.nan, 0.0, np.nan, 0.0],
            )
        )
        return FusionState(hold(fusion), belief)

    def update(self, state: FusionState, reading: Reading, rng: np.random.Generator) -> FusionState:
        constants, belief = state
        return FusionState(constants, fusion_update(constants, belief, reading.inputs, reading.y))

    def estimate(self, state: FusionState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _, _ = state.belief[-REPORTED:].tolist()
        cov = np.full((3, 3), np.nan)
        cov[1:, 1:] = state.cov
        return Estimate(vx, vy, yaw_rate, ax, ay, cov)

    def innovation(self, state: FusionState) -> tuple[float, float]:
        nis, dof = state.belief[-2:].tolist()
        return nis, dof
