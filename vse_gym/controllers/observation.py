"""What an agent sees: one place for the environment and for a trained policy.

Every observation is a float32 vector in SI units, clipped to finite limits (``gymnasium.wrappers.RescaleObservation``
maps them to [-1, 1]). A standard deviation that an estimator does not give stands at its limit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.types import CHANNELS, Array, Estimate, Reading


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

    def encode(
        self, estimate: Estimate, steer: float, reading: Reading, heard: Array, reference: float
    ) -> NDArray[np.float32]:
        """The observation.

        Args:
            estimate: What is believed of the car; for the layout "truth", what is so.
            steer: Road-wheel angle [rad].
            reading: The newest one.
            heard: Last valid value of each channel, (10,).
            reference: Yaw rate that the driver is taken to want [rad/s].
        """
        command = [steer, reference]
        if self.layout == "reading":
            valid = (reading.y == reading.y).tolist()
            vector = np.array(heard.tolist() + valid + command)
        else:
            vx, vy, yaw_rate, ax, ay = estimate[:5]
            variances = np.sqrt(estimate.cov.diagonal()).tolist()
            spread = [s if s == s else f.high for s, f in zip(variances, MOTION[6:9], strict=True)]
            vector = np.array([vx, vy, yaw_rate, ax, ay, estimate.sideslip, *spread, *command])
        clipped: NDArray[np.float32] = np.minimum(np.maximum(vector, self.low), self.high).astype(np.float32)
        return clipped
