"""Sine with dwell: the test of stability control in FMVSS 126, UN R140 and GTR 8."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Verdict
from vse_gym.manoeuvres.script import TURN_TO, Script, script_of, sine
from vse_gym.manoeuvres.scripted import Scripted
from vse_gym.manoeuvres.slowly_increasing_steer import steer_at_0_3g
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log


@dataclass(frozen=True)
class SineWithDwell(Scripted):
    """One period of a hand-wheel sine that dwells at its second peak, coasting.

    The standard runs it at 80 km/h on dry road with amplitudes from 1.5 A to the greater of 6.5 A and 270 deg (300 deg
    if 6.5 A is more), A from the slowly increasing steer, in both directions.
    """

    amplitude: float = 270 * DEG  # of the hand wheel; positive: first to the left [rad]
    frequency: float = 0.7  # [Hz]
    dwell: float = 0.5  # [s]
    begin: float = 0.5  # of steer [s]

    positive: ClassVar[tuple[str, ...]] = ("frequency",)
    not_negative: ClassVar[tuple[str, ...]] = ("begin", "dwell")

    @property
    def complete(self) -> float:
        """Completion of steer [s]."""
        return self.begin + 1 / self.frequency + self.dwell

    def hand_wheel(self, times: Array) -> Array:
        """Angle of the hand wheel, (steps,) [rad]."""
        since, hold = times - self.begin, 0.75 / self.frequency
        since = np.where(since > hold, np.maximum(hold, since - self.dwell), since)
        angle, turning = np.zeros(times.shape), (times > self.begin) & (times < self.complete)
        angle[turning] = self.amplitude * sine(2 * math.pi * self.frequency * since[turning])
        return angle

    def script(self, times: Array) -> Script:
        return script_of(times, TURN_TO, self.hand_wheel(times))

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """FMVSS 126 S5.2: yaw rate left over 1.00 s and 1.75 s after completion of steer, displacement at 1.07 s.

        The displacement counts from an amplitude of 5 A on, A taken of the nominal car. A negative yaw-rate ratio
        passes formally, so that its magnitude is reported too. A drive that ended before it could be judged fails.
        """
        side = math.copysign(1.0, self.amplitude)
        against = -side * log.truth[:, p.YAW_RATE]  # positive in the second half
        peak = first_peak(log.time, against, self.begin + 0.5 / self.frequency, self.complete)
        rests = [_at(log.time, against, self.complete + wait) / peak for wait in (1.00, 1.75)]
        shift = side * _at(log.time, log.truth[:, p.Y], self.begin + 1.07)
        steep = abs(self.amplitude) >= 5 * steer_at_0_3g(nominal.vehicle) - 1e-9
        return Verdict(
            (
                Criterion("yaw rate left after 1.00 s", 100 * rests[0], 35, "%"),
                Criterion("yaw rate left after 1.75 s", 100 * rests[1], 20, "%"),
                Criterion("lateral displacement after 1.07 s", shift, 1.83, "m", at_least=True, judged=steep),
                Criterion("magnitude of the yaw rate after 1.75 s", 100 * abs(rests[1]), 20, "%", judged=False),
            )
        )


def _at(time: np.ndarray, values: np.ndarray, when: float) -> float:
    """Value at a time; NaN beyond the end of the drive."""
    return float(np.interp(when, time, values, right=np.nan))


def first_peak(time: np.ndarray, values: np.ndarray, start: float, stop: float) -> float:
    """First local maximum above zero between two times; the largest value there if it only rises."""
    window = values[(time >= start) & (time <= stop)]
    if window.size < 3:
        return float("nan")
    inner = window[1:-1]
    peaks = inner[(inner > 0) & (inner >= window[:-2]) & (inner > window[2:])]
    return float(peaks[0]) if peaks.size else float(window.max())
