"""The drives and the sensors of Chen, Wu, Ge, Zhao (2024)."""

import math
from dataclasses import dataclass, replace

from vse_gym.manoeuvres.base import DEG, Criterion, Manoeuvre, Verdict
from vse_gym.manoeuvres.driver import Pedals, pedals
from vse_gym.manoeuvres.triple_lane_change import TripleLaneChange
from vse_gym.models import Nominal
from vse_gym.sensing import NoiseRecord
from vse_gym.sensors import LOUD, Sensors
from vse_gym.simulation import Scenario, scenario
from vse_gym.types import Y_YAW_RATE, Car, Driver, Log

CAR = "chen2024_c_class"
SPIKES = ((2.0, 0.47), (7.0, 0.84))  # when, and how high the gyro's outliers reach (published) [s], [rad/s]
SPIKE = 0.03  # how long each is (chosen) [s]


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
class AcceleratingSine(Manoeuvre):
    """Fixed throttle from 12.5 m/s, the hand wheel a sine whose amplitude changes: the paper's drives on a test rig.

    Speed, frictions and when the amplitude changes are published, the rest is chosen: so that the car nears its limit
    at the end, where it is at 80 to 90 % of what the road gives.
    """

    speed: float = 12.5
    acceleration: float = 0.25  # that the throttle gives on a level road [m/s2]
    amplitude: float = 20 * DEG  # of the hand wheel [rad]
    period: float = 4.0  # [s]
    weak: float = 1.0  # amplitude between 7 and 18 s over the one before [-]
    grown: float = 1.0  # amplitude at the end over the one before, growing from 30 s on [-]

    def init(self, nominal: Nominal) -> Pedals:
        return pedals(nominal.vehicle, nominal.dt)._replace(pressed=self.acceleration)

    def drive(self, state: Pedals, time: float, car: Car) -> tuple[Driver, Pedals]:
        share = self.weak if 7.0 <= time < 18.0 else 1.0
        if time > 30.0:
            share = 1.0 + (self.grown - 1.0) * (time - 30.0) / (self.duration - 30.0)
        angle = share * self.amplitude * math.sin(2 * math.pi * time / self.period)
        return Driver(angle, state.torque), state

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The paper has none; sideslip is reported."""
        return Verdict((Criterion("largest sideslip", log.peak_sideslip / DEG, 15.0, "deg"),))


LANES = TripleLaneChange()
LOW = AcceleratingSine(friction=0.35, duration=30.0, weak=0.3)
HIGH = AcceleratingSine(friction=0.85, duration=40.0, acceleration=0.3, amplitude=30 * DEG, grown=1.25)


def lane_changes(seed: int) -> Scenario:
    """Three double lane changes on a road that gets slippery."""
    return scenario(LANES, CAR, SENSORS)


def spared(seed: int) -> Scenario:
    """The same without outliers."""
    return scenario(LANES, CAR, Sensors(LOUD))


def biased(seed: int) -> Scenario:
    """The same with the sensors' biases left in."""
    return scenario(LANES, CAR, BIASED)


def low(seed: int) -> Scenario:
    """Accelerating on friction 0.35."""
    return scenario(LOW, CAR, SENSORS)


def high(seed: int) -> Scenario:
    """Accelerating on friction 0.85."""
    return scenario(HIGH, CAR, SENSORS)
