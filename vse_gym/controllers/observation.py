"""What an agent sees: one place for the environment and for a trained policy.

Every observation is a float32 vector in SI units, clipped to finite limits (``gymnasium.wrappers.RescaleObservation``
maps them to [-1, 1]). A standard deviation that an estimator does not give stands at its limit.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled, hold
from vse_gym.controllers.esc import StabilityControl
from vse_gym.controllers.reference import Reference, follow_reference
from vse_gym.models import Nominal
from vse_gym.types import CHANNELS, WHEELS, Y_AY, Y_WHEEL, Array, Estimate, Reading


class Feature(NamedTuple):
    """One number of an observation."""

    name: str
    low: float
    high: float


MOTION = (
    Feature("vx", -80, 80),
    Feature("vy", -40, 40),
    Feature("yaw_rate", -5, 5),
    Feature("ax", -25, 25),
    Feature("ay", -25, 25),
    Feature("sideslip", -np.pi, np.pi),
    Feature("vx_std", 0, 10),
    Feature("vy_std", 0, 10),
    Feature("yaw_rate_std", 0, 1),
)
COMMAND = (Feature("steer", -1, 1), Feature("reference_yaw_rate", -2, 2))
_RANGES = (25.0, 25.0, 6.0, 300.0, 300.0, 300.0, 300.0, 80.0, np.pi, 6.0)
HELD = tuple(  # 0 where not on board
    Feature(name, 0.0 if name == "speed" else -r, r) for name, r in zip(CHANNELS, _RANGES, strict=True)
)
VALID = tuple(Feature(f"{name}_valid", 0, 1) for name in CHANNELS)

LAYOUTS: dict[str, tuple[Feature, ...]] = {
    "estimate": MOTION + COMMAND,
    "truth": MOTION + COMMAND,
    "reading": HELD + VALID + COMMAND,
}


class View(NamedTuple):
    """What compiled code needs to make an observation."""

    reference: Reference  # what the driver is taken to want
    wheel_radius: float  # [m]
    low: Array  # limits of the features, (k,)
    high: Array


@compiled
def _finite(value):
    """An observation is finite whatever an estimator says; the drive has ended then."""
    if math.isnan(value):
        return 0.0
    return min(1e300, max(-1e300, value))


@compiled
def _clipped(view, vector):
    out = np.empty(vector.size, np.float32)
    for i in range(vector.size):
        out[i] = min(view.high[i], max(view.low[i], vector[i]))
    return out


@compiled
def see_motion(constants, memory, motion, spread, steer):
    """The observation of the layouts "estimate" and "truth".

    Args:
        constants: The View, held.
        memory: Reference yaw rate [rad/s] and envelope of |ay| [m/s2], (2,).
        motion: vx, vy, yaw rate, ax, ay, (5,).
        spread: Variances of the first three, (3,); NaN where unknown.
        steer: Road-wheel angle [rad].

    Returns:
        observation (11,) float32, and the memory one step on.
    """
    view = constants.value
    vector, after = np.empty(11), np.empty(2)
    for i in range(5):
        vector[i] = _finite(motion[i])
    vector[5] = math.atan2(vector[1], vector[0])
    for i in range(3):
        vector[6 + i] = math.sqrt(spread[i]) if spread[i] >= 0.0 else view.high[6 + i]
    after[0], after[1] = follow_reference(view.reference, memory[0], memory[1], vector[0], vector[4], steer)
    vector[9], vector[10] = steer, after[0]
    return _clipped(view, vector), after


@compiled
def see_readings(constants, memory, heard, y, steer):
    """The observation of the layout "reading"; its reference too comes from readings alone.

    Args:
        constants: The View, held.
        memory: As for :func:`see_motion`.
        heard: Last valid value of each channel, (10,).
        y: The newest reading, (10,), NaN where silent.
        steer: Road-wheel angle [rad].

    Returns:
        observation (22,) float32, and the memory one step on.
    """
    view = constants.value
    vector, after = np.empty(22), np.empty(2)
    for i in range(10):
        vector[i] = heard[i]
        vector[10 + i] = 0.0 if math.isnan(y[i]) else 1.0
    turning = heard[Y_WHEEL] + heard[Y_WHEEL + 1] + heard[Y_WHEEL + 2] + heard[Y_WHEEL + 3]
    speed = 0.25 * view.wheel_radius * turning
    after[0], after[1] = follow_reference(view.reference, memory[0], memory[1], speed, heard[Y_AY], steer)
    vector[20], vector[21] = steer, after[0]
    return _clipped(view, vector), after


class Encoder:
    """Turns what is known at one instant into an observation.

    Raises:
        ValueError: If there is no such layout.
    """

    def __init__(self, layout: str):
        if layout not in LAYOUTS:
            raise ValueError(f"observation must be one of {', '.join(LAYOUTS)}, not {layout!r}")
        self.layout = layout
        self.low = np.array([f.low for f in LAYOUTS[layout]], dtype=np.float32)
        self.high = np.array([f.high for f in LAYOUTS[layout]], dtype=np.float32)

    def view(self, nominal: Nominal) -> Any:
        """The View of a nominal car, held for compiled code."""
        limits = self.low.astype(float), self.high.astype(float)
        return hold(View(StabilityControl().reference(nominal), float(nominal.vehicle.wheel_radius), *limits))

    def encode(
        self, view: Any, memory: Array, estimate: Estimate, steer: float, reading: Reading, heard: Array
    ) -> tuple[NDArray[np.float32], Array]:
        """The observation, and the memory after it.

        Args:
            view: From :meth:`view`.
            memory: (2,), zeros before the first observation.
            estimate: What is believed of the car; for the layout "truth", what is so.
            steer: Road-wheel angle [rad].
            reading: The newest one.
            heard: Last valid value of each channel, (10,).
        """
        seen: tuple[NDArray[np.float32], Array]
        if self.layout == "reading":
            seen = see_readings(view, memory, heard, reading.y, steer)
        else:
            seen = see_motion(view, memory, np.array(estimate[:5]), estimate.cov.diagonal().copy(), steer)
        return seen


def heard_at_first(nominal: Nominal) -> Array:
    """What is taken for heard before a sensor has spoken, (10,): wheels that roll at the start speed, else nothing."""
    heard = np.zeros(len(CHANNELS))
    heard[WHEELS] = nominal.speed / nominal.vehicle.wheel_radius
    return heard
