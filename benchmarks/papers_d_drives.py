"""The drives and the sensors of Chen, Wu, Ge, Zhao (2024)."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vse_gym.manoeuvres.base import DEG, Criterion, Manoeuvre, Verdict
from vse_gym.manoeuvres.script import TURN_TO, Script, script_of, sine
from vse_gym.manoeuvres.scripted import Scripted
from vse_gym.manoeuvres.triple_lane_change import TripleLaneChange
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.parameters import GRAVITY
from vse_gym.scenarios import Scenario, scenario
from vse_gym.sensing import NoiseRecord
from vse_gym.sensors import LOUD, Sensors
from vse_gym.types import Y_YAW_RATE, Array, Log

CAR = "chen2024_c_class"
SPIKES = ((2.0, 0.47), (7.0, 0.84))  # when, and how high the gyro's outliers reach (published) [s], [rad/s]
SPIKE = 0.03  # how long each is (chosen) [s]
LONG = 100  # readings from which on a part of the road counts: at a seam the wheels' mean is neither friction


@dataclass(frozen=True)
class Published(Sensors):
    """The paper's inertial sensors, which are this project's loud ones, and the two outliers of its gyro."""

    def record(self, steps: int, dt: float, seed: int) -> NoiseRecord:
        """As of any sensors, with the outliers."""
        noise = super().record(steps, dt, seed)
        added = noise.added.copy()
        for when, height in SPIKES:
            added[round(when / dt) : round((when + SPIKE) / dt), Y_YAW_RATE] = height
        return noise._replace(added=added)


SENSORS = Published(LOUD)
BIASED = replace(SENSORS, acceleration_bias=0.5, yaw_rate_bias=0.1 * DEG)  # as they are before calibration


@dataclass(frozen=True)
class AcceleratingSine(Scripted):
    """Fixed throttle from 12.5 m/s, the hand wheel a sine whose amplitude changes: the paper's drives on a test rig.

    Speed, frictions and when the amplitude changes are published, the rest is chosen. :func:`grip_used` says how near
    to its limit the car comes.
    """

    speed: float = 12.5
    acceleration: float = 0.25  # that the throttle gives on a level road [m/s2]
    amplitude: float = 20 * DEG  # of the hand wheel [rad]
    period: float = 4.0  # [s]
    weak: float = 1.0  # amplitude between 7 and 18 s over the one before [-]
    grown: float = 1.0  # amplitude at the end over the one before, growing from 30 s on [-]

    def script(self, times: Array) -> Script:
        share = np.where((times >= 7.0) & (times < 18.0), self.weak, 1.0)
        late = times > 30.0
        share[late] = 1.0 + (self.grown - 1.0) * (times[late] - 30.0) / (self.duration - 30.0)
        angle = share * self.amplitude * sine(2 * math.pi * times / self.period)
        return script_of(times, TURN_TO, angle, acceleration=self.acceleration)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The paper has none; sideslip is reported."""
        return Verdict((Criterion("largest sideslip", log.peak_sideslip / DEG, 15.0, "deg"),))


@dataclass(frozen=True)
class Drive:
    """A seed draws the noise; the drive is the same."""

    manoeuvre: Manoeuvre
    sensors: Sensors = SENSORS

    def __call__(self, seed: int) -> Scenario:
        return scenario(self.manoeuvre, CAR, self.sensors)


# Chosen first, and far from the limit: the linear tyres of the dynamic scheme are right there
lane_changes = Drive(TripleLaneChange(swing=95.0))
low = Drive(AcceleratingSine(friction=0.35, duration=30.0, weak=0.3))
high = Drive(AcceleratingSine(friction=0.85, duration=40.0, acceleration=0.3, amplitude=30 * DEG, grown=1.25))
# Nearer to it, below it: found by making the lane changes shorter, and the sine greater, step by step
short_lane_changes = Drive(TripleLaneChange(swing=70.0))
low_near = Drive(replace(low.manoeuvre, amplitude=28 * DEG))
high_near = Drive(replace(high.manoeuvre, amplitude=56 * DEG))


def without_outliers(drive: Drive) -> Drive:
    """Of the gyro."""
    return replace(drive, sensors=Sensors(LOUD))


def with_biases(drive: Drive) -> Drive:
    """Of the sensors, as they are before calibration."""
    return replace(drive, sensors=BIASED)


def grip_used(log: Log) -> dict[float, float]:
    """Largest |ay| over what friction gives on each part of the road, in the order of the way, by its friction [-]."""
    share = np.abs(log.truth[:, p.AY]) / (GRAVITY * log.friction)
    frictions, firsts, rows = np.unique(log.friction, return_index=True, return_counts=True)
    long = sorted((first, f) for f, first, n in zip(frictions, firsts, rows, strict=True) if n > LONG)
    return {float(f): float(share[log.friction == f].max()) for _, f in long}
