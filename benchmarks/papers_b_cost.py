"""Where the time of an update of the particle filters goes."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.estimators.particle import cauchy_shares
from vse_gym.inference.gaussian.recursion import believe
from vse_gym.inference.gaussian.sage_husa import learn_from
from vse_gym.inference.linalg import cholesky
from vse_gym.inference.model import advance, heed, observe, recall
from vse_gym.inference.particle import log_likelihood, systematic
from vse_gym.inference.particle_proposal import (
    correct_all,
    draw_all,
    log_transition,
    predict_all,
    reweigh,
    spread_all,
    weighted_moments,
)
from vse_gym.models import Nominal
from vse_gym.noise import contamination
from vse_gym.sensors import stream
from vse_gym.types import Array, Log, Reading

ROWS = 300  # of a drive's readings, for a time [10 ms]
REPEATS = 200  # of a stage


def stages(filter_: Any, log: Log, told: Nominal) -> dict[str, float]:
    """The least time of each stage of one update in mid-drive [us]; stages overlap in nothing."""
    rng = stream(0, "estimator")
    state = filter_.init(told, rng)
    for k in range(ROWS):
        state = filter_.update(state, Reading(float(log.time[k]), log.inputs[k], log.readings[k]), rng)
    rule, model = state.constants.value
    heard, y = heed(model, log.inputs[ROWS], log.readings[ROWS]), log.readings[ROWS]
    u = recall(model, state.memory, heard)
    states, roots = state.states, state.factors
    points, columns, *_ = spread_all(rule, states, roots)
    means, after, centres = predict_all(rule, model, states, roots, u)
    variances, memory = believe(rule, model, means[:, 0].copy(), after[0], state.memory, u, y)
    at = spread_all(rule, means, after)[0]
    read, used = observe(model, states, u), int(np.isfinite(variances + y).sum())
    expected, spread = weighted_moments(read, state.weights)
    share = cauchy_shares(contamination(filter_.alpha), filter_.heavy)
    share_of_noise = np.linalg.cholesky(model.process_cov)
    logs = log_transition(states, centres, share_of_noise)
    spare_means, spare_roots, one, squares = means.copy(), after.copy(), states[:, :1].copy(), np.eye(used)
    times = {
        "points, model: prediction": _least(lambda: advance(model, points, u)),
        "middles, model": _least(lambda: advance(model, states, u)) if columns % 2 == 0 else 0.0,
        "points, model: readings": _least(lambda: observe(model, at, u)),
        "drawn particles, model: readings": _least(lambda: observe(model, states, u)),
        "spreading points": _least(lambda: spread_all(rule, states, roots))
        + _least(lambda: spread_all(rule, means, after)),
        "factorisations": _least(lambda: _factorise(model.process_cov, squares, states.shape[1])),
    }
    whole = _least(lambda: predict_all(rule, model, states, roots, u))
    whole += _least(lambda: correct_all(rule, model, spare_means, spare_roots, u, y, variances))
    times["means, covariances, gains"] = max(
        0.0, whole - sum(times.values()) + times["drawn particles, model: readings"]
    )
    times["sampling"] = _least(lambda: draw_all(means, after, 1.0, rng))
    times["weights"] = (
        _least(lambda: log_likelihood(read, y, variances, share))
        + _least(lambda: log_transition(states, centres, share_of_noise))
        + _least(lambda: reweigh(state.weights, logs))
    )
    times["moments of the sample"] = _least(lambda: weighted_moments(states, state.weights)) + _least(
        lambda: weighted_moments(read, state.weights)
    )
    times["reading noise"] = _least(lambda: believe(rule, model, one[:, 0], after[0], state.memory, u, y)) + _least(
        lambda: learn_from(rule, memory, y, expected, np.diag(spread).copy(), variances)
    )
    times["resampling"] = _least(lambda: _resample(states, after, state.weights))
    return times


@compiled
def _factorise(cov: Array, spread: Array, size: int) -> Array:
    """A prediction's, a correction's and the innovation's, of every particle."""
    one, two = np.empty_like(cov), np.empty_like(spread)
    for _ in range(size):
        cholesky(cov, one)
        cholesky(spread, two)
        cholesky(cov, one)
    return one


def _resample(states: Array, roots: Array, weights: Array) -> tuple[Array, Array]:
    picked = systematic(weights, 0.5)
    return states[:, picked], roots[picked]


def _least(work: Callable[[], object]) -> float:
    """Processor time of one call, the least of many [us]."""
    work()
    least = np.inf
    for _ in range(REPEATS):
        begin = time.thread_time()
        work()
        least = min(least, time.thread_time() - begin)
    return 1e6 * float(least)
