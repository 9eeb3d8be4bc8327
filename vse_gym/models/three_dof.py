"""The bicycle with linear tyres of three degrees of freedom, driven by the accelerometer along the car."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.identification import instruct, regress
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models.channels import BRAKING, attend_wheels, read_extras, read_motion
from vse_gym.models.nominal import Nominal
from vse_gym.models.single_track import SingleTrack, SingleTrackTuning, commanded, slowest_linear
from vse_gym.models.tuning import Settings, check_channels, check_not_negative, check_positive, tunable
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import (
    CHANNELS,
    U_BRAKE,
    U_DRIVE,
    U_STEER,
    Y_AX,
    Y_AY,
    Y_SIDESLIP,
    Y_SPEED,
    Y_WHEEL,
    Y_YAW_RATE,
    Array,
)

U_AX, U_MASS = 9, 10  # what ``heed`` puts behind the inputs of a reading: specific force along the car, and the mass
R, BETA, VX = 0, 1, 2  # the state
HEARD = {
    "ay": (Y_AY,),
    "yaw_rate": (Y_YAW_RATE,),
    "wheel_speeds": tuple(range(Y_WHEEL, Y_WHEEL + 4)),
    "speed": (Y_SPEED,),
    "sideslip": (Y_SIDESLIP,),
}
POSITIVE = ("ay_variance", "force_error")
NOT_NEGATIVE = (
    *("yaw_variance", "sideslip_variance", "vx_variance", "slip", "brake_slip", "brake_hold", "brake_margin"),
    *("yaw_prior", "sideslip_prior", "vx_prior", "slowest_learning"),
)
MEASURED = ("yaw_rate", "sideslip")  # what the mass may take from a sensor instead of from the filter


class ThreeDof(NamedTuple):
    """State: yaw rate [rad/s], sideslip angle [rad], vx [m/s]. Inputs: steer, the measured ax, and the brakes' moment.

    Wang, Wei, Zhao, Zhang, Yan (2017), doi:10.3969/j.issn.1004-132X.2017.06.019, with the yaw moment of unequal
    longitudinal forces added, which its car had no use for.
    """

    car: SingleTrack  # the same car with tyres that saturate: its constants, forces from torques, trust in wheels
    slowest: float  # speed to which slip angles are taken at least: below, Euler's step would be unstable [m/s]
    measured_yaw_rate: float  # 1: the mass takes the gyro's yaw rate, 0: the filter's
    measured_sideslip: float  # the same of the sideslip angle, from an optical sensor
    force_variance: float  # of the lateral balance's error, for the mass [N2]
    slowest_learning: float  # speed below which the mass stays as it is [m/s]
    prior_mean: Array  # (3,)
    prior_cov: Array  # (3, 3)
    process_cov: Array  # (3, 3), of one step
    variances: Array  # of the channels, without wheel slip; NaN: not used; (10,)
    memory: Array  # time since each wheel braked (4) [s], and the reference speed [m/s]; (5,)


@dataclass(frozen=True)
class ThreeDofTuning(Settings):
    """How far a filter trusts the three degrees of freedom, and what it hears.

    As published it hears ay alone, which leaves its speed to the integrated accelerometer.

    Raises:
        ValueError: If it shall hear, or learn from, what there is not, or a number cannot be; the message names it.
    """

    hears: tuple[str, ...] = ("ay",)  # published; also "yaw_rate", "wheel_speeds", "speed", "sideslip"
    yaw_variance: float = tunable(0.1, 1e-8, 1.0)  # published: of a step's process noise, with dt not given [rad2/s2]
    sideslip_variance: float = tunable(0.1, 1e-9, 1.0)  # published [rad2]
    vx_variance: float = tunable(0.1, 1e-6, 1.0)  # published [m2/s2]
    ay_variance: float = tunable(0.001, 1e-4, 100.0)  # published, at the start [m2/s4]
    slip: float = 0.005  # slip of a rolling wheel [-]
    brake_slip: float = 0.05  # slip of the fastest wheel while all brake [-]
    brake_hold: float = 0.1  # time for which a wheel is not believed after it braked [s]
    brake_margin: float = 0.3  # by so much may the accelerometer miss what brake torques promise [m/s2]
    yaw_prior: float = 0.02  # standard deviation at the start [rad/s]
    sideslip_prior: float = 0.01  # [rad]
    vx_prior: float = 1.0  # [m/s]
    brake_moment: bool = True  # whether the model knows that braking one side turns the car
    mass_hears: tuple[str, ...] = ()  # what the mass takes from sensors, not from the filter: "yaw_rate", "sideslip"
    force_error: float = tunable(1000.0, 50.0, 5000.0)  # of the lateral balance that the mass is found from [N]
    slowest_learning: float = 8.0  # speed below which the mass stays as it is [m/s]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, known in (("hears", HEARD), ("mass_hears", MEASURED)):
            check_channels(name, getattr(self, name), known)
        check_positive(**{name: getattr(self, name) for name in POSITIVE})
        check_not_negative(**{name: getattr(self, name) for name in NOT_NEGATIVE})

    def build(self, nominal: Nominal) -> ThreeDof:
        """The model of a nominal car with this trust."""
        car = SingleTrackTuning(
            slip=self.slip,
            brake_slip=self.brake_slip,
            brake_hold=self.brake_hold,
            brake_margin=self.brake_margin,
            brake_moment=self.brake_moment,
        ).build(nominal)
        heard = [channel for name in self.hears for channel in HEARD[name]]
        channels = np.full(len(CHANNELS), np.nan)
        channels[heard] = car.variances[heard]
        if Y_AY in heard:
            channels[Y_AY] = self.ay_variance
        return ThreeDof(
            car=car._replace(variances=channels),
            slowest=slowest_linear(car),
            measured_yaw_rate=float("yaw_rate" in self.mass_hears),
            measured_sideslip=float("sideslip" in self.mass_hears),
            force_variance=float(self.force_error**2),
            slowest_learning=float(self.slowest_learning),
            prior_mean=np.array([0.0, 0.0, nominal.speed]),
            prior_cov=np.diag([self.yaw_prior**2, self.sideslip_prior**2, self.vx_prior**2]),
            process_cov=np.diag([float(v) for v in (self.yaw_variance, self.sideslip_variance, self.vx_variance)]),
            variances=channels,
            memory=car.memory,
        )


# For a car that also has a gyro and wheel speeds. Q is small enough for the mass to be found without the true sideslip:
# with the published Q the filter takes the sideslip from ay by the very mass in question, and so confirms it.
CAR_SENSORS = ThreeDofTuning(
    hears=("ay", "yaw_rate", "wheel_speeds"),
    yaw_variance=1e-3,
    sideslip_variance=1e-8,
    vx_variance=1e-3,
    ay_variance=25.0,
    force_error=300.0,
)


@compiled
def _axle_forces(model, state, steer):
    """Lateral forces of linear axles, front and rear [N]."""
    car = model.car
    r, beta, speed = state[R], state[BETA], max(state[VX], model.slowest)
    front = car.stiffness_front * (steer - beta - car.lf * r / speed)
    return front, car.stiffness_rear * (car.lr * r / speed - beta)


@advance.register(ThreeDof)
@compiled
def _(model, states, u):
    # Euler's method, as published
    car, moment = model.car, commanded(model.car, u).moment
    out = np.empty_like(states)
    for j in range(states.shape[1]):
        r, beta, vx = states[R, j], states[BETA, j], states[VX, j]
        front, rear = _axle_forces(model, states[:, j], u[U_STEER])
        out[R, j] = r + car.dt * (car.lf * front - car.lr * rear + moment) / car.yaw_inertia
        out[BETA, j] = beta + car.dt * ((front + rear) / (u[U_MASS] * max(vx, model.slowest)) - r)
        out[VX, j] = max(0.0, vx + car.dt * (r * beta * vx + u[U_AX]))
    return out


@observe.register(ThreeDof)
@compiled
def _(model, states, u):
    cos_steer, sin_steer = math.cos(u[U_STEER]), math.sin(u[U_STEER])
    out, motion = np.empty((10, states.shape[1])), np.empty((2, states.shape[1]))
    for j in range(states.shape[1]):
        front, rear = _axle_forces(model, states[:, j], u[U_STEER])
        motion[0, j], motion[1, j] = states[VX, j], states[BETA, j] * states[VX, j]
        out[Y_AX, j], out[Y_AY, j] = u[U_AX], (front + rear) / u[U_MASS]
        read_motion(model.car, cos_steer, sin_steer, motion[0, j], motion[1, j], states[R, j], out, j)
    read_extras(model.variances, motion, out)
    return out


@heed.register(ThreeDof)
@compiled
def _(model, u, y):
    car, told = model.car, heed(model.car, u, y)
    out = np.empty(U_MASS + 1)
    force = 0.0
    for i in range(4):
        force += (told[U_DRIVE + i] - told[U_BRAKE + i]) / car.wheel_radius
    for i in range(U_AX):
        out[i] = told[i]
    limit = car.friction * GRAVITY
    out[U_AX] = max(-limit, min(limit, force / car.mass)) if math.isnan(y[Y_AX]) else y[Y_AX]
    out[U_MASS] = car.mass
    return out


@attend.register(ThreeDof)
@compiled
def _(model, memory, u, y):
    return attend_wheels(model.car, memory, u, y)


@report.register(ThreeDof)
@compiled
def _(model, state, u):
    front, rear = _axle_forces(model, state, u[U_STEER])
    return np.array([state[VX], state[BETA] * state[VX], state[R], np.nan, (front + rear) / u[U_MASS]])


@regress.register(ThreeDof)
@compiled
def _(model, mean, memory, u, y):
    # The lateral balance m ay = front + rear. Not while a wheel brakes: its lateral force is not the linear tyre's.
    state = mean.copy()
    if model.measured_yaw_rate > 0.0 and not math.isnan(y[Y_YAW_RATE]):
        state[R] = y[Y_YAW_RATE]
    if model.measured_sideslip > 0.0 and not math.isnan(y[Y_SIDESLIP]):
        state[BETA] = y[Y_SIDESLIP]
    front, rear = _axle_forces(model, state, u[U_STEER])
    rows, targets, variances = np.empty((1, 1)), np.empty(1), np.empty(1)
    rows[0, 0], targets[0], variances[0] = y[Y_AY], front + rear, model.force_variance
    for i in range(4):
        if u[U_BRAKE + i] > BRAKING:
            targets[0] = np.nan
    if mean[VX] < model.slowest_learning:
        targets[0] = np.nan
    return rows, targets, variances, y, memory


@instruct.register(ThreeDof)
@compiled
def _(model, u, parameters):
    u[U_MASS] = parameters[0]
