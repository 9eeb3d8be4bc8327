"""What agents are trained on: rows side by side, as a single environment through CanonicalView."""

import gymnasium
import numpy as np
import pytest
from environments import SideBySide, Task, make_envs
from stable_baselines3.common.vec_env import DummyVecEnv

from vse_gym.wrappers import REWARD_SIZE, CanonicalView

from .conftest import Brief

TWO = ("vse_gym/HeldSteer-v0", "vse_gym/SineWithDwell-v0")


@pytest.mark.parametrize("estimator", [("ekf", "truth"), ("kinematic", "ekf")])  # compiled rows, and objects
def test_every_row_is_a_single_environment_through_the_wrapper(estimator):
    task = Brief(env=TWO, vehicle=("qin2014", "ford_escort"), estimator=estimator, controller="esc", duration=0.4)
    rows = make_envs(task, 4)
    rows.seed(11)
    seen = rows.reset()
    singles = [
        CanonicalView(gymnasium.make(name, vehicle=car, **task.settings)) for name in TWO for car in task.vehicle
    ]
    alone = [env.reset(seed=11 + i)[0] for i, env in enumerate(singles)]
    rng = np.random.default_rng(0)
    for step in range(40):
        np.testing.assert_allclose(seen, alone, atol=1e-5)
        actions = rng.uniform(-1, 1, (4, 4)).astype(np.float32)
        seen, rewards, dones, infos = rows.step(actions)
        alone, wanted, *_ = zip(*(env.step(a) for env, a in zip(singles, actions, strict=True)), strict=True)
        np.testing.assert_allclose(rewards, wanted, atol=1e-5)
        assert dones.all() == (step == 39)
    for last, info in zip(alone, infos, strict=True):
        np.testing.assert_allclose(info["terminal_observation"], last, atol=1e-5)
        assert info["episode"]["l"] == 40
        assert info["episode"]["r"] > max(wanted) * REWARD_SIZE  # as it is, not as the net sees it


def test_rows_are_compiled_where_they_can_be():
    native = make_envs(Brief(env=TWO, vehicle=("qin2014",)), 3)
    assert isinstance(native.venv, SideBySide)
    assert [part.num_envs for part in native.venv.parts] == [2, 1]
    single = make_envs(Brief(env=TWO[:1], vehicle=("qin2014",), estimator=("kinematic",)), 3)
    assert isinstance(single.venv.unwrapped, DummyVecEnv)


def test_fewer_rows_than_kinds_take_the_first():
    assert make_envs(Brief(env=TWO), 1).num_envs == 1


@pytest.mark.parametrize("layout", ["estimate", "reading", "truth"])
@pytest.mark.parametrize("action", ["brakes", "yaw_moment"])
def test_what_a_net_sees_lies_in_its_space(layout, action):
    rows = make_envs(Brief(env=TWO[:1], observation=layout, action=action, sensors=("loud",)), 4)
    rows.seed(0)
    seen = rows.reset()
    for _ in range(20):
        assert all(rows.observation_space.contains(row) for row in seen)
        seen, *_ = rows.step(np.ones((4, *rows.action_space.shape), np.float32))


WRONG = [
    ({"env": ("vse_gym/Moon-v0",)}, "known: vse_gym/SineWithDwell-v0"),
    ({"env": ()}, "env must be one name or several"),
    ({"estimator": ()}, "estimator must be one name or several"),
    ({"friction": (0.5, 0.2)}, "friction must be two positive numbers"),
    ({"speed_kmh": (0.0, 50.0)}, "speed_kmh must be two positive numbers"),
    ({"estimator": ("ekff",)}, "known: truth"),
    ({"sensors": ("perfect",)}, "known: clean"),
    ({"vehicle": ("beetle",)}, "known: bmw_320i"),
    ({"controller": "abs"}, "known: none"),
    ({"action": "steer"}, "brakes, yaw_moment"),
    ({"observation": "everything"}, "one of estimate"),
]


@pytest.mark.parametrize(("changes", "sentence"), WRONG, ids=lambda x: str(x) if isinstance(x, dict) else "")
def test_a_wrong_name_or_range_is_told_what_can_be(changes, sentence):
    with pytest.raises((KeyError, ValueError, TypeError), match=sentence):
        make_envs(Task(**changes), 2)
