"""A single environment as a net sees it."""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.controllers.canonical import REACH, from_canonical, held_canonical, to_canonical
from vse_gym.env import StabilityControlEnv

REWARD_SIZE = 10.0  # rewards are divided by it: values are of order ten, an early end's too


@compiled
def _to(held, observation):
    return to_canonical(held.value, observation)


@compiled
def _from(held, answer, side, counts):
    return from_canonical(held.value, answer, side, counts)


class CanonicalView(gymnasium.Wrapper[NDArray[np.float32], NDArray[np.float32], Any, Any]):
    """Observations in typical sizes and from one side, asleep going straight: :mod:`vse_gym.controllers.canonical`.

    What agents are trained through; :class:`vse_gym.policy.TrainedPolicy` sees and acts as through one that holds no
    answer. Rewards are divided by ``REWARD_SIZE``.

    Args:
        env: A :class:`vse_gym.env.StabilityControlEnv`.
        hold: Steps that an answer is held for, and whose rewards it earns. A brake is too slow for what is drawn anew
            every 10 ms, so nothing would be explored; and one such step is worth too little to be told from noise.
        worst: The least reward of a step, in these units. An early end costs its whole rest at once, and a critic that
            learns from few steps hears little else.

    Raises:
        TypeError: If it wraps another environment.
        ValueError: If hold is less than 1.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], hold: int = 1, worst: float = -math.inf):
        super().__init__(env)
        if hold < 1:
            raise ValueError(f"hold must be a number of steps from 1 on, not {hold!r}")
        self._hold, self._worst = hold, worst
        inner = env.unwrapped
        if not isinstance(inner, StabilityControlEnv):
            raise TypeError(f"CanonicalView wraps a StabilityControlEnv, not {type(inner).__name__}")
        self._form = held_canonical(inner.encoder.layout, inner.action_kind)
        self.observation_space = spaces.Box(-REACH, REACH, inner.observation_space.shape, np.float32)

    def _seen(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen: NDArray[np.float32]
        seen, self._side, self._counts = _to(self._form, observation)
        return seen

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start a drive."""
        observation, info = self.env.reset(**options)
        return self._seen(observation), info

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drive on, to the next reading or so many as an answer is held for."""
        answer, total = np.asarray(action, dtype=np.float32), 0.0
        for _ in range(self._hold):
            turned = _from(self._form, answer, self._side, self._counts)
            observation, reward, terminated, truncated, info = self.env.step(turned)
            seen = self._seen(observation)
            total += max(self._worst, float(reward) / REWARD_SIZE)
            if terminated or truncated:
                break
        return seen, total, terminated, truncated, info
