"""What an update of the switching and of the fusion estimator costs, measured by turns on the same readings."""

import time
from collections.abc import Mapping

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.fusion import fusion_update
from vse_gym.estimators.switching import switching_update
from vse_gym.models import Nominal
from vse_gym.sensors import stream
from vse_gym.types import Array, Log, Reading

REPEATS = 20


def seconds_per_update(estimators: Mapping[str, Estimator], log: Log, nominal: Nominal) -> dict[str, Array]:
    """Median over a drive's readings of the time that an update called from Python takes, (REPEATS,) each [s].

    Everybody hears a reading before anybody hears the next, in an order that turns: whatever else the machine does
    slows all alike.
    """
    rng, names, count = stream(0, "estimator"), list(estimators), len(log.time)
    readings = [Reading(*row) for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True)]
    out = {name: np.empty(REPEATS) for name in names}
    for repeat in range(-1, REPEATS):  # the first is a warm-up
        states = {name: e.init(nominal, rng) for name, e in estimators.items()}
        spent = {name: np.empty(count) for name in names}
        for k, reading in enumerate(readings):
            for i in range(len(names)):
                name = names[(i + k) % len(names)]
                estimator, state = estimators[name], states[name]
                begin = time.perf_counter_ns()
                states[name] = estimator.update(state, reading, rng)
                spent[name][k] = 1e-9 * (time.perf_counter_ns() - begin)
        if repeat >= 0:
            for name in names:
                out[name][repeat] = np.median(spent[name])
    return out


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
