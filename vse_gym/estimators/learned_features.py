"""What learned estimators hear: readings and a nominal car turned into numbers about one, the same for every car.

Training and driving call the same function, :func:`take_in`. What a net adds to is given beside the features: a plain
value of vx, vy, yaw rate, ax and ay. A feature is even or odd: an odd one changes its sign when left and right are
exchanged.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from vse_gym.compiled import compiled, generic
from vse_gym.estimators.kinematic import KinematicObserver, Kinematics, kinematic_step
from vse_gym.inference.gaussian import filter_step, foresee, predict
from vse_gym.inference.gaussian.recursion import covariance
from vse_gym.inference.model import heed, recall, report
from vse_gym.models import Nominal
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import U_BRAKE, U_DRIVE, U_STEER, Y_AX, Y_AY, Y_WHEEL, Y_YAW_RATE, Array

EVEN, ODD = 1.0, -1.0
HEARD = {  # of the readings and of what is plainly seen in them
    **{"ax": EVEN, "ay": ODD, "yaw_rate": ODD, "slow_yaw_rate": ODD},
    **{"valid_ax": EVEN, "valid_ay": EVEN, "valid_yaw_rate": EVEN},
    **{"wheels_front": EVEN, "wheels_rear": EVEN, "wheels_front_apart": ODD, "wheels_rear_apart": ODD},
    **{"valid_front": EVEN, "valid_rear": EVEN, "valid_front_apart": ODD, "valid_rear_apart": ODD},
    **{"steer": ODD, "drive_front": EVEN, "drive_rear": EVEN},
    **{"brake_front": EVEN, "brake_rear": EVEN, "brake_front_apart": ODD, "brake_rear_apart": ODD},
    **{"speed": EVEN, "slowness": EVEN, "lateral_rate": ODD, "understeer": ODD},
    **{"sideslip_kinematic": ODD, "sideslip_front": ODD, "sideslip_rear": ODD},
}
KNOWN = ("mass", "inertia", "wheelbase", "balance", "grip_front", "grip_rear", "height", "front_drive", "transfer")
SHEET = ("log_acceleration_noise", "log_yaw_rate_noise", "log_wheel_noise")
FILTERED = {  # of the filter inside
    **{"filter_sideslip": ODD, "filter_speed": EVEN, "filter_yaw_rate": ODD, "missed_ax": EVEN, "missed_ay": ODD},
    **{"innovation_ax": EVEN, "innovation_ay": ODD, "innovation_yaw_rate": ODD},
    **{"innovation_front": EVEN, "innovation_rear": EVEN},
    **{"innovation_front_apart": ODD, "innovation_rear_apart": ODD},
    **{"log_vx_std": EVEN, "log_vy_std": EVEN, "log_yaw_rate_std": EVEN},
}
FEATURES = HEARD | dict.fromkeys((*KNOWN, *SHEET), EVEN)
FILTER_FEATURES = FEATURES | FILTERED
_FIRST, _ALL = len(FEATURES), len(FILTER_FEATURES)
MOTION = {"vx": EVEN, "vy": ODD, "yaw_rate": ODD, "ax": EVEN, "ay": ODD}  # what is estimated
OUTPUTS = MOTION | {f"log_{name}_std": EVEN for name in MOTION}

LIMIT = 5.0  # no feature is larger, whatever is read
SLOWEST = 2.0  # speed to which angles are taken at least [m/s]
YAW_ACCELERATION = 6.0  # no car reaches more, so no gyro is followed faster [rad/s2]
_HELD, _SLOW, _PLAIN = 2, 9, 10  # of the values: where held ax, ay, yaw rate and the slow one are; how many


class Known(NamedTuple):
    """What is known before a drive."""

    kinematics: Kinematics
    lf: float  # [m]
    lr: float  # [m]
    yield_front: float  # slip angle of the front axle over lateral acceleration, at little of both [rad s2/m]
    yield_rear: float  # [rad s2/m]
    torque: float  # that a wheel takes under its share of the weight on a friction of one [N m]
    dt: float  # [s]
    constant: Array  # the features of KNOWN and SHEET


class Readings(NamedTuple):
    """The front end of a net that hears readings alone."""

    known: Known


class FilteredReadings(NamedTuple):
    """The front end of a net that hears a Gaussian filter too, and corrects it."""

    known: Known
    rule: Any
    model: Any  # with the state vx, vy, yaw rate


def known(nominal: Nominal) -> Known:
    """What a nominal car and its data sheet say."""
    car, sheet, observer = nominal.vehicle, nominal.sheet, KinematicObserver()
    front, rear = 2 * car.front_tyre.cornering_stiffness, 2 * car.rear_tyre.cornering_stiffness
    load_front, load_rear = car.mass * car.lr / car.wheelbase, car.mass * car.lf / car.wheelbase
    numbers = (
        *(car.mass / 1500 - 1, car.yaw_inertia / (car.mass * car.lf * car.lr) - 1, car.wheelbase / 2.6 - 1),
        *(5 * (car.lf / car.wheelbase - 0.45), front / (load_front * GRAVITY) / 15 - 1),
        *(rear / (load_rear * GRAVITY) / 15 - 1, 5 * (car.height / (car.track_front + car.track_rear) - 0.17)),
        *(car.front_drive - 0.5, 5 * (car.front_transfer - 0.55)),
        *(math.log(sheet.acceleration / 0.1), math.log(sheet.yaw_rate / 0.005), math.log(sheet.wheel_speed / 0.05)),
    )
    return Known(
        kinematics=observer.init(nominal, np.random.default_rng(0)).kinematics,
        lf=float(car.lf),
        lr=float(car.lr),
        yield_front=float(load_front / front),
        yield_rear=float(load_rear / rear),
        torque=float(0.25 * car.mass * GRAVITY * car.wheel_radius),
        dt=float(nominal.dt),
        constant=np.clip(np.array(numbers, dtype=float), -LIMIT, LIMIT),
    )


def fresh_values(nominal: Nominal) -> Array:
    """What a front end carries before the first reading, (10,)."""
    values = np.zeros(_PLAIN)
    values[0], values[5:9] = nominal.speed, KinematicObserver().brake_hold
    return values


@generic
def take_in(front, values, u, y):
    """What a front end makes of one more reading.

    Args:
        front: What is known, and what does the work.
        values: That it carries.
        u, y: Inputs and reading.

    Returns:
        values one step on; features (F,), each within LIMIT; and the plain motion, as MOTION, (5,), finite.
    """


@compiled
def units(vx):
    """In which corrections, and their logarithms of standard deviations, are written: as MOTION, (5,)."""
    return np.array([0.5, 0.05 * max(vx, SLOWEST), 0.05, 0.5, 0.5])


@compiled
def _pair(x, even, odd, left, right):
    """A left and a right number as their mean and half of what they are apart."""
    x[even], x[odd] = 0.5 * (left + right), 0.5 * (right - left)


@compiled
def _hear(known, values, u, y, x):
    """Fill the features that need no filter, as FEATURES; returns the values one step on."""
    k = known.kinematics
    after = values.copy()
    after[:_SLOW] = kinematic_step(k, values[:_SLOW], u, y)
    vx, vy, ax, ay, r = after[0], after[1], after[_HELD], after[_HELD + 1], after[_HELD + 2]
    reach = YAW_ACCELERATION * known.dt
    slow = after[_SLOW] = values[_SLOW] + max(-reach, min(reach, r - values[_SLOW]))
    x[0], x[1], x[2], x[3] = ax / 4, ay / 4, r / 0.4, slow / 0.4
    for i, channel in ((4, Y_AX), (5, Y_AY), (6, Y_YAW_RATE)):
        x[i] = 0.0 if math.isnan(y[channel]) else 1.0
    speeds, heard = np.zeros(4), np.zeros(4)  # of the wheels beyond rolling
    for i in range(4):
        half = 0.5 * (k.track_front if i < 2 else k.track_rear) * (1.0 if i % 2 == 0 else -1.0)
        if not math.isnan(y[Y_WHEEL + i]):
            speeds[i], heard[i] = (k.radius * y[Y_WHEEL + i] + half * slow - vx) / 0.5, 1.0
    brake, drive = u[U_BRAKE : U_BRAKE + 4] / known.torque, u[U_DRIVE : U_DRIVE + 4] / known.torque
    for axle in range(2):
        left, right = 2 * axle, 2 * axle + 1
        _pair(x, 7 + axle, 9 + axle, speeds[left], speeds[right])
        _pair(x, 11 + axle, 13 + axle, heard[left], heard[right])
        x[16 + axle] = drive[left] + drive[right]
        _pair(x, 18 + axle, 20 + axle, brake[left], brake[right])
    speed = max(vx, SLOWEST)
    x[15], x[22], x[23] = u[U_STEER] / 0.1, speed / 20 - 1, 5 / speed - 0.25
    x[24] = (ay - speed * slow) / 4
    # What the axles' slip angles would be if the tyres were linear: sideslip by one and by the other, and their
    # difference, which is what the car turns less than it would without slip
    front = u[U_STEER] - known.lf * slow / speed - known.yield_front * ay
    rear = known.lr * slow / speed - known.yield_rear * ay
    x[25], x[26], x[27], x[28] = (front - rear) / 0.05, vy / speed / 0.1, front / 0.1, rear / 0.1
    for i in range(known.constant.size):
        x[29 + i] = known.constant[i]
    return after


@compiled
def _limit(x):
    for i in range(x.size):
        x[i] = max(-LIMIT, min(LIMIT, x[i]))


@take_in.register(Readings)
@compiled
def _(front, values, u, y):
    x = np.empty(_FIRST)
    after = _hear(front.known, values, u, y, x)
    _limit(x)
    base = np.array([after[0], 0.0, after[_SLOW], after[_HELD], after[_HELD + 1]])
    return after, x, base


@take_in.register(FilteredReadings)
@compiled
def _(front, values, u, y):
    rule, model = front.rule, front.model
    n, first = model.prior_mean.size, _FIRST
    after, x = np.empty(values.size), np.empty(_ALL)
    plain = _hear(front.known, values[:_PLAIN], u, y, x)
    belief, b = values[_PLAIN:], values.size - _PLAIN - model.memory.size
    mean, kept, memory = belief[:n], belief[n:b].reshape((b - n) // n, n), belief[b:]
    u = recall(model, memory, heed(model, u, y))
    ahead, doubt = predict(rule, model, mean, kept, u)
    expected, spread = foresee(rule, model, ahead, doubt, u)
    missed = np.zeros(7)
    for i in range(7):
        if not math.isnan(y[i]):
            missed[i] = (y[i] - expected[i]) / math.sqrt(spread[i] + model.variances[i])
    mean, kept, memory, _, _ = filter_step(rule, model, mean, kept, memory, u, y)
    cov, told = covariance(rule, kept), report(model, mean, u)
    ax, ay = plain[_HELD], plain[_HELD + 1]
    x[first], x[first + 1] = mean[1] / max(mean[0], SLOWEST) / 0.1, mean[0] - plain[0]
    x[first + 2], x[first + 3], x[first + 4] = (mean[2] - plain[_SLOW]) / 0.1, (ax - told[3]) / 2, (ay - told[4]) / 2
    x[first + 5], x[first + 6], x[first + 7] = missed[Y_AX], missed[Y_AY], missed[Y_YAW_RATE]
    for axle in range(2):
        _pair(x, first + 8 + axle, first + 10 + axle, missed[Y_WHEEL + 2 * axle], missed[Y_WHEEL + 2 * axle + 1])
    for i in range(3):
        x[first + 12 + i] = 0.5 * math.log(max(cov[i, i], 1e-12)) - math.log(0.1)
    _limit(x)
    for i in range(_PLAIN):
        after[i] = plain[i]
    for i in range(n):
        after[_PLAIN + i] = mean[i]
    for i in range(kept.shape[0]):
        for j in range(n):
            after[_PLAIN + n + i * n + j] = kept[i, j]
    for i in range(memory.size):
        after[_PLAIN + b + i] = memory[i]
    # A filter that is lost is followed no farther than the net is told of, which else could not call it back
    vx, r = plain[0] + x[first + 1], plain[_SLOW] + 0.1 * x[first + 2]
    return after, x, np.array([vx, 0.1 * x[first] * max(vx, SLOWEST), r, ax, ay])


@compiled
def hear_drive(front, values, inputs, readings):
    """A recorded drive, inputs (T, 9) and readings (T, 10), heard: features (T, F), plain motion and units (T, 5)."""
    steps = readings.shape[0]
    values, x, base = take_in(front, values, inputs[0], readings[0])
    features, motion, scale = np.empty((steps, x.size)), np.empty((steps, base.size)), np.empty((steps, base.size))
    for t in range(steps):
        if t > 0:
            values, x, base = take_in(front, values, inputs[t], readings[t])
        features[t], motion[t], scale[t] = x, base, units(base[0])
    return features, motion, scale
