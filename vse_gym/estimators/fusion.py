"""The fusion estimator: a tyre model and an integral at once, each where it is good."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, hold
from vse_gym.estimators.bicycle import BicycleEstimator
from vse_gym.inference.frozen import Frozen
from vse_gym.inference.gaussian.innovation_adaptive import InnovationAdaptive, adaptive_memory
from vse_gym.inference.gaussian.recursion import covariance, filter_step, keep
from vse_gym.inference.gaussian.square_root_cubature import SquareRootCubature
from vse_gym.inference.linear import matrices, report_linear
from vse_gym.inference.model import attend, heed
from vse_gym.models import Nominal
from vse_gym.models.adaptation import Adaptation
from vse_gym.models.schemes import Schemes, SchemesTuning, kinematic_memory, kinematic_noise, kinematic_step, sense
from vse_gym.models.tuning import tunable
from vse_gym.types import CHANNELS, Array, Reading

# Where in a belief: vy and yaw rate of the dynamic scheme, their factor, the fused vy and its standard deviation, the
# kinematic scheme's memory, the bicycle's with the adaptation's; then what is reported: vx, vy, yaw rate, ax, ay, NIS,
# degrees of freedom
FACTOR, FUSED, STD, SENSED, REPORTED = 2, 6, 7, 8, 7
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
        """Of the fused vy and the yaw rate, (2, 2); beside the diagonal, what the dynamic scheme brings to it."""
        fusion = self.constants.value
        cov: Array = covariance(fusion.rule, self.belief[FACTOR:FUSED].reshape(2, 2)).copy()
        cov[0, 0] = self.belief[STD] ** 2
        cov[0, 1] = cov[1, 0] = (1 - fusion.share) * cov[1, 0]
        return cov


@compiled
def fused_std(share, before, noise, dynamic):
    """Standard deviation of share (vy + dt (ay - r vx)) + (1 - share) vy of the dynamic scheme, at most.

    The schemes' errors hang together, for both hear the same readings, and nobody says how. Whatever the correlation,
    the deviation of a sum is no larger than the sum of the deviations.

    Args:
        share: Of the integral.
        before: Standard deviation of the fused vy before the step.
        noise: Variance that a step adds to the integral: of readings that are independent of those before.
        dynamic: Variance of the dynamic scheme's vy.
    """
    return share * math.sqrt(before * before + noise) + (1 - share) * math.sqrt(dynamic)


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
    share = fusion.share if heard else 0.0
    out[FUSED] = share * integral + (1 - share) * mean[0]
    dynamic = covariance(fusion.rule, factor)[0, 0]
    out[STD] = fused_std(share, belief[STD], kinematic_noise(schemes, speed), dynamic)
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
class FusionEstimator(SchemesTuning, BicycleEstimator):
    """An adaptive square-root cubature Kalman filter with integral correction: after Cheng, Li, Chen (2018).

    IEEE Transactions on Industrial Electronics 65(7); the competitor of :class:`SwitchingEstimator`. Only its outline
    is known here, so the rest is this project's reading. The dynamic scheme, a cubature filter on the linear bicycle
    that finds its measurement noise on line, and the kinematic scheme run always, on the same readings as the
    switching estimator's. The integral of ay - r vx is drawn to the dynamic scheme's vy at the rate ``gain``: of what
    changes more slowly the result is the dynamic scheme's, of the rest the integral's. While a sensor that is
    integrated is silent for long, all of it is the dynamic scheme's. The variance of vy is an upper bound, if both
    schemes' own are right; the integral's knows nothing of biases. The NIS is the dynamic scheme's.
    """

    gain: float = tunable(2.0, 0.1, 50.0)  # 0: the kinematic scheme alone; infinite: the dynamic one (chosen) [1/s]
    adaptation: Adaptation = field(default_factory=Adaptation)

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
                np.sqrt(bicycle.prior_cov[:1, 0]),
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
