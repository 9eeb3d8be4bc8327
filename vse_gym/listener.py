"""An estimator at work: hears readings, completes its estimates, and is the one door through which truth may come."""

from collections import deque
from time import perf_counter
from typing import Any

import numpy as np

from vse_gym.estimators.anchors import MOTION, Truth
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Y_AX, Y_AY, Y_YAW_RATE, Array, Estimate, Reading

KNOWN_COV = np.zeros((3, 3))
KNOWN_COV.flags.writeable = False
WHERE = {"vx": p.VX, "vy": p.VY, "yaw_rate": p.YAW_RATE, "ax": p.AX, "ay": p.AY}


def true_estimate(truth: Array) -> Estimate:
    """What one would say who sees the plant's state (STATE_SIZE,)."""
    vx, vy, yaw_rate = truth[p.VX : p.YAW_RATE + 1].tolist()
    ax, ay = truth[p.AX : p.AY + 1].tolist()
    return Estimate(vx, vy, yaw_rate, ax, ay, KNOWN_COV)


class EstimatorError(Exception):
    """An estimator raised, or gave something that is no estimate; what it raised is the cause."""


class Listener:
    """One estimator with its state and its generator, through one drive."""

    def __init__(self, estimator: Estimator, nominal: Nominal, rng: np.random.Generator):
        self.estimator, self.rng = estimator, rng
        try:
            self.state: Any = estimator.init(nominal, rng)
        except Exception as error:
            raise EstimatorError(f"raised {type(error).__name__}: {error}") from error
        self.filled: tuple[str, ...] = ()  # fields that were passed-on readings at least once
        self.seconds = 0.0  # that the last update and estimate took [s]
        self._truth = estimator if isinstance(estimator, Truth) else None
        self._whole = type(self._truth) is Truth and self._truth == Truth()
        delay = 0 if self._truth is None else round(self._truth.delay / nominal.dt)
        self._past: deque[Array] = deque(maxlen=delay + 1)

    def hear(self, reading: Reading, heard: Array, truth: Array, friction: float) -> Estimate:
        """The complete estimate after one more reading.

        Args:
            reading: The new reading; all that an ordinary estimator is given.
            heard: Last valid value of each channel, (10,): fills what the estimator has no opinion of.
            truth: The plant's state, (STATE_SIZE,): for the marker class ``Truth`` alone.
            friction: The road's: for rows alone whose name says that they are told.
        """
        if self._whole:
            return true_estimate(truth)
        begin = perf_counter()
        try:
            estimate = self._ask(reading, friction)
        except Exception as error:
            raise EstimatorError(f"raised {type(error).__name__}: {error}") from error
        self.seconds = perf_counter() - begin
        if self._truth is not None:
            estimate = self._true_fields(self._truth, estimate, truth)
        _, _, yaw_rate, ax, ay = estimate[:5]
        if yaw_rate == yaw_rate and ax == ax and ay == ay:
            return estimate
        fill = {"yaw_rate": heard[Y_YAW_RATE], "ax": heard[Y_AX], "ay": heard[Y_AY]}
        missing: dict[str, Any] = {k: float(v) for k, v in fill.items() if getattr(estimate, k) != getattr(estimate, k)}
        self.filled = tuple(sorted({*self.filled, *missing}))
        return estimate._replace(**missing)

    @property
    def nis(self) -> float:
        """NIS of the last update over its degrees of freedom; NaN where there is none."""
        square, freedom = self.estimator.innovation(self.state)
        return square / freedom if freedom > 0 else float("nan")

    def _ask(self, reading: Reading, friction: float) -> Estimate:
        estimator = self.estimator
        if estimator.told_friction:
            self.state = estimator.tell_friction(self.state, friction)
        self.state = estimator.update(self.state, reading, self.rng)
        estimate = estimator.estimate(self.state)
        if not isinstance(estimate, Estimate) or np.shape(estimate.cov) != (3, 3):
            raise TypeError(f"estimate() must return an Estimate with a cov of (3, 3), not {estimate!r}")
        return estimate

    def _true_fields(self, marker: Truth, estimate: Estimate, truth: Array) -> Estimate:
        self._past.append(truth)
        old = self._past[0]
        values = {name: float(old[WHERE[name]]) for name in marker.fields}
        if "vy" in values:
            values["vy"] = marker.gain * values["vy"] + marker.bias
        known = np.array([name in marker.fields for name in MOTION[:3]])
        cov = np.where(known[:, None] | known, 0.0, estimate.cov)
        return estimate._replace(cov=cov, **values)
