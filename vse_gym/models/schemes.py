"""What sideslip estimators share that have two schemes: a dynamic one, which knows tyres, and a kinematic one."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.pretreatment import running_median
from vse_gym.models.bicycle import LinearBicycle, LinearBicycleTuning
from vse_gym.models.nominal import Nominal
from vse_gym.models.pretreatment import MEMORY, Pretreatment, Treatment, treat
from vse_gym.models.tuning import Settings, check_positive, tunable
from vse_gym.types import Y_AY, Y_YAW_RATE, Array


class Schemes(NamedTuple):
    """Constants of both schemes."""

    bicycle: LinearBicycle  # the dynamic scheme's model
    treatment: Treatment  # of the kinematic scheme's readings
    ay_variance: float  # of the accelerometer [m2/s4]
    yaw_rate_variance: float  # of the gyro [rad2/s2]


@dataclass(frozen=True)
class SchemesTuning(Settings):
    """Settings of both schemes.

    Raises:
        ValueError: If the stiffness is not positive.
    """

    model: LinearBicycleTuning = field(default_factory=LinearBicycleTuning)
    treatment: Pretreatment = field(default_factory=Pretreatment)
    stiffness: float = tunable(1.0, 0.3, 1.5)  # of the model's axles, over the data sheet's [-]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(stiffness=self.stiffness)

    def build(self, nominal: Nominal) -> Schemes:
        """Both schemes of a nominal car."""
        bicycle = self.model.build(nominal)
        scale = float(self.stiffness)
        car = bicycle.car._replace(
            stiffness_front=scale * bicycle.car.stiffness_front, stiffness_rear=scale * bicycle.car.stiffness_rear
        )
        return Schemes(
            bicycle=bicycle._replace(car=car),
            treatment=self.treatment.build(nominal),
            ay_variance=float(nominal.sheet.acceleration**2),
            yaw_rate_variance=float(nominal.sheet.yaw_rate**2),
        )


def kinematic_memory(median: int) -> Array:
    """Of :func:`sense`, at the start, for a median of so many values."""
    return np.zeros(MEMORY + 2 + median)


@compiled
def sense(schemes, memory, speed, u, y):
    """Treated ay and yaw rate, the running median of that ay, and whether there is anything to integrate.

    The last good reading stands in for a silent one, but not for longer than the treatment's patience: an integral of
    a reading that does not move runs away. ``memory`` is changed in place.
    """
    ay, yaw_rate = treat(schemes.treatment, memory[:MEMORY], speed, u, y)
    silent = math.isnan(y[Y_AY]) or math.isnan(y[Y_YAW_RATE])
    memory[MEMORY] = memory[MEMORY] + 1.0 if silent else 0.0
    heard = memory[MEMORY] <= schemes.treatment.patience
    return ay, yaw_rate, running_median(ay, memory[MEMORY + 1 :]), heard


@compiled
def kinematic_step(schemes, vy, ay, yaw_rate, speed):
    """dvy/dt = ay - r v, integrated over a step: vy one step on."""
    return vy + schemes.bicycle.car.dt * (ay - yaw_rate * speed)


@compiled
def kinematic_noise(schemes, speed):
    """Variance that a step of the integral adds, of readings as noisy as the data sheet says [m2/s2]."""
    dt = schemes.bicycle.car.dt
    return dt * dt * (schemes.ay_variance + speed * speed * schemes.yaw_rate_variance)
