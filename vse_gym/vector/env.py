"""The native vector environment: Gymnasium's face of many drives side by side."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from vse_gym.ending import ENDINGS
from vse_gym.env import StabilityControlEnv
from vse_gym.types import Array
from vse_gym.vector.drives import Drives, Flags
from vse_gym.vector.lanes import TABLE

REASONS = np.array(ENDINGS)
PLACES = [tuple(name.split(".")) for name in TABLE]  # of the columns in info


class StabilityControlVectorEnv(gymnasium.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], Any]):
    """n of :class:`StabilityControlEnv` with the same arguments, row i as the single one with the same seed.

    Rows whose drive is over are reset by the next step, whose action they ignore (Gymnasium's next-step autoreset).
    Compiled code drives double-track plants, this package's manoeuvres, ``truth`` and the filters of the Gaussian
    family, and controllers that ask for a yaw moment; everything else runs in ``vectorization_mode="sync"``.

    ``info`` holds arrays, a row each, under the single environment's keys; but for the reading, which the layout
    "reading" observes.

    Args:
        num_envs: How many rows.
        threads: How many threads share them; None: as many as cores, each with at least 128 rows.
        kwargs: Of :class:`StabilityControlEnv`.

    Raises:
        ValueError: If a block is not made for compiled rows; the message says which.
        UnknownNameError, TypeError: As for the single environment.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, threads: int | None = None, **kwargs: Any):
        single = StabilityControlEnv(**kwargs)
        self.drives = Drives(single, num_envs, threads)
        self.num_envs, self.render_mode = num_envs, None
        self.single_action_space, self.single_observation_space = single.action_space, single.observation_space
        self.action_space = batch_space(single.action_space, num_envs)
        self.observation_space = batch_space(single.observation_space, num_envs)
        self._over = np.zeros(num_envs, dtype=bool)
        self._every = np.ones(num_envs, dtype=bool)  # rows that have a key of info: all
        self._every.flags.writeable = False  # the same array in every info
        self._masks: dict[str, dict[str, Flags]] = {group: {} for group, _ in PLACES}
        for group, key in (*PLACES, ("estimate", "std")):
            self._masks[group][f"_{key}"] = self._every

    def reset(  # type: ignore[override]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start all drives; row i with seed + i, or with its own of a sequence."""
        seeds = self._seeds(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"reset needs {self.num_envs} seeds, one for each row, not {len(seeds)}")
        for i, own in enumerate(seeds):
            self.drives.start(i, own)
        self._over[:] = False
        return self.drives.all_of("observation"), self._info()

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], Array, Flags, Flags, dict[str, Any]]:
        """Drive on to the next readings.

        Raises:
            ValueError: If the actions have the wrong shape or are not finite.
        """
        values = np.ascontiguousarray(actions, dtype=float)
        if values.shape != self.action_space.shape or not np.isfinite(values).all():
            raise ValueError(f"actions must be finite and have the shape {self.action_space.shape}, not {actions!r}")
        self.drives.step(values, np.flatnonzero(self._over).tolist())
        terminated, truncated = self.drives.over()
        self._over = terminated | truncated
        return self.drives.all_of("observation"), self.drives.all_of("reward"), terminated, truncated, self._info()

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads go."""
        self.drives.close()

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        return list(seed)

    def _info(self) -> dict[str, Any]:
        columns, spread = self.drives.describe().T, self.drives.all_of("spread")
        info: dict[str, Any] = {name: dict(masks) for name, masks in self._masks.items()}
        for (group, key), column in zip(PLACES, columns, strict=True):
            info[group][key] = column
        spread[np.isnan(spread)] = np.inf
        info["estimate"]["std"] = np.sqrt(spread)
        every = info["_truth"] = info["_estimate"] = info["_errors"] = info["_metrics"] = self._every
        info["ended"], info["_ended"] = REASONS[self.drives.all_of("ended")], every
        return info
