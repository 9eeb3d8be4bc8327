"""Rows as stable-baselines3 has them, against its own loop over single environments."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [rl]")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from vse_gym.registry import UnknownNameError
from vse_gym.vector.sb3 import StableBaselinesEnv

STEER = "vse_gym/HeldSteer-v0"


def test_rows_are_what_its_own_loop_over_single_environments_is():
    settings = {"controller": "esc", "sensors": "loud", "duration": 0.6}
    mine = StableBaselinesEnv(STEER, 3, **settings)
    its = DummyVecEnv([lambda: Monitor(gymnasium.make(STEER, **settings)) for _ in range(3)])
    for env in (mine, its):
        env.seed(7)
    np.testing.assert_array_equal(mine.reset(), its.reset())
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(150):
        actions = rng.uniform(-1, 1, (3, 4)).astype(np.float32)
        got, expected = mine.step(actions), its.step(actions)
        for a, b in zip(got[:3], expected[:3], strict=True):
            np.testing.assert_array_equal(a, b)
        for info, told in zip(got[3], expected[3], strict=True):
            if "terminal_observation" in told:
                ended += 1
                np.testing.assert_array_equal(info["terminal_observation"], told["terminal_observation"])
                assert info["TimeLimit.truncated"] == told["TimeLimit.truncated"]
                assert info["episode"]["l"] == told["episode"]["l"]
                assert info["episode"]["r"] == pytest.approx(told["episode"]["r"], abs=1e-5)  # the Monitor rounds
            else:
                assert info == {}
    assert ended == 6
    mine.close()


def test_its_algorithms_learn_and_evaluate_on_it():
    env = StableBaselinesEnv(STEER, 4, duration=0.5, estimator="truth")
    model = PPO("MlpPolicy", env, n_steps=50, batch_size=50, n_epochs=1, seed=0, device="cpu")
    model.learn(400)
    assert len(model.ep_info_buffer) == 8
    mean, _ = evaluate_policy(model, env, n_eval_episodes=4)
    assert -50 <= mean <= 50
    env.close()


def test_wrong_calls_are_told_what_can_be():
    with pytest.raises(UnknownNameError, match="no environment named 'CartPole-v1'; known: vse_gym/SineWithDwell-v0"):
        StableBaselinesEnv("CartPole-v1", 2)
    env = StableBaselinesEnv(STEER, 2)
    assert env.get_attr("action_kind") == ["brakes", "brakes"]
    assert env.get_attr("action_kind", indices=0) == ["brakes"]
    with pytest.raises(AttributeError, match="give it to the constructor"):
        env.set_attr("action_kind", "yaw_moment")
    with pytest.raises(AttributeError, match="cannot be called on rows"):
        env.env_method("reset")
    with pytest.raises(ValueError, match=r"finite and have the shape \(2, 4\)"):
        env.step(np.zeros((3, 4), np.float32))
