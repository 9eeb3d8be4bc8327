"""The native vector environment: Gymnasium's face of many drives side by side."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from vse_gym.ending import ENDINGS
from vse_gym.env import StabilityControlEnv
from vse_gym.types import Array
from vse_gym.vector.drives import Drives, Flags
from vse_gym.vector.lanes import TABLE

REASONS = np.array(ENDINGS)


class StabilityControlVectorEnv(gymnasium.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], Any]):
    """n of :class:`StabilityControlEnv` with the same arguments, row i as the single one with the same seed.

    Rows whose drive is over are reset by the next step, whose action they ignore (Gymnasium's next-step autoreset).
    Compiled code drives double-track plants, this package's manoeuvres, ``truth`` and the filters of the Gaussian
    family, and controllers that ask for a yaw moment; everything else runs in ``vectorization_mode="sync"``.

    ``info`` holds arrays, a row each, under the single environment's keys; but for the reading, which the layout
    "reading" observes.

    Args:
        num_envs: How many rows.
        threads: How many threads share them; None: as many as cores, each with at least 16 rows.
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
        self._generators: list[np.random.Generator] = []
        self._over = np.zeros(num_envs, dtype=bool)

    def reset(  # type: ignore[override]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start all drives; row i with seed + i, or with its own of a sequence."""
        seeds = self._seeds(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"reset needs {self.num_envs} seeds, one for each row, not {len(seeds)}")
        if not self._generators:
            self._generators = [seeding.np_random(None)[0] for _ in seeds]
        for i, own in enumerate(seeds):
            if own is not None:
                self._generators[i] = seeding.np_random(own)[0]
            self.drives.start(i, self._drive(i) if own is None else own)
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
        again = np.flatnonzero(self._over)
        self.drives.step(values, self._over if again.size else None)
        for i in again:
            self.drives.start(int(i), self._drive(int(i)))
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

    def _drive(self, i: int) -> int:
        """The seed of row i's next drive."""
        return int(self._generators[i].integers(2**62))

    def _info(self) -> dict[str, Any]:
        table, every = self.drives.describe(), np.ones(self.num_envs, dtype=bool)
        spread = np.concatenate([rows.lanes.spread for rows in self.drives.parts])
        info: dict[str, Any] = {}
        for name, column in zip(TABLE, table.T, strict=True):
            group, key = name.split(".")
            if group not in info:
                info[group], info[f"_{group}"] = {}, every
            info[group][key], info[group][f"_{key}"] = column, every
        with np.errstate(invalid="ignore"):
            info["estimate"]["std"] = np.where(np.isnan(spread), np.inf, np.sqrt(spread))
        info["estimate"]["_std"] = every
        info["ended"], info["_ended"] = REASONS[self.drives.all_of("ended")], every
        return info
