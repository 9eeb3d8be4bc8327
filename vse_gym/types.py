"""The nouns that every layer shares."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.physics import parameters as p

__all__ = ["NO_BRAKE", "UNKNOWN_COV", "Array", "BrakeDemand", "Car", "Driver", "Estimate", "Reading"]

Array = NDArray[np.float64]
NAN = float("nan")
SLOW = 2.0  # below this speed a sideslip angle means nothing and is not scored [m/s]


def _constant(value: float, *shape: int) -> Array:
    array = np.full(shape, value)
    array.flags.writeable = False
    return array


NO_TORQUE = _constant(0.0, 4)
UNKNOWN_COV = _constant(NAN, 3, 3)


class Driver(NamedTuple):
    """What the driver asks for."""

    hand_wheel: float = 0.0  # positive left [rad]
    drive: Array = NO_TORQUE  # torque per wheel, (4,) [N m]
    brake: Array = NO_TORQUE  # torque per wheel, (4,) [N m]


class BrakeDemand(NamedTuple):
    """What the stability control asks of the brake unit."""

    added: Array  # torque to add per wheel, (4,) [N m]
    release: Array  # share of the driver's torque to let go per wheel, (4,) in [0, 1]


NO_BRAKE = BrakeDemand(NO_TORQUE, NO_TORQUE)


class Car(NamedTuple):
    """Named access to the plant's state, which is the truth: position, velocity, wheels; SI, ISO 8855."""

    state: Array  # (STATE_SIZE,), see vse_gym.physics.parameters

    @property
    def x(self) -> float:
        """Position of the centre of gravity, earth-fixed [m]."""
        return float(self.state[p.X])

    @property
    def y(self) -> float:
        """Position of the centre of gravity, earth-fixed [m]."""
        return float(self.state[p.Y])

    @property
    def yaw(self) -> float:
        """Heading, counted on beyond a full turn [rad]."""
        return float(self.state[p.YAW])

    @property
    def vx(self) -> float:
        """Forward speed of the centre of gravity [m/s]."""
        return float(self.state[p.VX])

    @property
    def vy(self) -> float:
        """Lateral speed of the centre of gravity [m/s]."""
        return float(self.state[p.VY])

    @property
    def yaw_rate(self) -> float:
        """[rad/s]."""
        return float(self.state[p.YAW_RATE])

    @property
    def ax(self) -> float:
        """Specific force along the car [m/s2]."""
        return float(self.state[p.AX])

    @property
    def ay(self) -> float:
        """Specific force across the car [m/s2]."""
        return float(self.state[p.AY])

    @property
    def wheel_speeds(self) -> Array:
        """(4,) [rad/s]."""
        return self.state[p.WHEEL_SPEEDS]

    @property
    def sideslip(self) -> float:
        """Angle of the velocity to the car's axis, atan2(vy, vx) [rad]."""
        return math.atan2(self.state[p.VY], self.state[p.VX])

    @property
    def distance(self) -> float:
        """Path length travelled [m]."""
        return float(self.state[p.DISTANCE])


# Channels of Reading.y and of Reading.inputs
Y_AX, Y_AY, Y_YAW_RATE, Y_WHEEL, Y_SPEED, Y_SIDESLIP, Y_ROLL_RATE = 0, 1, 2, 3, 7, 8, 9
WHEELS = slice(Y_WHEEL, Y_WHEEL + 4)
CHANNELS = (
    *("ax", "ay", "yaw_rate", "wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr"),
    *("speed", "sideslip", "roll_rate"),  # no production car has these; silent unless a sensor set switches them on
)
U_STEER, U_BRAKE, U_DRIVE = 0, 1, 5
INPUT_CHANNELS = ("steer", *(f"{kind}_{w}" for kind in ("brake", "drive") for w in ("fl", "fr", "rl", "rr")))


class Reading(NamedTuple):
    """What the sensors say at one instant; all that an estimator may know beside ``Nominal``."""

    time: float  # [s]
    inputs: Array  # held since the last reading: steer [rad], brake (4) and drive (4) torques [N m]; (9,)
    y: Array  # as CHANNELS, SI; NaN where a sensor stayed silent or is not on board; (10,)

    @property
    def steer(self) -> float:
        """Road-wheel angle, positive left [rad]."""
        return float(self.inputs[U_STEER])

    @property
    def brake(self) -> Array:
        """Brake torques from measured pressures, (4,) [N m]."""
        return self.inputs[U_BRAKE : U_BRAKE + 4]

    @property
    def drive(self) -> Array:
        """Drive torques, (4,) [N m]."""
        return self.inputs[U_DRIVE : U_DRIVE + 4]

    @property
    def ax(self) -> float:
        """Accelerometer along the car [m/s2]."""
        return float(self.y[Y_AX])

    @property
    def ay(self) -> float:
        """Accelerometer across the car [m/s2]."""
        return float(self.y[Y_AY])

    @property
    def yaw_rate(self) -> float:
        """Gyro [rad/s]."""
        return float(self.y[Y_YAW_RATE])

    @property
    def wheel_speeds(self) -> Array:
        """(4,) [rad/s]."""
        return self.y[WHEELS]

    @property
    def speed(self) -> float:
        """Optical sensor: speed over ground at the centre of gravity [m/s]."""
        return float(self.y[Y_SPEED])

    @property
    def sideslip(self) -> float:
        """Optical sensor: sideslip angle at the centre of gravity [rad]."""
        return float(self.y[Y_SIDESLIP])

    @property
    def roll_rate(self) -> float:
        """[rad/s]."""
        return float(self.y[Y_ROLL_RATE])


class Estimate(NamedTuple):
    """What an estimator believes of the car; NaN where it has no opinion. SI, ISO 8855.

    An absent yaw_rate, ax or ay is filled by the loop with the last valid reading before anybody uses it.
    """

    vx: float  # [m/s]
    vy: float = 0.0  # [m/s]
    yaw_rate: float = NAN  # [rad/s]
    ax: float = NAN  # specific force [m/s2]
    ay: float = NAN  # specific force [m/s2]
    cov: Array = UNKNOWN_COV  # of vx, vy, yaw_rate, (3, 3)
    roll: float = NAN  # positive leans right [rad]
    roll_rate: float = NAN  # [rad/s]
    mass: float = NAN  # [kg]
    stiffness_front: float = NAN  # of the axle [N/rad]
    stiffness_rear: float = NAN  # of the axle [N/rad]
    friction: float = NAN  # [-]
    roll_std: float = NAN
    roll_rate_std: float = NAN
    mass_std: float = NAN
    stiffness_front_std: float = NAN
    stiffness_rear_std: float = NAN
    friction_std: float = NAN

    @property
    def sideslip(self) -> float:
        """atan2(vy, vx) [rad]."""
        return math.atan2(self.vy, self.vx)

    @property
    def sideslip_std(self) -> float:
        """Standard deviation of the sideslip angle, to first order [rad]."""
        square = self.vx * self.vx + self.vy * self.vy
        if square == 0.0:
            return NAN
        a, b = -self.vy / square, self.vx / square
        cov = self.cov
        return math.sqrt(max(0.0, a * a * cov[0, 0] + 2 * a * b * cov[0, 1] + b * b * cov[1, 1]))


FOUND = Estimate._fields[Estimate._fields.index("cov") + 1 :]  # what some estimators find beside the motion


class Log(NamedTuple):
    """One drive, T instants long; row k is the instant k dt.

    What the stability control decided in row k holds until row k + 1; hand wheel, steer and brake are what acted
    until row k.
    """

    time: Array  # (T,) [s]
    truth: Array  # the plant's state, (T, STATE_SIZE)
    hand_wheel: Array  # (T,) [rad]
    steer: Array  # road-wheel angle that the driver set, (T,) [rad]
    inputs: Array  # of the readings, (T, 9)
    readings: Array  # (T, 10), NaN where silent
    estimate: Array  # vx, vy, yaw rate, ax, ay as the controller saw them, (T, 5)
    cov: Array  # of vx, vy, yaw rate, (T, 3, 3); NaN where not given
    brake: Array  # brake torques that acted, (T, 4) [N m]
    added: Array  # what the stability control asked for, (T, 4) [N m]
    release: Array  # share of the driver's brake that it let go, (T, 4)
    friction: Array  # mean of the four wheels, (T,)
    ended: str  # why the drive ended early; empty: it did not
    filled: tuple[str, ...]  # fields of the estimate that were passed-on readings
    nis: Array = NO_TORQUE[:0]  # of each update, over its degrees of freedom, (T,); NaN where none
    seconds: Array = NO_TORQUE[:0]  # that each update and estimate took, (T,) [s]
    vehicle: p.Vehicle | None = None  # the true car; None: nobody knows another than the one in ``Nominal``
    found: Array = NO_TORQUE[:0]  # the estimate's fields of FOUND, (T, 12); NaN where not estimated

    @property
    def sideslip(self) -> Array:
        """True sideslip angle, (T,) [rad]."""
        return np.arctan2(self.truth[:, p.VY], self.truth[:, p.VX])

    @property
    def peak_sideslip(self) -> float:
        """Largest |sideslip| above walking pace [rad]."""
        moving = np.asarray(np.hypot(self.truth[:, p.VX], self.truth[:, p.VY]) > SLOW)
        return float(np.max(np.abs(self.sideslip[moving]), initial=0.0))
