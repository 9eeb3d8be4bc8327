"""System E's car with a simulated force sensor on each axle: its readings carry both lateral forces.

What the sensors read comes with the estimator and not with the drive: no car of the benchmark has them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from papers_common import Heard

from vse_gym.estimators.base import Estimator
from vse_gym.estimators.stiffness_adaptive import StiffnessAdaptiveKalmanFilter
from vse_gym.models import Nominal
from vse_gym.physics.axles import axle_slips
from vse_gym.replay import shadow
from vse_gym.scenarios import Scenario
from vse_gym.sensors import stream
from vse_gym.simulation import rollout
from vse_gym.types import Array, Estimate, Reading

SENSOR = "force sensor"  # in the name of whoever has one
FORCE_NOISE = 50.0  # of the simulated force sensor [N]


class SensorState(NamedTuple):
    """The filter's state, and how many readings it has heard."""

    inner: Any
    heard: int


@dataclass(frozen=True)
class WithForceSensor(Estimator):
    """The filter in a car whose axles have force sensors."""

    inner: StiffnessAdaptiveKalmanFilter
    forces: Array  # front and rear at each reading, noise included, (T, 2) [N]

    def init(self, nominal: Nominal, rng: np.random.Generator) -> SensorState:
        return SensorState(self.inner.init(nominal, rng), 0)

    def update(self, state: SensorState, reading: Reading, rng: np.random.Generator) -> SensorState:
        more = reading._replace(y=np.concatenate((reading.y, self.forces[state.heard])))
        return SensorState(self.inner.update(state.inner, more, rng), state.heard + 1)

    def estimate(self, state: SensorState) -> Estimate:
        return self.inner.estimate(state.inner)


def heard(setting: Scenario, rows: Mapping[str, Estimator], seed: int) -> Heard:
    """One seed of a drive, heard by everybody; who has a force sensor is given what it reads.

    Raises:
        RuntimeError: If an estimator stops early.
    """
    log = rollout(setting, "truth", "none", seed)
    noise = FORCE_NOISE * stream(seed, "papers/force sensor").standard_normal((len(log.time), 2))
    _, forces = axle_slips(log.vehicle, log.truth, log.steer, log.friction)
    traces = {}
    for name, estimator in rows.items():
        if isinstance(estimator, StiffnessAdaptiveKalmanFilter) and SENSOR in name:
            estimator = WithForceSensor(estimator, forces + noise)
        traces[name] = shadow(log, estimator, setting.nominal, seed)
        if traces[name].ended:
            raise RuntimeError(f"{name} stopped in {setting.manoeuvre} at seed {seed}: {traces[name].ended}")
    return Heard(log, traces)
