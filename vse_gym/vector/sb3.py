"""The native vector environment as stable-baselines3 has it; needs the extra [rl]."""

from collections.abc import Sequence
from time import monotonic
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from vse_gym.env import IDS, StabilityControlEnv
from vse_gym.registry import UnknownNameError
from vse_gym.types import Array
from vse_gym.vector.drives import Drives


class StableBaselinesEnv(VecEnv):
    """n rows of an environment, for the algorithms of stable-baselines3.

    A row whose drive is over is reset in the same step; its last observation, and what a Monitor would have noted of
    its episode, are in its info. Infos hold nothing else: an agent needs none, and they would cost more than the drive.

    Args:
        name: An id of this package, "vse_gym/DoubleLaneChange-v0".
        num_envs: How many rows.
        threads: How many threads share them; None: as many as cores, each with at least 128 rows.
        kwargs: Of :class:`StabilityControlEnv`.

    Raises:
        UnknownNameError: If there is no such id, or a name in the arguments is not known.
        ValueError: If a block is not made for compiled rows; the message says which.
    """

    actions: Array

    def __init__(self, name: str, num_envs: int, threads: int | None = None, **kwargs: Any):
        if name not in IDS:
            raise UnknownNameError(f"no environment named {name!r}; known: {', '.join(IDS)}")
        self.single = StabilityControlEnv(IDS[name], **kwargs)
        self.drives = Drives(self.single, num_envs, threads)
        self._returns, self._lengths = np.zeros(num_envs), np.zeros(num_envs, dtype=int)
        self._begin = monotonic()
        super().__init__(num_envs, self.single.observation_space, self.single.action_space)

    def reset(self) -> NDArray[np.float32]:
        """Start all drives, with the seeds that ``seed`` has set aside."""
        for i, seed in enumerate(self._seeds):
            self.drives.start(i, seed)
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self.drives.all_of("observation")

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take note of what the agent does."""
        self.actions = np.ascontiguousarray(actions, dtype=float)

    def step_wait(self) -> VecEnvStepReturn:
        """Drive on to the next readings.

        Raises:
            ValueError: If the actions have the wrong shape or are not finite.
        """
        wanted = (self.num_envs, *(self.single.action_space.shape or ()))
        if self.actions.shape != wanted or not np.isfinite(self.actions).all():
            raise ValueError(f"actions must be finite and have the shape {wanted}, not {self.actions!r}")
        drives = self.drives
        drives.step(self.actions)
        observation, reward = drives.all_of("observation"), drives.all_of("reward")
        terminated, truncated = drives.over()
        self._returns += reward
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        over = np.flatnonzero(terminated | truncated)
        for i in over.tolist():
            episode = {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": monotonic() - self._begin}
            infos[i] |= {"terminal_observation": observation[i].copy(), "episode": episode}
            infos[i] |= {"TimeLimit.truncated": bool(truncated[i])}
            drives.start(i)
            self._returns[i], self._lengths[i] = 0.0, 0
        if over.size:
            observation = drives.all_of("observation")
        return observation, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Let the threads go."""
        self.drives.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Of the environment that each row is."""
        return [getattr(self.single, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: rows have no attributes of their own.

        Raises:
            AttributeError: Always.
        """
        raise AttributeError(f"{attr_name} cannot be set: give it to the constructor, for all rows")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Refused: rows are not objects.

        Raises:
            AttributeError: Always.
        """
        raise AttributeError(f"{method_name} cannot be called on rows; they are arrays, see .drives")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Nothing is; but what a Monitor notes of an episode is noted here."""
        return [issubclass(wrapper_class, Monitor)] * len(self._rows(indices))

    def _rows(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))
