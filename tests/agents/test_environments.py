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


def test_an_answer_is_held_and_earns_what_the_steps_do():
    """As the single environment does, until a drive is over; a steady answer drives the same car either way."""
    task = Brief(env=TWO[:1], vehicle=("qin2014",), estimator=("ekf",), controller="esc", duration=0.38)
    rows, single = make_envs(task, 1, hold=5), gymnasium.make(TWO[0], vehicle="qin2014", **task.settings)
    one, each = CanonicalView(single, hold=5), make_envs(task, 1)
    for env in (rows, each):
        env.seed(3)
        env.reset()
    one.reset(seed=3)
    answer = np.array([[0.2, 0.0, -0.1, 0.4]], np.float32)
    for block in range(8):
        seen, reward, done, infos = rows.step(answer)
        alone, wanted, terminated, truncated, _ = one.step(answer[0])
        steps = [each.step(answer) for _ in range(5 if block < 7 else 3)]
        assert reward[0] == pytest.approx(wanted, abs=1e-5)
        assert reward[0] == pytest.approx(sum(float(step[1][0]) for step in steps), abs=1e-5)
        assert done[0] == steps[-1][2][0] == (terminated or truncated) == (block == 7)
        if block < 7:
            np.testing.assert_allclose(seen[0], alone, atol=1e-5)
    np.testing.assert_allclose(infos[0]["terminal_observation"], alone, atol=1e-5)
    assert infos[0]["episode"]["l"] == 38
    rows.step(answer)  # through two steps without an answer, then five with it
    each.step(0 * answer), each.step(0 * answer)
    np.testing.assert_array_equal(rows.step(answer)[0], [each.step(answer)[0] for _ in range(10)][-1])
    with pytest.raises(ValueError, match="from 1 on, not 0"):
        make_envs(task, 1, hold=0)


def test_no_step_is_worth_less_than_the_worst_and_a_hold_is_at_least_one_step():
    settings = {"vehicle": "qin2014", "estimator": "truth", "speed": 22.0, "friction": 0.5}
    drives = [gymnasium.make("vse_gym/SineWithDwell-v0", **settings) for _ in range(2)]
    told, bounded = CanonicalView(drives[0]), CanonicalView(drives[1], worst=-2.0)
    least = []
    for env in (told, bounded):
        env.reset(seed=0)
        rewards, over = [], False
        while not over:
            _, reward, terminated, truncated, _ = env.step(np.zeros(4, np.float32))
            rewards.append(reward)
            over = terminated or truncated
        assert terminated  # the car spins
        least.append(min(rewards))
    assert least[0] < -2.0 == least[1]
    with pytest.raises(ValueError, match="from 1 on, not 0"):
        CanonicalView(drives[0], hold=0)


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
