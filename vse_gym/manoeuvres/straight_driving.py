"""Straight driving: a car that needs no help. What is braked here is braked in vain."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import Criterion, Verdict
from vse_gym.manoeuvres.path import STRAIGHT
from vse_gym.manoeuvres.script import Script, script_of
from vse_gym.manoeuvres.scripted import Bounds, Scripted
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import Array, Log


@dataclass(frozen=True)
class StraightDriving(Scripted):
    """The hand wheel straight, coasting."""

    half_lane: float = 1.75  # the centre of gravity leaves the lane beyond this [m]

    positive: ClassVar[tuple[str, ...]] = ("half_lane",)

    def script(self, times: Array) -> Script:
        return script_of(times)

    def bounds(self, vehicle: p.Vehicle) -> Bounds:
        return Bounds(STRAIGHT, self.half_lane)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """No standard has limits here; these are chosen so that a driver would not notice anything."""
        offset = float(np.max(np.abs(log.truth[:, p.Y])))
        sideslip = math.degrees(log.peak_sideslip)
        return Verdict(
            (
                Criterion("largest lateral offset", offset, 0.3, "m"),
                Criterion("largest sideslip", sideslip, 0.5, "deg"),
                *false_interventions(log),
            )
        )


def false_interventions(log: Log) -> tuple[Criterion, ...]:
    """What was braked in a drive in which the driver does not brake and nobody need: its heat, its time, how often."""
    work = float(log.truth[-1, p.BRAKE_WORK] - log.truth[0, p.BRAKE_WORK]) / 1e3
    asks = np.any((log.added > 0) | (log.release > 0), axis=1)
    time = float(np.sum(np.diff(log.time), where=asks[:-1]))
    times = int(np.sum(asks[1:] & ~asks[:-1])) + int(asks[0])
    return (
        Criterion("needless brake energy", work, 1.0, "kJ"),
        Criterion("time of false interventions", time, 0.0, "s", judged=False),
        Criterion("number of false interventions", float(times), 0.0, "", judged=False),
    )
