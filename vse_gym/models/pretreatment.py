"""Pre-treatment of the inertial readings: filtered, and held beside what the steering asks of the car."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.model import attend
from vse_gym.inference.pretreatment import LowPass, low_pass, low_pass_step, reliable
from vse_gym.models.bicycle import LinearBicycle, LinearBicycleTuning
from vse_gym.models.nominal import Nominal
from vse_gym.models.tuning import Settings, check_channels, check_positive, tunable
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import U_STEER, Y_AY, Y_YAW_RATE, Array

FILTERED = ("ay", "yaw_rate")  # channels that can be
MEMORY = 11  # reference yaw rate; of ay, then of the yaw rate: low-pass (3), reliability (2)


class Treatment(NamedTuple):
    """Constants of the pre-treatment."""

    low_pass: LowPass
    filters_ay: bool
    filters_yaw_rate: bool
    ay_band: float  # [m/s2]
    yaw_rate_band: float  # [rad/s]
    patience: float  # readings
    follow: float  # share of the way to the steady turn that the reference makes in a step [-]
    wheelbase: float  # [m]
    gradient: float  # K in yaw rate = v steer/(l + K v^2) [rad s2/m]
    most: float  # largest lateral acceleration of a reference [m/s2]


@dataclass(frozen=True)
class Pretreatment(Settings):
    """A second-order low-pass, then a test of reliability: Chen, Wu, Ge, Zhao (2024).

    Automotive Engineering 46(2), doi:10.19562/j.chinasae.qcgc.2024.02.017. The reference yaw rate is that of the steady
    turn, d v/(l + K v^2), the reference of ay is v times that. The print calls its filter a Bessel filter; it is
    critically damped. ``damping=BESSEL`` of :mod:`vse_gym.inference.pretreatment` is the true one of that corner.

    Raises:
        ValueError: If a number cannot be, or there is no such channel.
    """

    corner: float = 100.0  # published [rad/s]
    damping: float = 1.0  # as the transfer function is printed [-]
    filtered: tuple[str, ...] = ("ay",)  # channels that are low-passed, of ay and yaw_rate
    # What the paper does not give is chosen. The reference is a steady turn's on dry road: a band must leave room for
    # cars that slide.
    yaw_rate_band: float = tunable(0.3, 0.05, 1.0)  # [rad/s]
    ay_band: float = tunable(5.0, 1.0, 15.0)  # [m/s2]
    patience: float = 0.05  # a channel refused for this long is believed [s]
    lag: float = 0.1  # time constant with which a car goes into its turn; 0: the reference as printed [s]
    limited: bool = True  # whether the reference stays within the friction that is told

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "filtered", tuple(self.filtered))
        check_channels("filtered", self.filtered, FILTERED)
        for name in ("yaw_rate_band", "ay_band"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        check_positive(corner=self.corner, damping=self.damping)
        if not (0 <= self.patience < math.inf and 0 <= self.lag < math.inf):
            raise ValueError(f"patience and lag must be finite and not negative, not {self.patience} and {self.lag}")

    def build(self, nominal: Nominal) -> Treatment:
        """The pre-treatment for a nominal car."""
        car, dt = nominal.vehicle, nominal.dt
        return Treatment(
            low_pass=LowPass(*map(float, low_pass(self.corner, self.damping, dt))),
            filters_ay="ay" in self.filtered,
            filters_yaw_rate="yaw_rate" in self.filtered,
            ay_band=float(self.ay_band),
            yaw_rate_band=float(self.yaw_rate_band),
            patience=float(round(self.patience / dt)),
            follow=1 - math.exp(-dt / self.lag) if self.lag > 0 else 1.0,
            wheelbase=car.wheelbase,
            gradient=max(0.0, car.understeer_gradient),  # else no turn would be steady above the critical speed
            most=nominal.friction * GRAVITY if self.limited else math.inf,
        )


@compiled
def steady_yaw_rate(t, steer, speed):
    """Yaw rate of the steady turn, within what friction allows [rad/s]."""
    turn = steer * speed / (t.wheelbase + t.gradient * speed * speed)
    most = t.most / max(abs(speed), 1e-3)
    return max(-most, min(most, turn))


@compiled
def treat(t, memory, speed, u, y):
    """The lateral acceleration and the yaw rate, filtered and tested; ``memory`` (MEMORY,) is changed in place."""
    memory[0] += t.follow * (steady_yaw_rate(t, u[U_STEER], speed) - memory[0])
    ay, yaw_rate = y[Y_AY], y[Y_YAW_RATE]
    if t.filters_ay:
        ay = low_pass_step(t.low_pass, memory[1:4], ay)
    if t.filters_yaw_rate:
        yaw_rate = low_pass_step(t.low_pass, memory[6:9], yaw_rate)
    return (
        reliable(ay, memory[0] * speed, t.ay_band, t.patience, memory[4:6]),
        reliable(yaw_rate, memory[0], t.yaw_rate_band, t.patience, memory[9:11]),
    )


class Treated(NamedTuple):
    """A pre-treatment, and the wheels that it takes its speed from."""

    treatment: Treatment
    wheels: LinearBicycle


def treated(treatment: Pretreatment, nominal: Nominal) -> tuple[Treated, Array]:
    """The pre-treatment of a reading for a nominal car, and its memory at the start, (5 + MEMORY,)."""
    wheels = LinearBicycleTuning().build(nominal)
    return Treated(treatment.build(nominal), wheels), np.concatenate((wheels.memory, np.zeros(MEMORY)))


@compiled
def treat_reading(constants, memory, u, y):
    """A reading's memory one step on, and y (10,) with ay and yaw rate treated; silent channels stay silent."""
    t = constants.value
    after, clean = memory.copy(), y.copy()
    _, rolling = attend(t.wheels, memory[:5], u, y)
    for i in range(5):
        after[i] = rolling[i]
    ay, yaw_rate = treat(t.treatment, after[5:], rolling[4], u, y)
    if not math.isnan(y[Y_AY]):
        clean[Y_AY] = ay
    if not math.isnan(y[Y_YAW_RATE]):
        clean[Y_YAW_RATE] = yaw_rate
    return after, clean
