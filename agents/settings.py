"""Hyper-parameters: a TOML file for each algorithm, with the names that they have in rl_zoo3's YAML, and their meaning.

But for a rate that falls: here it does so from segment to segment.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise

from vse_gym.schema import check

FOLDER = Path(__file__).parent / "settings"
ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC, "td3": TD3, "recurrent_ppo": RecurrentPPO}
RATES = ("learning_rate", "clip_range")  # a number, or "lin_" and the number from which it falls to zero

OURS: dict[str, Any] = {"n_envs": int, "n_timesteps": int, "segments": int}  # of the run, not of the algorithm
VIEW: dict[str, Any] = {"hold": int, "worst": float}  # of CanonicalView, where they differ from its defaults
ALL: dict[str, Any] = {
    **OURS,
    **VIEW,
    "policy": str,
    "policy_kwargs": Mapping[str, Any],
    "learning_rate": "a rate",
    "batch_size": int,
    "gamma": float,
}
ON_POLICY: dict[str, Any] = {
    **ALL,
    **dict.fromkeys(("n_steps", "n_epochs"), int),
    **dict.fromkeys(("gae_lambda", "ent_coef", "vf_coef", "max_grad_norm", "target_kl"), float),
    "clip_range": "a rate",
}
OFF_POLICY: dict[str, Any] = {
    **ALL,
    **dict.fromkeys(("buffer_size", "learning_starts", "train_freq", "gradient_steps", "n_steps"), int),
    "tau": float,
}
KNOWN: dict[str, dict[str, Any]] = {
    "ppo": ON_POLICY,
    "recurrent_ppo": ON_POLICY,
    "sac": {**OFF_POLICY, "ent_coef": str, "target_entropy": float},  # "auto_0.1": found, from there on
    "td3": {
        **OFF_POLICY,
        "policy_delay": int,
        **dict.fromkeys(("target_policy_noise", "target_noise_clip", "noise_std"), float),
        "noise_type": str,
    },
}


def read(algorithm: str, path: Path | None = None) -> dict[str, Any]:
    """Settings of an algorithm; without a file its own.

    Raises:
        ValueError, TypeError: If there is no such algorithm, or a setting does not exist, lacks or is of another kind.
    """
    if algorithm not in KNOWN:
        raise ValueError(f"no algorithm named {algorithm!r}; known: {', '.join(KNOWN)}")
    file = path or FOLDER / f"{algorithm}.toml"
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    try:
        check(table, KNOWN[algorithm], needed=OURS, refusal=f"{algorithm} has no setting")
        for name in RATES:
            if name in table:
                rate(table[name], 0.0)
        for name in (*OURS, "hold"):
            if table.get(name, 1) < 1:
                raise ValueError(f"{name} must be at least 1, not {table[name]}")
    except (TypeError, ValueError) as error:
        raise type(error)(f"{file}: {error}") from None
    return table


def rate(written: Any, done: float) -> float:
    """What a rate is when a share of the run is done.

    Raises:
        ValueError: If it is neither a number nor "lin_" and one.
    """
    number = str(written).removeprefix("lin_")
    try:
        value = float(number)
    except ValueError:
        raise ValueError(f'a rate is a number or "lin_3e-4", which falls to zero, not {written!r}') from None
    return value * (1 - done) if isinstance(written, str) and written.startswith("lin_") else value


def make(algorithm: str, settings: Mapping[str, Any], env: Any, seed: int) -> Any:
    """A model that has learned nothing yet."""
    wanted = {name: value for name, value in settings.items() if name not in OURS and name not in VIEW}
    wanted |= {name: rate(wanted[name], 0.0) for name in RATES if name in wanted}
    kind, spread = wanted.pop("noise_type", None), wanted.pop("noise_std", 0.1)
    if kind not in (None, "normal"):
        raise ValueError(f"noise_type must be normal, not {kind!r}")
    if kind:
        actions = env.action_space.shape[0]
        wanted["action_noise"] = NormalActionNoise(np.zeros(actions), np.full(actions, spread))
    return ALGORITHMS[algorithm](env=env, seed=seed, device="cpu", **wanted)
