"""The bicycle that hears its axles' lateral forces and is told their cornering stiffnesses."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.identification import instruct, regress
from vse_gym.inference.model import advance, attend, heed, observe, report
from vse_gym.models.channels import attend_wheels, read_motion
from vse_gym.models.nominal import Nominal
from vse_gym.models.single_track import SingleTrack, SingleTrackTuning, commanded, slowest_linear
from vse_gym.models.tuning import Settings, check_not_negative, check_positive, tunable
from vse_gym.types import U_STEER, Y_AX, Y_AY, Y_SIDESLIP, Y_SPEED, Y_YAW_RATE, Array

U_FRONT, U_REAR = 9, 10  # what ``heed`` puts behind the inputs of a reading: the axles' cornering stiffnesses [N/rad]
Y_FRONT, Y_REAR = 10, 11  # channels behind those of a reading: lateral force of the front and the rear axle [N]
# Memory behind the single track's: readings heard in a row; then ay, yaw rate, both slip angles and the moment of the
# torques after one low-pass and after two.
SMOOTHED = 5
ROW, ONCE, TWICE = 5, 6, 6 + SMOOTHED
POSITIVE = ("lag", "force_error", "vx_prior", "vy_prior", "yaw_prior", "most_slip")
NOT_NEGATIVE = (
    *("vx_noise", "vy_noise", "yaw_noise", "yaw_rate_error", "wheel_error", "slip", "brake_slip", "brake_hold"),
    *("brake_margin", "least_slip", "least_steer", "least_speed"),
)
SETTLED = 5.0  # time constants after which a low-pass of two stages has forgotten where it began


class ForceBicycle(NamedTuple):
    """State: vx, vy [m/s], yaw rate [rad/s]. It hears the yaw rate, both axles' lateral forces and rolling wheels.

    An axle's force is its cornering stiffness times its slip angle, up to the friction: the stiffness is the secant's,
    which least squares find while the car turns. Tian, Zhang, Wang, Chen (2018), J. Jilin University (Engineering).
    """

    car: SingleTrack  # the same car with tyres that saturate: its constants, forces from torques, trust in wheels
    slowest: float  # speed to which slip angles are taken at least [m/s]
    keep: float  # of a low-pass's value from reading to reading [-]
    settled: float  # readings after which the low-passes are believed
    least_slip: float  # slip angle below which an axle's stiffness stays as it is [rad]
    most_slip: float  # and above which [rad]
    least_steer: float  # both stay as they are below this road-wheel angle [rad]
    least_speed: float  # and below this speed [m/s]
    prior_mean: Array  # (3,)
    prior_cov: Array  # (3, 3)
    process_cov: Array  # (3, 3), of one step
    variances: Array  # of the channels and the two forces, without wheel slip; NaN: not used; (12,)
    memory: Array  # as of the single track, then as ROW, ONCE and TWICE say; (16,)


@dataclass(frozen=True)
class ForceBicycleTuning(Settings):
    """How far a filter trusts the bicycle that hears forces. Of the published Q it is known that it was small.

    The lateral forces are those of a force sensor where a reading brings them behind its channels; else they follow
    from m ay and Iz dr/dt, with dr/dt from the low-passed yaw rate.

    Raises:
        ValueError: If a number cannot be; the message names it.
    """

    # Small, since lateral forces speak of the speed too, and wrongly where a tyre slides
    vx_noise: float = tunable(0.2, 0.03, 3.0)  # process noise density [m/s per sqrt(s)]
    vy_noise: float = tunable(0.03, 0.001, 2.0)  # [m/s per sqrt(s)]
    yaw_noise: float = tunable(0.1, 0.003, 2.0)  # [rad/s per sqrt(s)]
    yaw_rate_error: float = tunable(0.0, 0.0, 0.1)  # added to the gyro's noise [rad/s]
    wheel_error: float = tunable(0.0, 0.0, 1.0)  # added to the wheel speeds' noise [rad/s]
    force_error: float = tunable(2000.0, 50.0, 5000.0)  # error of the model's force, added to the sensors' noise [N]
    lag: float = tunable(0.015, 0.005, 0.1)  # time constant of each of the two stages that smooth ay and dr/dt [s]
    hears_wheels: bool = True  # published: no; the speed is then left to the drive forces
    slip: float = 0.005  # slip of a rolling wheel [-]
    brake_slip: float = 0.05  # slip of the fastest wheel while all brake [-]
    brake_hold: float = 0.1  # time for which a wheel is not believed after it braked [s]
    brake_margin: float = 0.0  # by so much may the accelerometer miss what brake torques promise [m/s2]
    vx_prior: float = 1.0  # standard deviation at the start [m/s]
    vy_prior: float = 0.2  # [m/s]
    yaw_prior: float = 0.02  # [rad/s]
    brake_moment: bool = True  # whether unequal longitudinal forces turn the car: the direct yaw moment
    least_slip: float = math.radians(0.3)  # slip angle from which on a stiffness is learnt [rad]
    most_slip: float = tunable(0.15, 0.05, 0.5)  # and up to which: below 3 deg there is no slippery road [rad]
    least_steer: float = math.radians(0.1)  # nothing is learnt near zero steer: road-wheel angle [rad]
    least_speed: float = 8.0  # nor below this speed [m/s]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(**{name: getattr(self, name) for name in POSITIVE})
        check_not_negative(**{name: getattr(self, name) for name in NOT_NEGATIVE})
        if not self.least_slip < self.most_slip:
            raise ValueError(f"least_slip must be less than most_slip, {self.most_slip}, not {self.least_slip}")

    def build(self, nominal: Nominal) -> ForceBicycle:
        """The model of a nominal car with this trust."""
        sheet, dt = nominal.sheet, nominal.dt
        car = SingleTrackTuning(
            vx_noise=self.vx_noise,
            vy_noise=self.vy_noise,
            yaw_noise=self.yaw_noise,
            yaw_rate_error=self.yaw_rate_error,
            wheel_error=self.wheel_error,
            slip=self.slip,
            brake_slip=self.brake_slip,
            brake_hold=self.brake_hold,
            brake_margin=self.brake_margin,
            vx_prior=self.vx_prior,
            vy_prior=self.vy_prior,
            yaw_prior=self.yaw_prior,
            brake_moment=self.brake_moment,
        ).build(nominal)
        heard = car.variances.copy()
        heard[[Y_AX, Y_AY, Y_SPEED, Y_SIDESLIP]] = np.nan
        if not self.hears_wheels:
            heard[Y_YAW_RATE + 1 :] = np.nan
        keep = math.exp(-dt / self.lag)
        smooth, slope = smoothing(keep, dt)
        wheelbase = car.lf + car.lr
        turning = slope * (car.yaw_inertia / wheelbase * sheet.yaw_rate) ** 2
        pushing = smooth * (car.mass / wheelbase * sheet.acceleration) ** 2
        forces = [pushing * arm**2 + turning + self.force_error**2 for arm in (car.lr, car.lf)]
        return ForceBicycle(
            car=car._replace(variances=heard),
            slowest=slowest_linear(car),
            keep=keep,
            settled=float(math.ceil(SETTLED * self.lag / dt)),
            least_slip=float(self.least_slip),
            most_slip=float(self.most_slip),
            least_steer=float(self.least_steer),
            least_speed=float(self.least_speed),
            prior_mean=car.prior_mean,
            prior_cov=car.prior_cov,
            process_cov=car.process_cov,
            variances=np.concatenate((heard, forces)),
            memory=np.concatenate((car.memory, np.zeros(TWICE + SMOOTHED - ROW))),
        )


def smoothing(keep: float, dt: float) -> tuple[float, float]:
    """Variance that two low-passes leave of white noise of variance 1, and that of their output's slope [1/s2]."""
    n = np.arange(math.ceil(60 / -math.log(keep)))
    response = (1 - keep) ** 2 * (n + 1) * keep**n
    slope = np.diff(response, prepend=0.0) / dt
    return float(response @ response), float(slope @ slope)


@compiled
def slip_angles(model, vx, vy, r, steer):
    """Slip angles of the axles, front and rear, positive pushes left [rad]."""
    car, speed = model.car, max(vx, model.slowest)
    return steer - math.atan((vy + car.lf * r) / speed), math.atan((car.lr * r - vy) / speed)


@compiled
def _axle_forces(model, c, u, vx, vy, r):
    """Lateral forces of the axles in wheel axes, up to what friction leaves beside the longitudinal force [N]."""
    front, rear = slip_angles(model, vx, vy, r, u[U_STEER])
    front = max(-c.peak_front, min(c.peak_front, u[U_FRONT] * front))
    return front, max(-c.peak_rear, min(c.peak_rear, u[U_REAR] * rear))


@compiled
def _accelerations(model, c, u, vx, vy, r):
    """Specific forces ax, ay [m/s2] and yaw acceleration [rad/s2]."""
    car = model.car
    front, rear = _axle_forces(model, c, u, vx, vy, r)
    across = front * c.cos_steer + c.front * c.sin_steer
    ax = (c.front * c.cos_steer - front * c.sin_steer + c.rear) / car.mass
    return ax, (across + rear) / car.mass, (car.lf * across - car.lr * rear + c.moment) / car.yaw_inertia


@advance.register(ForceBicycle)
@compiled
def _(model, states, u):
    # Euler's method, as published
    c, h = commanded(model.car, u), model.car.dt
    out = np.empty_like(states)
    for j in range(states.shape[1]):
        vx, vy, r = states[0, j], states[1, j], states[2, j]
        ax, ay, dr = _accelerations(model, c, u, vx, vy, r)
        out[0, j] = max(0.0, vx + h * (ax + vy * r))
        out[1, j] = vy + h * (ay - vx * r)
        out[2, j] = r + h * dr
    return out


@observe.register(ForceBicycle)
@compiled
def _(model, states, u):
    c = commanded(model.car, u)
    out = np.zeros((Y_REAR + 1, states.shape[1]))
    for j in range(states.shape[1]):
        vx, vy, r = states[0, j], states[1, j], states[2, j]
        out[Y_AX, j], out[Y_AY, j], _ = _accelerations(model, c, u, vx, vy, r)
        read_motion(model.car, c.cos_steer, c.sin_steer, vx, vy, r, out, j)
        out[Y_FRONT, j], out[Y_REAR, j] = _axle_forces(model, c, u, vx, vy, r)
    return out


@heed.register(ForceBicycle)
@compiled
def _(model, u, y):
    car, told = model.car, heed(model.car, u, y)
    out = np.empty(U_REAR + 1)
    for i in range(U_FRONT):
        out[i] = told[i]
    out[U_FRONT], out[U_REAR] = car.stiffness_front, car.stiffness_rear
    return out


@attend.register(ForceBicycle)
@compiled
def _(model, memory, u, y):
    variances, after = np.empty(Y_REAR + 1), memory.copy()
    of_channels, wheels = attend_wheels(model.car, memory[:ROW], u, y)
    for i in range(ROW):
        after[i] = wheels[i]
    for i in range(Y_FRONT):
        variances[i] = of_channels[i]
    for i in range(Y_FRONT, Y_REAR + 1):
        variances[i] = np.nan if math.isnan(y[i]) else model.variances[i]
    return variances, after


@report.register(ForceBicycle)
@compiled
def _(model, state, u):
    ax, ay, _ = _accelerations(model, commanded(model.car, u), u, state[0], state[1], state[2])
    return np.array([state[0], state[1], state[2], ax, ay])


@compiled
def _smooth(model, memory, values):
    """Both stages of the low-passes one reading on, in place; says whether they have settled."""
    heard = not math.isnan(values.sum())
    for i in range(values.size):
        if not heard:
            memory[ROW] = 0.0
        elif memory[ROW] == 0.0:
            memory[ONCE + i] = memory[TWICE + i] = values[i]
        else:
            memory[ONCE + i] += (1 - model.keep) * (values[i] - memory[ONCE + i])
            memory[TWICE + i] += (1 - model.keep) * (memory[ONCE + i] - memory[TWICE + i])
    if heard:
        memory[ROW] += 1.0
    return memory[ROW] > model.settled


@regress.register(ForceBicycle)
@compiled
def _(model, mean, memory, u, y):
    # Slip angles and the torques' moment pass through the same low-passes as the forces: all are equally late.
    car, c = model.car, commanded(model.car, u)
    after, values, heard = memory.copy(), np.empty(SMOOTHED), np.full(Y_REAR + 1, np.nan)
    for i in range(Y_FRONT):
        heard[i] = y[i]
    values[0], values[1] = y[Y_AY], y[Y_YAW_RATE]
    values[2], values[3] = slip_angles(model, mean[0], mean[1], mean[2], u[U_STEER])
    values[4] = c.moment
    last = memory[TWICE + 1]
    settled = _smooth(model, after, values)
    slips = after[TWICE + 2], after[TWICE + 3]
    if y.size > Y_REAR:
        heard[Y_FRONT], heard[Y_REAR] = y[Y_FRONT], y[Y_REAR]
        slips = values[2], values[3]
    elif settled:
        push = car.mass * after[TWICE]
        turn = car.yaw_inertia * (after[TWICE + 1] - last) / car.dt - after[TWICE + 4]
        wheelbase = car.lf + car.lr
        heard[Y_FRONT] = ((car.lr * push + turn) / wheelbase - c.front * c.sin_steer) / c.cos_steer
        heard[Y_REAR] = (car.lf * push - turn) / wheelbase
    rows, targets = np.zeros((2, 2)), np.full(2, np.nan)
    variances = model.variances[Y_FRONT:]
    learning = mean[0] >= model.least_speed and abs(u[U_STEER]) >= model.least_steer
    for i in range(2):
        rows[i, i] = slips[i]
        if learning and model.least_slip <= abs(slips[i]) <= model.most_slip:
            targets[i] = heard[Y_FRONT + i]
    return rows, targets, variances, heard, after


@instruct.register(ForceBicycle)
@compiled
def _(model, u, parameters):
    u[U_FRONT], u[U_REAR] = parameters[0], parameters[1]
