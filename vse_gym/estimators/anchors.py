"""The ends of the scale: true states, and no sideslip at all."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import Estimate, Reading

MOTION = ("vx", "vy", "yaw_rate", "ax", "ay")


@dataclass(frozen=True)
class Truth(Estimator):
    """A marker: the loop itself fills the named fields of the estimate from the plant. Nothing else can reach it.

    Raises:
        ValueError: If a field is not one of vx, vy, yaw_rate, ax, ay, or delay is negative.
    """

    fields: tuple[str, ...] = MOTION
    delay: float = 0.0  # age of what is filled in [s]
    gain: float = 1.0  # on vy [-]
    bias: float = 0.0  # added to vy after that [m/s]
    inner: Estimator | None = None  # whose estimate the other fields keep; None: nothing known of them

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "fields", tuple(self.fields))
        if wrong := set(self.fields) - set(MOTION):
            raise ValueError(f"no such field of the estimate: {sorted(wrong)}; known: {', '.join(MOTION)}")
        if not self.delay >= 0:
            raise ValueError(f"delay must not be negative, not {self.delay}")

    def init(self, nominal: Nominal, rng: np.random.Generator) -> tuple[Nominal, object]:
        return nominal, None if self.inner is None else self.inner.init(nominal, rng)

    def update(
        self, state: tuple[Nominal, object], reading: Reading, rng: np.random.Generator
    ) -> tuple[Nominal, object]:
        nominal, inner = state
        return nominal, None if self.inner is None else self.inner.update(inner, reading, rng)

    def innovation(self, state: tuple[Nominal, object]) -> tuple[float, float]:
        return super().innovation(state) if self.inner is None else self.inner.innovation(state[1])

    def effective_size(self, state: tuple[Nominal, object]) -> float:
        return super().effective_size(state) if self.inner is None else self.inner.effective_size(state[1])

    @property
    def told_friction(self) -> bool:
        return self.inner is not None and self.inner.told_friction

    def tell_friction(self, state: tuple[Nominal, object], friction: float) -> tuple[Nominal, object]:
        nominal, inner = state
        return nominal, None if self.inner is None else self.inner.tell_friction(inner, friction)

    def estimate(self, state: tuple[Nominal, object]) -> Estimate:
        nominal, inner = state
        return Estimate(nominal.speed) if self.inner is None else self.inner.estimate(inner)


@dataclass(frozen=True)
class TruthVelocity(Truth):
    """True vx and vy; yaw rate and ay from the sensors: perfect sideslip, an unfiltered gyro."""

    fields: tuple[str, ...] = ("vx", "vy")


class RollingWheels(NamedTuple):
    """Speed from the wheels that roll freely."""

    radius: float  # [m]
    dt: float  # [s]
    since_brake: tuple[float, ...]  # per wheel [s]
    vx: float  # [m/s]


@dataclass(frozen=True)
class ZeroSideslip(Estimator):
    """No sideslip, speed from the freely rolling wheels, yaw rate and accelerations from the sensors: the lower end.

    While all wheels brake, the fastest counts, but speed falls no faster than the accelerometer says.
    """

    brake_hold: float = 0.1  # a wheel is not believed for this long after it braked [s]
    braking: float = 20.0  # a wheel with more brake torque than this is braking [N m]
    margin: float = 0.3  # of the accelerometer [m/s2]

    def init(self, nominal: Nominal, rng: np.random.Generator) -> RollingWheels:
        return RollingWheels(nominal.vehicle.wheel_radius, nominal.dt, (self.brake_hold,) * 4, nominal.speed)

    def update(self, state: RollingWheels, reading: Reading, rng: np.random.Generator) -> RollingWheels:
        since = tuple(
            0.0 if torque > self.braking else before + state.dt
            for torque, before in zip(reading.brake.tolist(), state.since_brake, strict=True)
        )
        heard = [w for w in reading.wheel_speeds.tolist() if w == w]
        driven = [abs(torque) > self.braking for torque in reading.drive.tolist()]
        rolling = [
            (w, d)
            for w, s, d in zip(reading.wheel_speeds.tolist(), since, driven, strict=True)
            if w == w and s >= self.brake_hold
        ]
        free = [w for w, d in rolling if not d] or [w for w, _ in rolling]
        if free:
            vx = state.radius * sum(free) / len(free)
        elif heard:
            slowest = state.vx + state.dt * (
                min(0.0, reading.ax) - self.margin if reading.ax == reading.ax else -GRAVITY
            )
            vx = max(slowest, state.radius * max(heard))  # a locking wheel is no speed
        else:
            vx = state.vx
        return RollingWheels(state.radius, state.dt, since, vx)

    def estimate(self, state: RollingWheels) -> Estimate:
        return Estimate(vx=state.vx)
