"""The Gymnasium face: both checkers, every id and option, and what a wrong call is told."""

import copy
import pickle
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import vse_gym
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.controllers.canonical import ACTIONS
from vse_gym.controllers.observation import LAYOUTS
from vse_gym.env import IDS
from vse_gym.estimators.base import Estimator
from vse_gym.physics import parameters as p
from vse_gym.types import Estimate

SWD = "vse_gym/SineWithDwell-v0"


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("observation", LAYOUTS)
@pytest.mark.parametrize("name", IDS)
def test_gymnasium_s_checker_has_nothing_to_say(name, observation, action):
    check_env(gymnasium.make(name, observation=observation, action=action, sensors="dropout").unwrapped)


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_gymnasium_s_checker_accepts_every_estimator_and_controller(estimator, controller):
    check_env(gymnasium.make(SWD, estimator=estimator, controller=controller, sensors="outliers").unwrapped)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("observation", LAYOUTS)
@pytest.mark.parametrize("name", IDS)
def test_stable_baselines_checker_has_nothing_to_say(name, observation, action):
    from stable_baselines3.common.env_checker import check_env as check

    check(gymnasium.make(name, observation=observation, action=action, controller="esc").unwrapped, warn=True)


def test_an_id_with_its_module_works_in_a_fresh_process():
    code = f"import gymnasium; print(gymnasium.make('vse_gym:{SWD}').reset(seed=0)[0].shape)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "(11,)", done.stderr


def drive(env, seed, actions):
    observation, info = env.reset(seed=seed)
    out = [(observation, 0.0, False, False, info)]
    for action in actions:
        out.append(env.step(action))
        if out[-1][2] or out[-1][3]:
            break
    return out


def some_actions(env, count, seed):
    return np.random.default_rng(seed).uniform(-1, 1, (count, *env.action_space.shape)).astype(np.float32)


@pytest.mark.parametrize("estimator", ["truth", "ekf", "pf"])
def test_the_same_seed_gives_the_same_bits(estimator):
    env = gymnasium.make(SWD, estimator=estimator, sensors="cauchy_gaussian", controller="esc")
    actions = some_actions(env, 150, seed=1)
    first, second, other = drive(env, 5, actions), drive(env, 5, actions), drive(env, 6, actions)
    assert all(np.array_equal(a[0], b[0]) and a[1] == b[1] for a, b in zip(first, second, strict=True))
    if estimator != "truth":  # the truth's observation holds a noisy steering angle, but noise acts on little else
        assert not np.array_equal(first[50][0], other[50][0])


def test_a_seed_meets_the_same_noise_as_a_rollout_with_it():
    env = gymnasium.make(SWD, estimator="ekf", controller="esc")
    log = vse_gym.rollout(env.unwrapped.scenario, "ekf", "esc", seed=7)
    infos = [step[4] for step in drive(env, 7, np.zeros((600, 4), np.float32))]
    np.testing.assert_array_equal([i["truth"]["vy"] for i in infos], log.truth[:, p.VY])
    np.testing.assert_array_equal([i["estimate"]["vy"] for i in infos], log.estimate[:, 1])


@pytest.mark.parametrize("estimator", ["ekf", "pf", "zero"])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_made_in_mid_drive_goes_on_alike(estimator, duplicate):
    env = gymnasium.make("vse_gym/HeldSteer-v0", estimator=estimator, controller="esc", sensors="outliers")
    actions = some_actions(env, 120, seed=2)
    drive(env, 3, actions[:60])
    twin = duplicate(env)
    for action in actions[60:]:
        mine, its = env.step(action), twin.step(action)
        assert np.array_equal(mine[0], its[0])
        assert mine[1:4] == its[1:4]


def flat(info, prefix=""):
    out = {}
    for key, value in info.items():
        nested = flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: np.shape(value)}
        out |= nested
    return out


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_info_has_the_same_keys_and_shapes_at_every_step(estimator):
    env = gymnasium.make(SWD, estimator=estimator, sensors="dropout")
    steps = drive(env, 0, some_actions(env, 600, seed=3))
    assert len({tuple(flat(step[4]).items()) for step in steps}) == 1
    assert {"truth", "reading", "estimate", "errors", "metrics", "ended"} <= steps[0][4].keys()


def test_what_is_handed_out_does_not_reach_inside():
    env = gymnasium.make(SWD)
    env.reset(seed=0)
    observation, _, _, _, info = env.step(np.zeros(4, np.float32))
    twin = copy.deepcopy(env)
    observation[:] = 99.0
    for value in (*info["reading"].values(), *info["estimate"].values()):
        if isinstance(value, np.ndarray):
            value[...] = True if value.dtype == bool else 99.0
    action = np.zeros(4, np.float32)
    assert np.array_equal(env.step(action)[0], twin.step(action)[0])


def test_a_spin_terminates_and_costs_every_step_that_was_left():
    env = gymnasium.make(SWD, estimator="truth", amplitude=np.radians(270))
    steps = drive(env, 0, np.zeros((600, 4), np.float32))
    *_, info = steps[-1]
    assert steps[-1][2] and not steps[-1][3] and info["ended"] == "spin"
    assert steps[-1][1] <= 1 - (600 - (len(steps) - 1))


def test_the_manoeuvre_s_end_truncates():
    env = gymnasium.make("vse_gym/StraightDriving-v0", duration=0.5)
    steps = drive(env, 0, np.zeros((600, 4), np.float32))
    assert len(steps) == 51
    assert steps[-1][3] and not steps[-1][2]


def test_leaving_the_lane_terminates():
    env = gymnasium.make("vse_gym/StraightDriving-v0")
    steps = drive(env, 0, np.tile(np.array([1, -1, 1, -1], np.float32), (600, 1)))
    assert steps[-1][4]["ended"] == "off course"


def test_a_drive_that_is_over_must_be_reset():
    env = gymnasium.make("vse_gym/StraightDriving-v0", duration=0.1).unwrapped
    drive(env, 0, np.zeros((10, 4), np.float32))
    with pytest.raises(RuntimeError, match="call reset"):
        env.step(np.zeros(4, np.float32))


def test_brakes_add_their_share_of_the_cap_and_zero_does_nothing():
    env = gymnasium.make("vse_gym/StraightDriving-v0", estimator="truth").unwrapped
    env.reset(seed=0)
    demand = env._demand(np.array([0.5, 0.0, 1.0, -0.25]))
    np.testing.assert_array_equal(demand.added, [1500.0, 0.0, 1500.0, 0.0])
    np.testing.assert_array_equal(demand.release, [0.0, 0.0, 0.0, 0.25])
    none = env._demand(np.zeros(4))
    assert not none.added.any() and not none.release.any()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_yaw_moment_to_the_left_turns_the_car_left(side):
    env = gymnasium.make("vse_gym/StraightDriving-v0", estimator="truth", action="yaw_moment", duration=0.5)
    steps = drive(env, 0, np.full((50, 1), 0.5 * side, np.float32))
    assert side * steps[-1][4]["truth"]["yaw_rate"] > 0.05


def test_an_agent_that_does_nothing_leaves_the_controller_alone_and_one_that_acts_adds_to_it():
    idle = gymnasium.make(SWD, estimator="truth", controller="esc")
    log = vse_gym.rollout(idle.unwrapped.scenario, "truth", "esc", seed=0)
    steps = drive(idle, 0, np.zeros((600, 4), np.float32))
    assert steps[-1][4]["truth"]["vx"] == log.truth[-1, p.VX]
    braking = drive(idle, 0, np.full((600, 4), 0.2, np.float32))
    assert braking[-1][4]["metrics"]["brake_energy"] > steps[-1][4]["metrics"]["brake_energy"]


def test_the_truth_is_seen_only_where_it_is_asked_for():
    blind = gymnasium.make(SWD, estimator="zero", observation="estimate", sensors="loud")
    seeing = gymnasium.make(SWD, estimator="zero", observation="truth", sensors="loud")
    actions = np.zeros((150, 4), np.float32)
    blind_step, seeing_step = drive(blind, 0, actions)[-1], drive(seeing, 0, actions)[-1]
    assert blind_step[0][1] == 0.0  # vy of an estimator without sideslip
    assert seeing_step[0][1] == np.float32(seeing_step[4]["truth"]["vy"])


@dataclass(frozen=True)
class Says(Estimator):
    """Believes in one speed."""

    vx: Any  # a float would have to be a number

    def init(self, nominal, rng):
        return None

    def update(self, state, reading, rng):
        return None

    def estimate(self, state):
        return Estimate(self.vx)


@pytest.mark.parametrize("vx", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("observation", LAYOUTS)
def test_an_observation_is_finite_whatever_an_estimator_says(observation, vx):
    env = vse_gym.StabilityControlEnv("sine_with_dwell", Says(vx), observation=observation)
    seen, _ = env.reset(seed=0)
    assert env.observation_space.contains(seen)


def test_readings_as_observation_do_not_depend_on_the_estimator():
    actions = np.zeros((150, 4), np.float32)
    kinds = [gymnasium.make(SWD, estimator=e, observation="reading", sensors="loud") for e in ("truth", "zero")]
    one, other = ([step[0] for step in drive(env, 0, actions)] for env in kinds)
    np.testing.assert_array_equal(one, other)


def test_an_agent_that_brakes_to_a_standstill_has_no_sideslip_there():
    env = gymnasium.make("vse_gym/StraightDriving-v0", estimator="truth", sensors="clean", duration=8.0)
    steps = drive(env, 0, np.ones((800, 4), np.float32))
    assert steps[-1][4]["truth"]["vx"] < 0.1
    assert steps[-1][4]["metrics"]["peak_sideslip"] < 0.01
    assert steps[-1][4]["metrics"]["sideslip_rmse"] < 0.01


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_rewards_stay_within_their_bounds(controller):
    env = gymnasium.make(SWD, estimator="truth", controller=controller)
    steps = drive(env, 0, some_actions(env, 600, seed=4))
    rewards = [step[1] for step in steps[1:]]
    assert all(-1 <= r <= 1 for r in rewards[:-1])
    assert -600 - 1 <= rewards[-1] <= 1


WRONG = [
    ({"estimator": "ekff"}, "known: truth"),
    ({"controller": "abs"}, "known: none"),
    ({"vehicle": "beetle"}, "known: bmw_320i"),
    ({"sensors": "perfect"}, "known: clean"),
    ({"observation": "everything"}, "one of estimate"),
    ({"action": "steer"}, "one of brakes"),
    ({"friction": 0.0}, "friction"),
    ({"friction": float("nan")}, "friction"),
    ({"amplitud": 1.0}, "amplitud"),
    ({"render_mode": "human"}, "plot"),
    ({"speed": -1.0}, "speed"),
    ({"estimator": 42}, "neither a name"),
    ({"controller": 3}, "neither a name"),
    ({"frequency": 0.0}, "frequency"),
    ({"amplitude": float("nan")}, "amplitude"),
    ({"dwell": -1.0}, "dwell"),
    ({"duration": 0.001}, "shorter than one step"),
]


@pytest.mark.parametrize(("settings", "sentence"), WRONG, ids=lambda x: str(x) if isinstance(x, dict) else "")
def test_a_wrong_name_or_number_is_told_what_can_be(settings, sentence):
    with pytest.raises((KeyError, ValueError, TypeError), match=sentence):
        vse_gym.StabilityControlEnv("sine_with_dwell", **settings)


@pytest.mark.parametrize("action", [np.zeros(3), np.zeros((1, 4)), 0.0, [np.nan, 0, 0, 0], [np.inf, 0, 0, 0]])
def test_an_action_of_the_wrong_shape_or_not_finite_is_refused(action):
    env = vse_gym.StabilityControlEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action must"):
        env.step(action)
