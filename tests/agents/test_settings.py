"""Hyper-parameters: ours and rl_zoo3's are the same, and a wrong one is told what there is."""

import importlib
import inspect
from pathlib import Path

import pytest
import yaml
from settings import FOLDER, KNOWN, VIEW, make, rate, read

from vse_gym.env import IDS

ZOO = ("env_wrapper",)  # what a zoo's file must say and ours need not


@pytest.mark.parametrize("algorithm", KNOWN)
def test_the_zoo_s_file_says_the_same_of_every_environment(algorithm):
    zoo = yaml.safe_load((FOLDER / f"{algorithm}.yml").read_text())
    ours = {key: value for key, value in read(algorithm).items() if key != "segments"}
    assert zoo.keys() == IDS.keys()
    for theirs in zoo.values():
        _, view = wrapper(theirs)
        assert {key: value for key, value in theirs.items() if key not in ZOO} | view == ours


def wrapper(theirs):
    """What a zoo's file wraps the environment in, and with which arguments."""
    (one,) = theirs["env_wrapper"] if isinstance(theirs["env_wrapper"], list) else [theirs["env_wrapper"]]
    return next(iter(one.items())) if isinstance(one, dict) else (one, {})


@pytest.mark.parametrize("algorithm", KNOWN)
def test_the_zoo_s_wrapper_is_there(algorithm):
    name, view = wrapper(yaml.safe_load((FOLDER / f"{algorithm}.yml").read_text())["vse_gym/HeldSteer-v0"])
    module, _, kind = name.rpartition(".")
    found = getattr(importlib.import_module(module), kind)
    assert found.__name__ == "CanonicalView"
    assert view.keys() <= VIEW.keys() <= inspect.signature(found.__init__).parameters.keys()


@pytest.mark.parametrize("algorithm", KNOWN)
def test_what_is_known_the_algorithm_takes(algorithm, untrained):
    from settings import ALGORITHMS, OURS

    own = set(KNOWN[algorithm]) - set(OURS) - set(VIEW) - {"noise_type", "noise_std"}
    assert own <= inspect.signature(ALGORITHMS[algorithm].__init__).parameters.keys()
    model = untrained(algorithm)
    assert (model.__dict__.get("action_noise") is not None) == (algorithm == "td3")


def written(tmp_path, text):
    path = Path(tmp_path) / "mine.toml"
    path.write_text("n_envs = 2\nn_timesteps = 10\nsegments = 1\n" + text)
    return path


WRONG = [
    ("learning_rat = 1e-3", "ppo has no setting learning_rat; known: n_envs"),
    ('batch_size = "big"', "batch_size must be a whole number"),
    ('learning_rate = "quick"', "a rate is a number"),
    ("tau = 0.1", "ppo has no setting tau"),
    ("hold = 0", "hold must be at least 1, not 0"),
]


@pytest.mark.parametrize(("text", "sentence"), WRONG)
def test_a_wrong_setting_is_told_what_there_is(text, sentence, tmp_path):
    with pytest.raises((TypeError, ValueError), match=sentence):
        read("ppo", written(tmp_path, text))


def test_a_setting_that_lacks_and_an_algorithm_that_is_none(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("n_envs = 2")
    with pytest.raises(TypeError, match="it lacks n_timesteps"):
        read("ppo", path)
    with pytest.raises(ValueError, match="known: ppo, recurrent_ppo, sac, td3"):
        read("a2c")


def test_a_rate_falls_or_stays():
    assert rate(0.5, 0.75) == 0.5
    assert rate("lin_0.5", 0.75) == 0.125


def test_noise_of_another_kind_is_refused(untrained):
    env = untrained("td3").get_env()
    with pytest.raises(ValueError, match="must be normal"):
        make("td3", {"policy": "MlpPolicy", "noise_type": "ornstein-uhlenbeck"}, env, 0)
