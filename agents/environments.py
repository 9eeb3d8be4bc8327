"""What an agent is trained on: a task, and the environments that draw its drives."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

import vse_gym
from vse_gym.controllers.canonical import REACH, all_from_canonical, all_to_canonical, held_canonical
from vse_gym.randomise import Randomise
from vse_gym.wrappers import REWARD_SIZE

SOME = ("ekf", "ukf", "ekf_double_track", "kinematic", "zero", "truth")  # --estimator random: good, bad and perfect
KMH = 1 / 3.6


@dataclass(frozen=True)
class Task:
    """Who drives what: each row of the environments has one manoeuvre on one car, all else is drawn at every reset.

    Raises:
        ValueError: If a range is reversed or not positive.
    """

    env: tuple[str, ...]  # ids
    estimator: tuple[str, ...] = ("ukf",)
    sensors: tuple[str, ...] = ("gaussian", "loud", "biased", "outliers")
    vehicle: tuple[str, ...] = ("qin2014", "ford_escort")  # no table's cars
    controller: str = "none"
    action: str = "brakes"
    observation: str = "estimate"
    friction: tuple[float, float] = (0.2, 1.0)
    speed_kmh: tuple[float, float] = (55.0, 85.0)
    steer: float = 0.3  # +/-, relative; and the side
    mass: tuple[float, float] = (1.0, 1.25)
    stiffness: tuple[float, float] = (0.75, 1.0)

    def __post_init__(self) -> None:
        for name in ("friction", "speed_kmh"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must be two positive numbers, the lower first, not {low} and {high}")

    def settings(self) -> dict[str, Any]:
        """Arguments of an environment, but for its car."""
        (slippery, grippy), (slow, fast) = self.friction, self.speed_kmh
        random = Randomise(
            speed=(fast - slow) / 2 * KMH,
            steer=self.steer,
            friction=(grippy - slippery) / 2,
            mass=self.mass,
            stiffness=self.stiffness,
        )
        return {
            "estimator": self.estimator if len(self.estimator) > 1 else self.estimator[0],
            "sensors": self.sensors if len(self.sensors) > 1 else self.sensors[0],
            "controller": self.controller,
            "action": self.action,
            "observation": self.observation,
            "friction": (slippery + grippy) / 2,
            "speed": (slow + fast) / 2 * KMH,
            "randomise": random,
        }


def make_envs(task: Task, num_envs: int) -> VecEnv:
    """Environments of a task as a net sees them: manoeuvres and cars take turns among the rows.

    Raises:
        UnknownNameError, ValueError, TypeError: If a name or a range cannot be; the message says what can.
    """
    kinds = [(name, car) for car in task.vehicle for name in task.env]
    known = ", ".join(vse_gym.env.IDS)
    if wrong := [name for name in task.env if name not in vse_gym.env.IDS]:
        raise ValueError(f"there is no environment {wrong[0]!r}; known: {known}")
    makers = [_maker(*kinds[row % len(kinds)], task.settings()) for row in range(num_envs)]
    return AsSeen(VecMonitor(DummyVecEnv(makers)), task)


def _maker(name: str, car: str, settings: dict[str, Any]) -> Callable[[], gymnasium.Env[Any, Any]]:
    return lambda: gymnasium.make(name, vehicle=car, **settings)


class AsSeen(VecEnvWrapper):
    """Many environments through :mod:`vse_gym.controllers.canonical`, as CanonicalView does with one."""

    def __init__(self, venv: VecEnv, task: Task):
        assert isinstance(venv.observation_space, spaces.Box)
        seen = spaces.Box(-REACH, REACH, venv.observation_space.shape, np.float32)
        super().__init__(venv, observation_space=seen)
        self._form = held_canonical(task.observation, task.action)

    def reset(self) -> Any:
        seen, self._side, self._counts = all_to_canonical(self._form, self.venv.reset())
        return seen

    def step_async(self, actions: Any) -> None:
        turned = np.asarray(actions, dtype=np.float32)
        self.venv.step_async(all_from_canonical(self._form, turned, self._side, self._counts))

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = self.venv.step_wait()
        seen, self._side, self._counts = all_to_canonical(self._form, observations)
        for row in np.flatnonzero(dones):
            last = infos[row]["terminal_observation"]
            infos[row]["terminal_observation"] = all_to_canonical(self._form, last[None])[0][0]
        return seen, rewards / REWARD_SIZE, dones, infos
