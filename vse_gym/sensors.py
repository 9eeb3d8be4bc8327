"""Sensors: what is added to the truth before anybody may see it.

All noise of a run is drawn at its start, one array per kind of noise, each from a generator of its own: whatever an
estimator does, at one seed it meets the same draws, silences and bursts as its neighbours; and whatever else goes
wrong with a sensor, the draws of one kind stay as they are.
"""

import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.models.nominal import DataSheet, check_sheet
from vse_gym.noise import cauchy_gaussian, contamination, episodes, growing_sigma, random_walk, student_t
from vse_gym.registry import UnknownNameError
from vse_gym.sensing import NoiseRecord
from vse_gym.types import CHANNELS, Y_ROLL_RATE, Y_YAW_RATE, Array

DEG = np.pi / 180
QUIET = DataSheet(acceleration=0.05, yaw_rate=0.1 * DEG, wheel_speed=0.03, steer=0.02 * DEG, brake=0.02)
LOUD = DataSheet(acceleration=0.3, yaw_rate=1.0 * DEG, wheel_speed=0.1, steer=0.02 * DEG, brake=0.02)
FITTED = 7  # channels that every car has
OPTIONAL = len(CHANNELS) - FITTED


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator of one block in one run: a hash of both, so that no block can reproduce another's draws."""
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest, "big")))


class Resolution(NamedTuple):
    """Steps in which readings come, the value of the last bit; 0: as fine as you like."""

    acceleration: float = 0.0  # [m/s2]
    yaw_rate: float = 0.0  # [rad/s]
    wheel_speed: float = 0.0  # [rad/s]
    steer: float = 0.0  # road-wheel angle [rad]
    speed: float = 0.0  # [m/s]
    sideslip: float = 0.0  # [rad]
    roll_rate: float = 0.0  # [rad/s]


CONTINUOUS = Resolution()


@dataclass(frozen=True)
class Sensors:
    """A set of sensors and what goes wrong with them.

    A reading is the truth, late or not, plus noise, bias, walk and bursts, then clipped at the range, then rounded to
    the resolution. What is told to estimators is the data sheet alone: the noise's core, and which sensors there are.
    *Inertial* are the accelerometers, the gyro and, where there is one, the roll gyro, which is of the gyro's kind.

    Raises:
        ValueError: If a number cannot be; the message names it.
    """

    sheet: DataSheet = QUIET
    noise: bool = True  # False: no noise; what is set below still happens
    # Heavy tails of the inertial sensors about the sheet's core; one law at most
    alpha: float = 2.0  # below 2: Cauchy-Gaussian mixture whose normal part has the sheet's sigma [-]
    alpha_rule: str = "published"  # how alpha gives the Cauchy share: "published" or "log_moment"
    freedom: float = math.inf  # degrees of freedom of Student's t, whose scale is the sheet's sigma; infinite: normal
    # Their noise grows: the variance in proportion to time
    growth: float = 1.0  # sigma at the end over the sheet's [-]
    growing: tuple[float, float] = (2.0, 8.0)  # when it begins and when it ends [s]
    # Biases of the inertial sensors: constant, of random sign, and a walk from there, of each on its own
    acceleration_bias: float = 0.0  # [m/s2]
    yaw_rate_bias: float = 0.0  # [rad/s]
    acceleration_walk: float = 0.0  # standard deviation after a second; after t seconds sqrt(t) times that [m/s2]
    yaw_rate_walk: float = 0.0  # [rad/s]
    # Outlier bursts of the inertial sensors
    burst_rate: float = 0.0  # per second and channel [1/s]
    burst: tuple[float, float] = (0.05, 0.1)  # their shortest and longest duration [s]
    acceleration_burst: float = 8.0  # [m/s2]
    yaw_rate_burst: float = 30 * DEG  # [rad/s]
    # Drop-outs of every channel
    silence_rate: float = 0.0  # per second and channel [1/s]
    silence: tuple[float, float] = (0.05, 0.2)  # their shortest and longest duration [s]
    # Delay of what comes over the bus: inertial and optical sensors. The brake unit itself reads wheel speeds and
    # pressures; the steering angle too is taken as prompt, so that a model's cause is on time and its effect is late
    delay: float = 0.0  # rounded to whole steps; until it has passed, the state at the start is read [s]
    # The converter
    acceleration_range: float = 50.0  # readings are clipped at this [m/s2]
    yaw_rate_range: float = 300 * DEG  # of both gyros [rad/s]
    resolution: Resolution = CONTINUOUS  # the ranges become whole numbers of these steps

    def __post_init__(self) -> None:
        check_sheet(self.sheet)
        if not (isinstance(self.freedom, Real) and self.freedom >= 1):
            raise ValueError(f"freedom must be at least 1, the Cauchy law, not {self.freedom!r}")
        if not isinstance(self.resolution, Resolution):
            raise ValueError(f"resolution must be a Resolution, not {self.resolution!r}")
        for name, value in self._numbers():
            if not (isinstance(value, Real) and 0 <= value < math.inf):
                raise ValueError(f"{name} must be a finite number and not negative, not {value!r}")
        contamination(self.alpha, self.alpha_rule)
        if self.alpha < 2 and self.freedom < math.inf:
            raise ValueError(f"alpha {self.alpha} and freedom {self.freedom} are two laws of one noise: give one")
        for kind in ("acceleration", "yaw_rate"):
            reach, step = getattr(self, f"{kind}_range"), getattr(self.resolution, kind)
            if not reach > step:
                raise ValueError(f"{kind}_range must be positive and wider than a step of {step}, not {reach}")
        for name in ("growing", "silence", "burst"):
            first, last = getattr(self, name)
            if not first <= last:
                raise ValueError(f"{name} goes from its smaller to its larger number, not from {first} to {last}")
        if not self.growing[0] < self.growing[1]:
            raise ValueError(f"growing takes time: it cannot begin and end at {self.growing[0]}")

    def _numbers(self) -> Iterator[tuple[str, Any]]:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("growing", "silence", "burst"):
                if not (isinstance(value, tuple) and len(value) == 2):
                    raise ValueError(f"{field.name} must be two numbers, not {value!r}")
                yield from ((field.name, part) for part in value)
            elif isinstance(field.default, float) and field.name != "freedom":
                yield field.name, value
        yield from ((f"resolution.{name}", step) for name, step in self.resolution._asdict().items())

    def record(self, steps: int, dt: float, seed: int) -> NoiseRecord:
        """Everything that will happen to the readings of one run of that many steps."""
        inputs = stream(seed, "sensors/inputs").standard_normal((steps, 5)) * float(self.noise)
        aboard = np.isfinite(_sigma(self.sheet))
        fine, gyro, free = self.resolution, self.yaw_rate_range, math.inf
        resolution = _per_channel(*fine[:3], *fine[4:])
        limits = _per_channel(self.acceleration_range, gyro, free, free, free, gyro)
        whole = resolution > 0
        limits[whole] = resolution[whole] * np.floor(limits[whole] / resolution[whole] + 1e-9)  # 0.3/0.1 is below 3
        return NoiseRecord(
            added=np.where(aboard, self._noise(steps, dt, seed) + self._offset(steps, dt, seed), 0.0),
            silent=self._silent(steps, dt, seed, aboard),
            steer=inputs[:, 0] * self.sheet.steer,
            brake=inputs[:, 1:] * self.sheet.brake,
            limits=limits,
            resolution=resolution,
            steer_resolution=float(fine.steer),
            delay=round(self.delay / dt),
            dt=dt,
        )

    def _noise(self, steps: int, dt: float, seed: int) -> Array:
        sigma = _sigma(self.sheet)
        unit = np.zeros((steps, len(CHANNELS)))
        unit[:, :FITTED] = stream(seed, "sensors/noise").standard_normal((steps, FITTED))
        if np.isfinite(sigma[FITTED:]).any():
            unit[:, FITTED:] = stream(seed, "sensors/optional").standard_normal((steps, OPTIONAL))
        growth = growing_sigma(dt * np.arange(steps, dtype=float), self.growth, *self.growing)[:, None]
        for at, name in self._inertial():
            if self.alpha < 2:
                rng = stream(seed, f"sensors/tails{name}")
                unit[:, at] = cauchy_gaussian(self.alpha, 1 / np.sqrt(2), unit[:, at].shape, rng, self.alpha_rule)
            elif self.freedom < math.inf:
                unit[:, at] = student_t(unit[:, at], self.freedom, stream(seed, f"sensors/student{name}"))
            unit[:, at] *= growth
        return unit * sigma * float(self.noise)

    def _offset(self, steps: int, dt: float, seed: int) -> Array:
        bias, walk, burst = (
            _per_channel(acceleration, gyro, roll_rate=gyro)
            for acceleration, gyro in (
                (self.acceleration_bias, self.yaw_rate_bias),
                (self.acceleration_walk, self.yaw_rate_walk),
                (self.acceleration_burst, self.yaw_rate_burst),
            )
        )
        out = np.zeros((steps, len(CHANNELS)))
        for at, name in self._inertial():
            n = out[0, at].size
            if bias.any():
                out[:, at] += bias[at] * stream(seed, f"sensors/bias{name}").choice([-1.0, 1.0], n)
            if self.burst_rate > 0:
                rng = stream(seed, f"sensors/bursts{name}")
                out[:, at] += burst[at] * episodes(self.burst_rate, *self.burst, steps, n, dt, rng)
            if walk.any():
                out[:, at] += walk[at] * random_walk(steps, n, dt, stream(seed, f"sensors/walk{name}"))
        return out

    def _silent(self, steps: int, dt: float, seed: int, aboard: NDArray[np.bool_]) -> NDArray[np.bool_]:
        silent = np.tile(~aboard, (steps, 1))
        for at, name in ((slice(0, FITTED), ""), (slice(FITTED, None), "/optional")):
            if self.silence_rate > 0 and aboard[at].any():
                rng, n = stream(seed, f"sensors/silence{name}"), aboard[at].size
                silent[:, at] |= episodes(self.silence_rate, *self.silence, steps, n, dt, rng) != 0
        return silent

    def _inertial(self) -> Iterator[tuple[slice, str]]:
        """Channels, and what their streams' names end with: a roll gyro aboard does not move the others' draws."""
        yield slice(0, Y_YAW_RATE + 1), ""
        if np.isfinite(self.sheet.roll_rate):
            yield slice(Y_ROLL_RATE, Y_ROLL_RATE + 1), "/roll_rate"


def _per_channel(
    acceleration: float,
    yaw_rate: float,
    wheel_speed: float = 0.0,
    speed: float = 0.0,
    sideslip: float = 0.0,
    roll_rate: float = 0.0,
) -> Array:
    return np.array([acceleration, acceleration, yaw_rate, *4 * [wheel_speed], speed, sideslip, roll_rate], dtype=float)


def _sigma(sheet: DataSheet) -> Array:
    """Of each channel, (10,); NaN where there is no such sensor."""
    return _per_channel(*sheet[:3], sheet.speed, sheet.sideslip, sheet.roll_rate)


SUITES: dict[str, Sensors] = {
    "clean": Sensors(QUIET, noise=False),
    "gaussian": Sensors(QUIET),
    "loud": Sensors(LOUD),
    "cauchy_gaussian": Sensors(LOUD, alpha=1.3, acceleration_range=20.0, yaw_rate_range=100 * DEG),
    "biased": Sensors(QUIET, acceleration_bias=0.3, yaw_rate_bias=0.3 * DEG),
    "dropout": Sensors(QUIET, silence_rate=0.5),
    "outliers": Sensors(QUIET, burst_rate=1.0),
    # A sensor cluster that shakes loose: quiet at first, at the end twice (gyro) and three times (accelerometers) as
    # noisy as the loud set, enough for needless braking. When is as in Wang et al. (2017), how much is chosen.
    "growing": Sensors(QUIET, growth=20.0, growing=(2.0, 8.0)),
    # Sensors behind a busy bus and its gateways: two periods of a 50 Hz message; chosen.
    "late": Sensors(QUIET, delay=0.04),
    # An old car with a cheap cluster: everything at once, each in moderation. The Cauchy share of 10 % puts 1.7 % of
    # readings beyond three sigmas, where measured cars lie between 0.3 and 6 %; biases as in `biased`, drop-outs as in
    # `dropout`; ranges and steps of a production car's 10-bit messages (opendbc, Toyota); walk and delay are chosen.
    "harsh": Sensors(
        LOUD,
        alpha=1.75,
        acceleration_bias=0.3,
        yaw_rate_bias=0.3 * DEG,
        acceleration_walk=0.02,
        yaw_rate_walk=0.05 * DEG,
        silence_rate=0.5,
        delay=0.02,
        acceleration_range=18.375,
        yaw_rate_range=125 * DEG,
        resolution=Resolution(acceleration=0.0359, yaw_rate=0.244 * DEG, wheel_speed=0.05),
    ),
}

EXTRAS: dict[str, Callable[[DataSheet], DataSheet]] = {
    # Speed over ground and sideslip angle, as a measuring car has it. The angle's five sigmas are the largest error
    # that ISO 15037 recommends, 0.5 deg; the speed's is chosen.
    "optical": lambda sheet: sheet._replace(speed=0.05, sideslip=0.1 * DEG),
    # A gyro about the roll axis, as good as the one about the yaw axis
    "roll_rate": lambda sheet: sheet._replace(roll_rate=sheet.yaw_rate),
}


def with_extras(sensors: Sensors, *names: str) -> Sensors:
    """The same sensors and others beside them, which estimators are told of.

    Raises:
        UnknownNameError: If there is no such extra sensor; the message names those that exist.
    """
    for name in names:
        if name not in EXTRAS:
            raise UnknownNameError(f"no extra sensor named {name!r}; known: {', '.join(EXTRAS)}")
        sensors = replace(sensors, sheet=EXTRAS[name](sensors.sheet))
    return sensors


def suite(sensors: str | Sensors) -> Sensors:
    """A set of sensors by its name, with extra sensors after a plus ("loud+optical+roll_rate"), or as it is.

    Raises:
        UnknownNameError: If no suite or extra has that name; the message names those that exist.
    """
    if isinstance(sensors, Sensors):
        return sensors
    name, *extras = sensors.split("+")
    if name not in SUITES:
        raise UnknownNameError(
            f"no sensor suite named {name!r}; known: {', '.join(SUITES)}, each also with +{' or +'.join(EXTRAS)}"
        )
    return with_extras(SUITES[name], *extras)
