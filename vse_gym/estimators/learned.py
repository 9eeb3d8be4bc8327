"""Learned estimators: a recurrent net that was trained on simulated drives, run in compiled code.

Training is the work of `agents/train_estimator.py`; here nothing is learned any more. Left and right are alike to them
by construction: the net runs on the drive and on its mirror image, and what it says is the mean of both.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, hold
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.estimators.learned_features import (
    FEATURES,
    FILTER_FEATURES,
    MOTION,
    OUTPUTS,
    FilteredReadings,
    Readings,
    fresh_values,
    known,
    take_in,
    units,
)
from vse_gym.estimators.learned_weights import load_weights
from vse_gym.inference.recurrent import mirrored_step
from vse_gym.models import Nominal
from vse_gym.types import Array, Estimate, Reading

DT = 0.01  # between readings, as in training [s]
DOUBT = 5.0  # the largest and, negative, the smallest logarithm of a standard deviation over its unit
TOLD = 8  # numbers that are reported: the motion, and the variances of its first three
_MOTION = len(MOTION)


class LearnedState(NamedTuple):
    """The net with its front end, and what changes."""

    constants: Any  # front end, net, parities of inputs and outputs, held by compiled code
    values: Array  # of the front end, hidden (2, H) and what is reported (8), flat

    @property
    def told(self) -> list[float]:
        """vx, vy, yaw rate, ax, ay, and the variances of the first three."""
        told: list[float] = self.values[-TOLD:].tolist()
        return told


_state: Callable[[tuple[Any, Array]], LearnedState] = partial(tuple.__new__, LearnedState)


@compiled
def learned_update(constants, values, u, y):
    """Front end, net, report: the values of a :class:`LearnedState` after one more reading."""
    front, net, odd_inputs, odd_outputs = constants.value
    size = net.hidden_weights.shape[0]
    own = values.size - TOLD - 2 * size
    carried, x, base = take_in(front, values[:own], u, y)
    hidden = values[own : own + 2 * size].reshape(2, size)
    hidden, said = mirrored_step(net, hidden, x, odd_inputs, odd_outputs)
    scale = units(base[0])
    out = np.empty(values.size)
    for i in range(own):
        out[i] = carried[i]
    for b in range(2):
        for j in range(size):
            out[own + b * size + j] = hidden[b, j]
    at = own + 2 * size
    for i in range(_MOTION):
        out[at + i] = base[i] + scale[i] * said[i]
    for i in range(3):
        doubt = max(-DOUBT, min(DOUBT, said[_MOTION + i]))
        out[at + _MOTION + i] = (scale[i] * np.exp(doubt)) ** 2
    return out


@dataclass(frozen=True)
class LearnedEstimator(Estimator):
    """What learned estimators share; each names its front end, and the features that this has.

    Raises:
        UnknownNameError: If there are no such weights.
        ValueError: If a file of weights is corrupt, or was trained for something else.
    """

    weights: str  # a shipped name, or the path of an .npz file that `agents/train_estimator.py` wrote

    name: ClassVar[str]
    features: ClassVar[Mapping[str, float]]

    def __post_init__(self) -> None:
        super().__post_init__()
        trained = load_weights(self.weights, self.name, self.features, OUTPUTS)
        object.__setattr__(self, "digest", trained.digest)  # two files of one name are two estimators

    @classmethod
    @abstractmethod
    def front(cls, nominal: Nominal) -> tuple[Any, Array]:
        """The front end of a nominal car, and the values that it begins with."""

    def init(self, nominal: Nominal, rng: np.random.Generator) -> LearnedState:
        if abs(nominal.dt - DT) > 1e-9:
            raise ValueError(f"{self.name} was trained on readings every {DT} s, not every {nominal.dt} s")
        net = load_weights(self.weights, self.name, self.features, OUTPUTS).net
        front, values = self.front(nominal)
        parities = np.array(list(self.features.values())), np.array(list(OUTPUTS.values()))
        told = [nominal.speed, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.01]
        hidden = np.zeros(2 * net.hidden_weights.shape[0])
        return LearnedState(hold((front, net, *parities)), np.concatenate((values, hidden, told)))

    def update(self, state: LearnedState, reading: Reading, rng: np.random.Generator) -> LearnedState:
        constants, values = state
        _, u, y = reading
        return _state((constants, learned_update(constants, values, u, y)))

    def estimate(self, state: LearnedState) -> Estimate:
        vx, vy, yaw_rate, ax, ay, *variances = state.told
        return Estimate(vx, vy, yaw_rate, ax, ay, np.diag(variances))


@dataclass(frozen=True)
class RecurrentEstimator(LearnedEstimator):
    """A gated recurrent unit that hears readings alone: Cho et al. (2014). It adds to wheel speeds and gyro.

    Its variances are those of a heteroscedastic Gaussian likelihood: Nix, Weigend (1994).
    """

    weights: str = "gru"

    name: ClassVar[str] = "gru"
    features: ClassVar[Mapping[str, float]] = FEATURES

    @classmethod
    def front(cls, nominal: Nominal) -> tuple[Readings, Array]:
        return Readings(known(nominal)), fresh_values(nominal)


@dataclass(frozen=True)
class CorrectedKalmanFilter(LearnedEstimator):
    """The extended Kalman filter with a learned correction of its estimate, out of readings and innovations.

    The idea is KalmanNet's, Revach et al. (2022), which learns the gain; here the filter stays as it is, with the
    settings of ``ekf``, and the net learns what is left of its error, with variances of its own.
    """

    weights: str = "kalman_gru"

    name: ClassVar[str] = "kalman_gru"
    features: ClassVar[Mapping[str, float]] = FILTER_FEATURES
    inner: ClassVar[ExtendedKalmanFilter] = ExtendedKalmanFilter()  # as in training, so no setting

    @classmethod
    def front(cls, nominal: Nominal) -> tuple[FilteredReadings, Array]:
        filtered = cls.inner.init(nominal, np.random.default_rng(0))
        rule, model = filtered.constants.value
        carried = filtered.belief[: -filtered.output.size]
        return FilteredReadings(known(nominal), rule, model), np.concatenate((fresh_values(nominal), carried))
