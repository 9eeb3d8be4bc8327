"""What an update takes, measured by turns on the same readings."""

import time
from collections.abc import Mapping, Sequence

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.sensors import stream
from vse_gym.types import Array, Log, Reading


def seconds_per_update(
    estimators: Mapping[str, Estimator], logs: Sequence[Log], nominal: Nominal, quantile: float = 0.5
) -> dict[str, Array]:
    """A quantile over each drive's readings of the time that an update called from Python takes, (S,) each [s].

    Everybody hears a reading before anybody hears the next, in an order that turns: whatever else the machine does
    slows all alike.
    """
    rng, names = stream(0, "estimator"), list(estimators)
    out = {name: np.empty(len(logs)) for name in names}
    for s, log in enumerate((logs[0], *logs), start=-1):  # the first time is a warm-up
        states = {name: e.init(nominal, rng) for name, e in estimators.items()}
        spent = {name: np.empty(len(log.time)) for name in names}
        for k, row in enumerate(zip(log.time.tolist(), log.inputs, log.readings, strict=False)):
            reading = Reading(*row)
            for i in range(len(names)):
                name = names[(i + k) % len(names)]
                estimator, state = estimators[name], states[name]
                begin = time.perf_counter_ns()
                states[name] = estimator.update(state, reading, rng)
                spent[name][k] = 1e-9 * (time.perf_counter_ns() - begin)
        if s >= 0:
            for name in names:
                out[name][s] = np.quantile(spent[name], quantile)
    return out
