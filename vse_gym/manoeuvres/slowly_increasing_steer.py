"""Slowly increasing steer: how much hand wheel a car needs for 0.3 g, which scales the sine with dwell."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from vse_gym.manoeuvres.base import DEG, KMH, Criterion, Verdict, across, lateral_acceleration
from vse_gym.manoeuvres.script import HOLD, TURN_ON, Script, script_of
from vse_gym.manoeuvres.scripted import Scripted
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.types import Array, Car, Log


def _angle_at_0_3g(hand_wheel: Array, ay: Array) -> float:
    """Hand-wheel angle at 0.3 g by a straight line through 0.1 to 0.375 g; NaN if the drive never got there [rad]."""
    side = np.copysign(1.0, hand_wheel[-1])
    g = side * ay / p.GRAVITY  # signed: a car with a steering offset begins on the other side
    beyond = np.nonzero(g > 0.375)[0]
    if beyond.size == 0:
        return float("nan")
    begin = int(np.nonzero(g[: beyond[0]] < 0.1)[0][-1]) + 1
    slope, offset = np.polyfit(side * hand_wheel[begin : beyond[0]], g[begin : beyond[0]], 1)
    return float((0.3 - offset) / slope)


@dataclass(frozen=True)
class SlowlyIncreasingSteer(Scripted):
    """The hand wheel turns at 13.5 deg/s at a constant 80 km/h until the car corners at about 0.5 g."""

    duration: float = 8.0
    rate: float = 13.5 * DEG  # of the hand wheel; positive: to the left [rad/s]
    begin: float = 0.5  # of steer [s]
    stop: float = 0.5 * p.GRAVITY  # the hand wheel is held from here on [m/s2]

    positive: ClassVar[tuple[str, ...]] = ("stop",)

    def script(self, times: Array) -> Script:
        hands = np.where(times >= self.begin, TURN_ON, HOLD)
        return script_of(times, hands, self.rate, self.speed, stops=self.stop)

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """Reports A; passes if the car reached 0.375 g, so that the line has its data."""
        ay = lateral_acceleration(log)
        angle = _angle_at_0_3g(log.hand_wheel, ay)
        reached = float(np.max(np.abs(ay))) / p.GRAVITY
        return Verdict(
            (
                Criterion("largest lateral acceleration", reached, 0.375, "g", at_least=True),
                Criterion("hand-wheel angle at 0.3 g, A", angle / DEG, 90, "deg", judged=False),
            )
        )


def steer_at_0_3g(vehicle: p.Vehicle, friction: float = 0.9) -> float:
    """A of a car: its hand-wheel angle at 0.3 g in the slowly increasing steer, open loop, on steady tyres [rad].

    NaN if the car never reaches 0.375 g, as on a road of that friction or less.
    """
    laws = type(vehicle.front_tyre).__name__, type(vehicle.rear_tyre).__name__
    return _steer_at_0_3g(vehicle, laws, friction)


@lru_cache(maxsize=64)
def _steer_at_0_3g(vehicle: p.Vehicle, laws: tuple[str, str], friction: float) -> float:
    # The tyres' laws are part of the key: two of them with equal numbers are equal tuples.
    test = SlowlyIncreasingSteer(speed=80 * KMH, friction=friction)
    dt, substep = 0.01, 1e-3
    road, state, memory = test.road(), rolling_start(vehicle, test.speed), test.at_wheel(vehicle, dt)
    angles, states = [0.0], [state]
    for k in range(round(test.duration / dt)):
        driver, memory = test.drive(memory, k * dt, Car(state))
        inputs = p.Inputs(driver.hand_wheel / vehicle.steering_ratio, driver.drive, np.zeros(4))
        state = advance(vehicle, road, state, inputs, round(dt / substep), substep)
        angles.append(driver.hand_wheel)
        states.append(state)
    return _angle_at_0_3g(np.array(angles), across(vehicle, np.array(states)))
