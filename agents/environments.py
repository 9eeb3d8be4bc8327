"""What an agent is trained on: a task, and the environments that draw its drives."""

import math
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from vse_gym.controllers.canonical import REACH, all_from_canonical, all_to_canonical, held_canonical
from vse_gym.env import IDS
from vse_gym.randomise import Randomise
from vse_gym.registry import UnknownNameError
from vse_gym.vector.sb3 import StableBaselinesEnv
from vse_gym.wrappers import REWARD_SIZE

SOME = ("ekf", "ukf", "ekf_double_track", "ekf_cauchy_gaussian", "truth")  # --estimator random: good, bad and perfect
HELD_CARS, HELD_SENSORS = ("vw_vanagon", "tian2018_electric"), ("cauchy_gaussian", "dropout")
KMH = 1 / 3.6


@dataclass(frozen=True)
class Task:
    """Who drives what: each row of the environments has one manoeuvre and one car, all else is drawn at every reset.

    Raises:
        ValueError: If there is nothing to draw from, or a range is reversed or not positive.
    """

    env: tuple[str, ...] = ("vse_gym/DoubleLaneChange-v0",)  # ids
    estimator: tuple[str, ...] = ("ukf",)
    sensors: tuple[str, ...] = ("gaussian", "loud", "biased", "outliers")
    vehicle: tuple[str, ...] = ("qin2014", "ford_escort", "wei2019_roll")  # none of the headline's
    controller: str = "none"
    action: str = "brakes"
    observation: str = "estimate"
    friction: tuple[float, float] = (0.2, 1.0)
    speed_kmh: tuple[float, float] = (55.0, 85.0)
    steer: float = 0.3  # +/- of the hand wheel's amplitude, relative; and the side [-]
    mass: tuple[float, float] = (1.0, 1.25)  # times
    stiffness: tuple[float, float] = (0.75, 1.0)  # times

    def __post_init__(self) -> None:
        for name in ("env", "estimator", "sensors", "vehicle"):
            if not getattr(self, name):
                raise ValueError(f"{name} must be one name or several, not none")
        for name in ("friction", "speed_kmh", "mass", "stiffness"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must be two positive numbers, the lower first, not {low} and {high}")
        for name in self.env:
            if name not in IDS:
                raise UnknownNameError(f"no environment named {name!r}; known: {', '.join(IDS)}")

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of an environment, but for its car."""
        (slippery, grippy), (slow, fast) = self.friction, self.speed_kmh
        half_speed, half_friction = (fast - slow) / 2 * KMH, (grippy - slippery) / 2
        ranges = (half_speed, self.steer, half_friction, self.mass, self.stiffness)
        return {
            "estimator": self.estimator,
            "sensors": self.sensors,
            "controller": self.controller,
            "action": self.action,
            "observation": self.observation,
            "friction": (slippery + grippy) / 2,
            "speed": (slow + fast) / 2 * KMH,
            "randomise": Randomise(*ranges),
        }

    @property
    def table(self) -> dict[str, Any]:
        """As a card writes it."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def held_out(task: Task) -> Task:
    """The same drives on other cars, none of the headline's either, and with other sensors.

    Raises:
        ValueError: If the task leaves none.
    """
    cars = tuple(car for car in HELD_CARS if car not in task.vehicle)
    suites = tuple(suite for suite in HELD_SENSORS if suite not in task.sensors)
    if not cars or not suites:
        raise ValueError(
            f"agents are judged with {', '.join(HELD_CARS)} and {', '.join(HELD_SENSORS)}: train without some"
        )
    return replace(task, vehicle=cars, sensors=suites)


def make_envs(task: Task, num_envs: int, hold: int = 1, worst: float = -math.inf) -> VecEnv:
    """Environments of a task as a net sees them; manoeuvres and cars share the rows.

    Compiled rows where all blocks are made for them, else one object for each.

    Args:
        task: What is driven.
        num_envs: How many rows.
        hold, worst: As :class:`vse_gym.wrappers.CanonicalView` has them.

    Raises:
        UnknownNameError, ValueError, TypeError: If a name or a number cannot be; the message says what can.
    """
    kinds = list(product(task.env, task.vehicle))[:num_envs]
    shares = np.diff(np.linspace(0, num_envs, len(kinds) + 1).round().astype(int)).tolist()
    parts = [_rows(name, car, task.settings, rows) for (name, car), rows in zip(kinds, shares, strict=True)]
    return AsSeen(parts[0] if len(parts) == 1 else SideBySide(parts), task, hold, worst)


def _rows(name: str, car: str, settings: dict[str, Any], rows: int) -> VecEnv:
    try:
        return StableBaselinesEnv(name, rows, vehicle=car, **settings)
    except UnknownNameError:
        raise
    except ValueError:  # a block that is not made for compiled rows, or one that the single environment refuses too
        one = lambda: gymnasium.make(name, vehicle=car, disable_env_checker=True, **settings)  # noqa: E731
        return VecMonitor(DummyVecEnv([one] * rows))


class SideBySide(VecEnv):
    """Several vector environments of one kind of observation and action as one."""

    def __init__(self, parts: list[VecEnv]):
        self.parts = parts
        edges = np.cumsum([0, *(part.num_envs for part in parts)])
        self._slices = [slice(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
        super().__init__(int(edges[-1]), parts[0].observation_space, parts[0].action_space)

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Of row i seed + i."""
        seeds: list[int | None] = []
        for part, rows in zip(self.parts, self._slices, strict=True):
            seeds += part.seed(None if seed is None else seed + rows.start)
        return seeds

    def reset(self) -> NDArray[np.float32]:
        return np.concatenate([part.reset() for part in self.parts])

    def step_async(self, actions: NDArray[np.float32]) -> None:
        for part, rows in zip(self.parts, self._slices, strict=True):
            part.step_async(actions[rows])

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = zip(*(part.step_wait() for part in self.parts), strict=True)
        told = [info for part in infos for info in part]
        return np.concatenate(observations), np.concatenate(rewards), np.concatenate(dones), told

    def close(self) -> None:
        for part in self.parts:
            part.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        every = [value for part in self.parts for value in part.get_attr(attr_name)]
        return [every[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        for part in self.parts:
            part.set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        every = [value for part in self.parts for value in part.env_method(method_name, *args, **kwargs)]
        return [every[i] for i in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        every = [wrapped for part in self.parts for wrapped in part.env_is_wrapped(wrapper_class)]
        return [every[i] for i in self._get_indices(indices)]


class AsSeen(VecEnvWrapper):
    """Many environments through :mod:`vse_gym.controllers.canonical`, as CanonicalView does with one.

    Where a drive ends while an answer is held, the next one goes through the rest without an answer.
    """

    def __init__(self, venv: VecEnv, task: Task, hold: int = 1, worst: float = -math.inf):
        seen = spaces.Box(-REACH, REACH, venv.observation_space.shape, np.float32)
        super().__init__(venv, observation_space=seen)
        if hold < 1:
            raise ValueError(f"hold must be a number of steps from 1 on, not {hold!r}")
        self._form, self._hold, self._worst = held_canonical(task.observation, task.action), hold, worst

    def reset(self) -> NDArray[np.float32]:
        seen: NDArray[np.float32]
        seen, self._side, self._counts = all_to_canonical(self._form, self.venv.reset())
        return seen

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._answers = np.ascontiguousarray(actions, dtype=np.float32)

    def step_wait(self) -> VecEnvStepReturn:
        total, over = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, dtype=bool)
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for _ in range(self._hold):
            turned = all_from_canonical(self._form, self._answers, self._side, self._counts)
            turned[over] = 0.0
            observations, rewards, dones, infos = self.venv.step(turned)
            seen, self._side, self._counts = all_to_canonical(self._form, observations)
            for row in np.flatnonzero(dones & ~over):
                last = infos[row]["terminal_observation"]
                told[row] = infos[row] | {"terminal_observation": all_to_canonical(self._form, last[None])[0][0]}
            total += np.where(over, 0.0, np.maximum(rewards / REWARD_SIZE, self._worst))
            over |= dones
        return seen, total, over, told
