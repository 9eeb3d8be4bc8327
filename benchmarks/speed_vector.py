"""How fast the native vector environment is: stepped, collected from by stable-baselines3, and trained on.

Rows share two threads here, so that these are times by the clock on the wall, waiting for other people included.
"""

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from speed_table import Row

NAME = "vse_gym/SineWithDwell-v0"
STEPS = {(64, "truth"): 250_000, (1024, "truth"): 400_000, (64, "ekf"): 120_000}  # to reach a second
WHOLE = 600  # control steps of a drive, so that every repeat holds as many resets as drives
ROWS, COLLECTED = 64, 64  # environments on both sides, and steps of each that a rollout collects
SETTINGS = {"estimator": "ekf", "controller": "esc"}


def stepped(repeats: int) -> Iterator[Row]:
    """env.step of all rows, resets included, with no agent."""
    for (rows, estimator), target in STEPS.items():
        env = gymnasium.make_vec(
            NAME, num_envs=rows, vectorization_mode="vector_entry_point", estimator=estimator, controller="esc"
        )
        env.reset(seed=0)
        actions = np.zeros(env.action_space.shape, np.float32)
        rates = [_rate(env, actions, rows) for _ in range(1 + repeats)][1:]
        env.close()
        yield Row(f"vector env.step, {rows} rows: sensors, {estimator}, esc", "steps/s", rates, target=target)


def _rate(env: Any, actions: Any, rows: int) -> float:
    start = time.perf_counter()
    for _ in range(WHOLE + 1):  # a step more: the reset
        env.step(actions)
    return rows * (WHOLE + 1) / (time.perf_counter() - start)


def collected(repeats: int) -> Iterator[Row]:
    """Rollouts that stable-baselines3's PPO collects, its policy included, and whole training, on both sides."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from vse_gym.vector.sb3 import StableBaselinesEnv

    sides = (
        StableBaselinesEnv(NAME, ROWS, **SETTINGS),
        DummyVecEnv([partial(gymnasium.make, NAME, **SETTINGS) for _ in range(ROWS)]),
    )
    models = [PPO("MlpPolicy", env, n_steps=COLLECTED, batch_size=1024, seed=0, device="cpu") for env in sides]
    for measure, what, target in ((_collecting, "collecting rollouts, PPO", 5.0), (_training, "training PPO", None)):
        rounds = [[measure(model) for model in models] for _ in range(1 + min(3, repeats))][1:]
        ours, theirs = (list(rates) for rates in zip(*rounds, strict=True))
        yield Row(f"{what}, {ROWS} rows", "steps/s", ours, "DummyVecEnv", theirs, target, of_ratio=True)
    for env in sides:
        env.close()


def _collecting(model: Any) -> float:
    _, callback = model._setup_learn(ROWS * COLLECTED, None, reset_num_timesteps=False)
    start = time.perf_counter()
    model.collect_rollouts(model.env, callback, model.rollout_buffer, COLLECTED)
    return ROWS * COLLECTED / (time.perf_counter() - start)


def _training(model: Any) -> float:
    start = time.perf_counter()
    model.learn(ROWS * COLLECTED, reset_num_timesteps=False)
    return ROWS * COLLECTED / (time.perf_counter() - start)
