"""What an update of the switching and of the fusion estimator costs without Python's part."""

import time

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.fusion import fusion_update
from vse_gym.estimators.switching import switching_update
from vse_gym.models import Nominal
from vse_gym.sensors import stream
from vse_gym.types import Array, Log

REPEATS = 20


@compiled
def switching_drive(constants, belief, inputs, readings):
    """A whole drive in one call."""
    for t in range(readings.shape[0]):
        belief = switching_update(constants, belief, inputs[t], readings[t])
    return belief


@compiled
def fusion_drive(constants, belief, inputs, readings):
    """A whole drive in one call."""
    for t in range(readings.shape[0]):
        belief = fusion_update(constants, belief, inputs[t], readings[t])
    return belief


def seconds_inside(switching: Estimator, fusion: Estimator, log: Log, nominal: Nominal) -> dict[str, Array]:
    """Mean over the readings with the loop inside compiled code, without Python's part, (REPEATS,) each [s]."""
    rng = stream(0, "estimator")
    drives = {"switching": (switching_drive, switching), "fusion": (fusion_drive, fusion)}
    out = {name: np.empty(REPEATS) for name in drives}
    for repeat in range(-1, REPEATS):
        for name, (drive, estimator) in drives.items():
            state = estimator.init(nominal, rng)
            begin = time.process_time_ns()
            drive(state.constants, state.belief, log.inputs, log.readings)
            if repeat >= 0:
                out[name][repeat] = 1e-9 * (time.process_time_ns() - begin) / len(log.time)
    return out
