"""What the tests of the agents' programs share: the programs as modules, short drives, and agents of random nets."""

import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))
environments, settings = import_module("environments"), import_module("settings")
export, segments = import_module("export"), import_module("segments")

TINY = {
    "ppo": {"policy": "MlpPolicy", "n_steps": 32, "batch_size": 64, "n_epochs": 2, "learning_rate": "lin_1e-3"},
    "recurrent_ppo": {"policy": "MlpLstmPolicy", "n_steps": 16, "batch_size": 32, "n_epochs": 1},
    "sac": {"policy": "MlpPolicy", "learning_starts": 60, "train_freq": 4, "gradient_steps": 4, "ent_coef": "auto_0.1"}
    | {"n_steps": 3, "hold": 2, "worst": -1.0},
    "td3": {"policy": "MlpPolicy", "learning_starts": 60, "train_freq": 4, "gradient_steps": 4, "noise_type": "normal"},
}
NETS = {name: {"net_arch": [8]} for name in TINY} | {"recurrent_ppo": {"net_arch": [8], "lstm_hidden_size": 4}}
BUFFERS = {"batch_size": 16, "buffer_size": 300}


@dataclass(frozen=True)
class Brief(environments.Task):
    """Drives of a second or so."""

    duration: float = 0.6

    @property
    def settings(self):
        return super().settings | {"duration": self.duration}


def tiny(algorithm, segments=3):
    """Settings with which an algorithm learns nothing, quickly."""
    own = TINY[algorithm] | {"policy_kwargs": NETS[algorithm], "n_envs": 4, "n_timesteps": 1, "segments": segments}
    return own | (BUFFERS if algorithm in ("sac", "td3") else {})


@pytest.fixture(scope="session")
def untrained():
    """A model of each algorithm and kind of action that has learned nothing."""

    def make(algorithm, action="brakes", observation="estimate"):
        task = Brief(env=("vse_gym/HeldSteer-v0",), action=action, observation=observation)
        return settings.make(algorithm, tiny(algorithm), environments.make_envs(task, 4), seed=3)

    return make


@pytest.fixture(scope="session")
def agent(untrained, tmp_path_factory):
    """The folder of an agent with a random net that answers loudly."""
    model = untrained("ppo")
    generator = np.random.default_rng(0)
    for parameter in model.policy.parameters():
        parameter.data += 0.7 * parameter.data.new_tensor(generator.normal(size=tuple(parameter.shape)))
    folder = tmp_path_factory.mktemp("agents") / "random"
    view = {"observation": "estimate", "action": "brakes", "controller": "esc"}
    export.write_agent(folder, "ppo", model, view, {"task": {"estimator": ["ukf"]}}, {})
    return folder
