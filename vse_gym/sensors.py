"""Sensors: what is added to the truth before anybody may see it.

All noise of a run is drawn at its start, one array per kind of noise, each from a generator of its own: whatever an
estimator does, at one seed it meets the same draws, silences and bursts as its neighbours.
"""

import hashlib
import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.models import DataSheet
from vse_gym.physics import parameters as p
from vse_gym.registry import UnknownNameError
from vse_gym.types import CHANNELS, U_BRAKE, U_DRIVE, U_STEER, Y_SIDESLIP, Y_SPEED, Y_WHEEL, Array

DEG = np.pi / 180
QUIET = DataSheet(acceleration=0.05, yaw_rate=0.1 * DEG, wheel_speed=0.03, steer=0.02 * DEG, brake=0.02)
LOUD = DataSheet(acceleration=0.3, yaw_rate=1.0 * DEG, wheel_speed=0.1, steer=0.02 * DEG, brake=0.02)
INERTIAL = (p.AX, p.AY, p.YAW_RATE)  # where the first channels lie in the state
FITTED = 7  # channels that every car has


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator of one block in one run: a hash of both, so that no block can reproduce another's draws."""
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest, "big")))


def contamination(alpha: float) -> float:
    """Cauchy share of the mixture for a characteristic exponent alpha in [1, 2]. Qin et al. (2014).

    Raises:
        ValueError: If alpha lies outside.
    """
    if not 1 <= alpha <= 2:
        raise ValueError(f"alpha must lie in [1, 2], not {alpha}")
    return (4 - alpha**2) / (3 * alpha**2)


def cauchy_gaussian(alpha: float, scale: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Draws from the Cauchy-Gaussian mixture of Qin et al. (2014), unclipped.

    With probability (4 - alpha^2)/(3 alpha^2) a Cauchy variate of this scale, else a normal one of variance
    2 scale^2. The density is (share scale)/(pi (x^2 + scale^2)) + (1 - share)/(2 sqrt(pi) scale) exp(-x^2/(4 scale^2)).
    """
    heavy = rng.random(shape) < contamination(alpha)
    normal = np.sqrt(2) * scale * rng.standard_normal(shape)
    return np.where(heavy, scale * rng.standard_cauchy(shape), normal)


def episodes(
    rate: float, shortest: float, longest: float, steps: int, channels: int, dt: float, rng: np.random.Generator
) -> Array:
    """When something goes wrong: (steps, channels) of 0 and, during an episode, its sign, +1 or -1.

    Args:
        rate: Episodes that begin per second and channel, a Poisson process [1/s].
        shortest, longest: Their length is uniform between these [s].
    """
    out = np.zeros((steps, channels))
    begins = rng.random((steps, channels)) < -np.expm1(-rate * dt)
    lengths = np.rint(rng.uniform(shortest, longest, (steps, channels)) / dt).astype(int)
    signs = rng.choice([-1.0, 1.0], (steps, channels))
    for k, channel in zip(*np.nonzero(begins), strict=True):
        out[k : k + max(1, lengths[k, channel]), channel] = signs[k, channel]
    return out


@dataclass(frozen=True)
class Sensors:
    """A set of sensors and what goes wrong with them.

    Raises:
        ValueError: If a number is negative, or alpha lies outside [1, 2].
    """

    sheet: DataSheet = QUIET
    noise: bool = True  # False: the readings are the truth
    alpha: float = 2.0  # below 2, accelerometers and gyro have Cauchy-Gaussian noise about the sheet's core
    acceleration_range: float = 50.0  # readings are clipped at this [m/s2]
    yaw_rate_range: float = 300 * DEG  # [rad/s]
    acceleration_bias: float = 0.0  # constant, of random sign [m/s2]
    yaw_rate_bias: float = 0.0  # [rad/s]
    silence_rate: float = 0.0  # drop-outs per second and channel [1/s]
    silence: tuple[float, float] = (0.05, 0.2)  # their shortest and longest duration [s]
    burst_rate: float = 0.0  # outlier bursts per second and channel of accelerometers and gyro [1/s]
    burst: tuple[float, float] = (0.05, 0.1)  # their shortest and longest duration [s]
    acceleration_burst: float = 8.0  # [m/s2]
    yaw_rate_burst: float = 30 * DEG  # [rad/s]

    def __post_init__(self) -> None:
        contamination(self.alpha)
        wrong = [name for name in ("acceleration_range", "yaw_rate_range") if not getattr(self, name) > 0]
        if wrong:
            raise ValueError(f"{wrong[0]} must be positive, not {getattr(self, wrong[0])}")
        sheet = self.sheet._asdict().items()
        numbers = {f"sheet.{k}": v for k, v in sheet if not (k in DataSheet._field_defaults and np.isnan(v))}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple) and not isinstance(value, DataSheet):
                numbers[field.name] = min(value)
            elif isinstance(value, float | int):
                numbers[field.name] = value
        for name, value in numbers.items():
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} must be finite and not negative, not {value}")
        for name in ("silence", "burst"):
            shortest, longest = getattr(self, name)
            if not shortest <= longest < np.inf:
                raise ValueError(f"{name} goes from its shortest to its longest duration, not {shortest} to {longest}")

    def record(self, steps: int, dt: float, seed: int) -> "NoiseRecord":
        """Everything that will happen to the readings of one run of that many steps."""
        sheet = self.sheet
        sigma = np.array([sheet.acceleration] * 2 + [sheet.yaw_rate] + [sheet.wheel_speed] * 4)
        imu = np.array([self.acceleration_bias] * 2 + [self.yaw_rate_bias])
        shock = np.array([self.acceleration_burst] * 2 + [self.yaw_rate_burst])
        optional = np.array([sheet.speed, sheet.sideslip, sheet.roll_rate])
        aboard = np.isfinite(optional)
        added = np.zeros((steps, len(CHANNELS)))
        added[:, :FITTED] = stream(seed, "sensors/noise").standard_normal((steps, FITTED)) * sigma
        extra = stream(seed, "sensors/optional").standard_normal((steps, 3))
        added[:, FITTED:] = extra * np.where(aboard, optional, 0.0)
        if self.alpha < 2:
            unit = cauchy_gaussian(self.alpha, 1 / np.sqrt(2), (steps, 3), stream(seed, "sensors/tails"))
            added[:, :3] = unit * sigma[:3]
        if not self.noise:
            added[:] = 0.0
        added[:, :3] += imu * stream(seed, "sensors/bias").choice([-1.0, 1.0], 3)
        bursts = episodes(self.burst_rate, *self.burst, steps, 3, dt, stream(seed, "sensors/bursts"))
        added[:, :3] += bursts * shock
        inputs = stream(seed, "sensors/inputs").standard_normal((steps, 5)) * float(self.noise)
        silent = np.zeros((steps, len(CHANNELS)), dtype=bool)
        silence = episodes(self.silence_rate, *self.silence, steps, FITTED, dt, stream(seed, "sensors/silence"))
        silent[:, :FITTED], silent[:, FITTED:] = silence != 0, ~aboard
        limits = np.array([self.acceleration_range] * 2 + [self.yaw_rate_range] + [np.inf] * 7)
        return NoiseRecord(added, silent, inputs[:, 0] * sheet.steer, inputs[:, 1:] * sheet.brake, limits, dt)


class NoiseRecord(NamedTuple):
    """What happens to the readings of one run."""

    added: Array  # (steps, 10)
    silent: Array  # (steps, 10), true where a sensor says nothing
    steer: Array  # added to the road-wheel angle, (steps,) [rad]
    brake: Array  # relative error of each brake torque, (steps, 4) [-]
    limits: Array  # range of each channel, (10,)
    dt: float


@compiled
def _true_value(state, channel):
    """What a perfect sensor would read."""
    if channel < Y_WHEEL:
        return state[INERTIAL[channel]]
    if channel < Y_SPEED:
        return state[p.WHEEL + channel - Y_WHEEL]
    if channel == Y_SPEED:
        return math.sqrt(state[p.VX] ** 2 + state[p.VY] ** 2)
    return math.atan2(state[p.VY], state[p.VX]) if channel == Y_SIDESLIP else state[p.ROLL_RATE]


@compiled
def read_sensors(record, step, state, inputs, heard):
    """The reading at a step, of the plant's state and of the inputs that were held until then.

    Returns:
        u (9,) and y (10,) as :class:`Reading` has them; the last valid value of each channel, (10,).
    """
    u, y, heard = np.empty(9), np.empty(10), heard.copy()
    for i in range(10):
        value = _true_value(state, i) + record.added[step, i]
        value = min(record.limits[i], max(-record.limits[i], value))
        y[i] = np.nan if record.silent[step, i] else value
        if not record.silent[step, i]:
            heard[i] = value
    u[U_STEER] = inputs.steer + record.steer[step]
    for i in range(4):
        u[U_BRAKE + i] = inputs.brake[i] * (1 + record.brake[step, i])
        u[U_DRIVE + i] = inputs.drive[i]
    return u, y, heard


SUITES: dict[str, Sensors] = {
    "clean": Sensors(QUIET, noise=False),
    "gaussian": Sensors(QUIET),
    "loud": Sensors(LOUD),
    "cauchy_gaussian": Sensors(LOUD, alpha=1.3, acceleration_range=20.0, yaw_rate_range=100 * DEG),
    "biased": Sensors(QUIET, acceleration_bias=0.3, yaw_rate_bias=0.3 * DEG),
    "dropout": Sensors(QUIET, silence_rate=0.5),
    "outliers": Sensors(QUIET, burst_rate=1.0),
}


def suite(sensors: str | Sensors) -> Sensors:
    """A set of sensors by its name, or as it is.

    Raises:
        UnknownNameError: If no suite has that name; the message names those that exist.
    """
    if isinstance(sensors, Sensors):
        return sensors
    if sensors not in SUITES:
        raise UnknownNameError(f"no sensor suite named {sensors!r}; known: {', '.join(SUITES)}")
    return SUITES[sensors]
