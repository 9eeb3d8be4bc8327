"""The slalom of system C, its figures, and who hears it."""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
from papers_statistics import motion_error, sideslip_error

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.models import DataSheet, Nominal
from vse_gym.models.three_dof import ThreeDofTuning
from vse_gym.physics import parameters as p
from vse_gym.physics.axles import axle_slips
from vse_gym.physics.parameters import LinearTyre, Vehicle
from vse_gym.replay import Trace
from vse_gym.scenarios import Scenario, scenario
from vse_gym.sensors import QUIET, Sensors
from vse_gym.types import FOUND, Array, Estimate, Log, Reading
from vse_gym.vehicles import load

CAR = load("wang2017_d_class")
TRUE_MASS, START = 1500.0, 1000.0  # of the car, and of the least squares [kg]
MASS_OFF = 23.0  # printed [kg]
AMPLITUDE = np.radians(5.5)  # of the front wheels
FOUND_BY = 9.0  # when the mass is to be found [s]
GROWTH = 10.0  # of the noise's sigma
STEP_VARIANCES = (0.1, 1e-3, 1e-5, 1e-7)  # Q of a step, the first as published
LEAST_AY = 0.5  # of the least squares, published [m/s2]
# The sheet's accelerometers are as good as the published R = 0.001; sideslip, exact, is for the row that is told it
SHEET = DataSheet(sqrt(0.001), QUIET.yaw_rate, QUIET.wheel_speed, QUIET.steer, QUIET.brake, sideslip=1e-9)
# Largest errors printed: of the RLS-FAEKF and of the EKF
PUBLISHED = {"vx": (0.08, 0.36, "m/s"), "sideslip": (0.03, 0.83, "deg"), "yaw rate": (1.4, 27.3, "deg/s")}
BEGIN = {"mass_start": START / CAR.mass}


def drive(seed: int, growth: float = GROWTH, linear: bool = False) -> Scenario:
    """The slalom as published, on the plant's tyres; or on tyres as the filter's model has them."""
    car = CAR._replace(mass=TRUE_MASS)
    if linear:
        front, rear = (LinearTyre(t.slip_stiffness, t.cornering_stiffness) for t in (car.front_tyre, car.rear_tyre))
        car = car._replace(front_tyre=front, rear_tyre=rear)
    sensors = Sensors(SHEET, growth=growth, growing=(2.0, 8.0))
    settings = {"speed": 60 / 3.6, "friction": 0.85, "period": 2.0, "begin": 2.0, "stop": 8.0, "duration": 10.0}
    made = scenario("sine_steer", car, sensors, amplitude=AMPLITUDE * car.steering_ratio, **settings)
    return replace(made, nominal=Nominal(car._replace(mass=CAR.mass), SHEET, made.manoeuvre.speed))


def errors(log: Log, trace: Trace) -> dict[str, Array]:
    """Of vx [m/s], sideslip [deg] and yaw rate [deg/s], (T,) each."""
    motion = motion_error(log, trace, 0), sideslip_error(log, trace), motion_error(log, trace, 2)
    return dict(zip(PUBLISHED, motion, strict=True))


def mass_error(log: Log, trace: Trace) -> float:
    """Largest from 9 s on [kg]."""
    return float(np.max(np.abs(trace.found[log.time >= FOUND_BY, FOUND.index("mass")] - TRUE_MASS)))


def last_mass(log: Log, trace: Trace) -> float:
    """At the end [kg]."""
    return float(trace.found[-1, FOUND.index("mass")])


def largest(name: str) -> Any:
    """The largest error of one of vx, sideslip and yaw rate, as a figure of a drive."""
    return lambda log, trace: float(np.max(np.abs(errors(log, trace)[name])))


def secant(log: Log) -> Array:
    """What the plant's axles give of their cornering stiffness at a drive's slips, front and rear, (2,) [-].

    By least squares over the drive, at those instants at which the mass is learnt.
    """
    assert log.vehicle is not None
    angles, forces = axle_slips(log.vehicle, log.truth, log.steer, log.friction)
    learning = np.abs(log.truth[:, p.AY]) >= LEAST_AY
    slope = np.sum((forces * angles)[learning], axis=0) / np.sum(angles[learning] ** 2, axis=0)
    tyres = log.vehicle.front_tyre, log.vehicle.rear_tyre
    return np.asarray(slope / [2 * t.cornering_stiffness for t in tyres])


@dataclass(frozen=True)
class WithStiffness(Estimator):
    """An estimator that is told so much of the data sheet's cornering stiffnesses, front and rear."""

    inner: Estimator
    share: tuple[float, float]

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Any:
        tyres = nominal.vehicle.front_tyre, nominal.vehicle.rear_tyre
        front, rear = (
            t._replace(cornering_stiffness=s * t.cornering_stiffness) for t, s in zip(tyres, self.share, strict=True)
        )
        car: Vehicle = nominal.vehicle._replace(front_tyre=front, rear_tyre=rear)
        return self.inner.init(replace(nominal, vehicle=car), rng)

    def update(self, state: Any, reading: Reading, rng: np.random.Generator) -> Any:
        return self.inner.update(state, reading, rng)

    def estimate(self, state: Any) -> Estimate:
        return self.inner.estimate(state)


def told(step_variance: float = STEP_VARIANCES[0], **settings: Any) -> Any:
    """The filter whose least squares are told the true sideslip, with a Q of so much on the diagonal."""
    names = ("yaw_variance", "sideslip_variance", "vx_variance")
    model = ThreeDofTuning(mass_hears=("sideslip",), **dict.fromkeys(names, step_variance))
    return ESTIMATORS.make("rls_faekf", model=model, **BEGIN, **settings)
