"""The native vector environment against the single one, to the bit."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import vse_gym
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.controllers.canonical import ACTIONS
from vse_gym.controllers.observation import LAYOUTS
from vse_gym.env import IDS, StabilityControlEnv
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.randomise import Randomise
from vse_gym.types import Driver
from vse_gym.vector.drives import Drives
from vse_gym.vector.env import StabilityControlVectorEnv
from vse_gym.vector.rows import controls_in_rows, estimates_in_rows

SWD = "vse_gym/SineWithDwell-v0"
LANE = "vse_gym/DoubleLaneChange-v0"
FILTERS = [name for name in ESTIMATORS if estimates_in_rows(ESTIMATORS.make(name))]
LAWS = [name for name in CONTROLLERS if controls_in_rows(CONTROLLERS.make(name))]


def native(name, rows, **settings):
    return gymnasium.make_vec(name, num_envs=rows, vectorization_mode="vector_entry_point", **settings)


def actions_of(env, steps, seed):
    """Random ones about nothing, so that cars spin seldom and drive on."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.3, (steps, env.num_envs, *env.single_action_space.shape)).astype(np.float32)


class Singles:
    """What a native environment must do, done by as many single ones, which Gymnasium's next-step autoreset resets."""

    def __init__(self, name, rows, **settings):
        self.envs = [gymnasium.make(name, **settings).unwrapped for _ in range(rows)]
        self.over = [False] * rows

    def reset(self, seed):
        return [env.reset(seed=seed + i) for i, env in enumerate(self.envs)]

    def step(self, actions):
        out = []
        for i, env in enumerate(self.envs):
            if self.over[i]:
                observation, info = env.reset()
                out.append((observation, 0.0, False, False, info))
            else:
                out.append(env.step(actions[i]))
            self.over[i] = out[-1][2] or out[-1][3]
        return out


def agree(got, expected):
    """Every number of a step, to the bit; but for what info works out of them, where Python's hypot is not LLVM's."""
    observation, reward, terminated, truncated, info = got
    for i, (its, worth, ended, up, told) in enumerate(expected):
        np.testing.assert_array_equal(observation[i], its)
        assert (reward[i], terminated[i], truncated[i]) == (worth, ended, up)
        assert info["ended"][i] == told["ended"]
        for group in ("truth", "estimate", "errors", "metrics"):
            for key, value in told[group].items():
                name = f"{group}.{key}"
                np.testing.assert_allclose(info[group][key][i], value, rtol=1e-13, atol=1e-13, err_msg=name)


def drive_both(name, steps, rows=2, seed=5, **settings):
    """How many drives of a row began, after as many steps that agreed."""
    env, singles = native(name, rows, **settings), Singles(name, rows, **settings)
    observation, info = env.reset(seed=seed)
    first = singles.reset(seed)
    agree(
        (observation, np.zeros(rows), *2 * [np.zeros(rows, bool)], info), [(o, 0.0, False, False, i) for o, i in first]
    )
    begun = rows
    for actions in actions_of(env, steps, seed):
        got, expected = env.step(actions), singles.step(actions)
        agree(got, expected)
        begun += int(np.sum(got[2] | got[3]))
    env.close()
    return begun


@pytest.mark.parametrize("name", IDS)
def test_every_id_drives_as_the_single_environment_over_whole_drives_and_beyond(name):
    duration = {} if name in (SWD, LANE) else {"duration": 4.0}
    steps = 1000 if name in (SWD, LANE) else 450
    assert drive_both(name, steps, controller="esc", sensors="dropout", **duration) > 2


@pytest.mark.parametrize("estimator", FILTERS)
def test_every_estimator_that_rows_support_is_the_single_one(estimator):
    settings = {"sensors": "outliers", "controller": "sideslip_esc", "friction": 0.6, "duration": 2.4}
    assert drive_both(SWD, 250, estimator=estimator, **settings) > 2


@pytest.mark.parametrize("controller", LAWS)
def test_every_controller_that_rows_support_is_the_single_one(controller):
    drive_both(LANE, 250, controller=controller, sensors="loud", friction=0.4)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("observation", LAYOUTS)
def test_every_layout_and_action_is_the_single_one(observation, action):
    drive_both("vse_gym/HeldSteer-v0", 120, observation=observation, action=action, sensors="late")


def test_cars_that_spin_and_leave_the_road_end_as_the_single_ones_do():
    assert drive_both(SWD, 700, rows=4, estimator="truth", amplitude=np.radians(270), friction=0.3) > 6


def test_what_is_drawn_at_each_reset_is_drawn_alike():
    """Cars, roads, sensors with other delays and filters of other sizes, mixed in one environment."""
    randomise = Randomise(speed=3.0, steer=0.2, friction=0.3, mass=(0.9, 1.2), stiffness=(0.8, 1.1), gravity_shift=0.1)
    settings = {
        "estimator": ("ekf", "truth", "ukf_double_track", "ekf_cauchy_gaussian"),
        "sensors": ("gaussian", "late", "harsh"),
        "randomise": randomise,
        "friction": 0.6,
        "controller": "esc",
    }
    assert drive_both("vse_gym/HeldSteer-v0", 400, rows=6, duration=1.0, **settings) > 20


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_number_of_threads_changes_nothing(threads):
    def run(count):
        env = StabilityControlVectorEnv(7, threads=count, manoeuvre="sine_with_dwell", duration=1.0, sensors="loud")
        env.reset(seed=1)
        out = [env.step(actions) for actions in actions_of(env, 250, 2)]
        env.close()
        return out

    for mine, its in zip(run(threads), run(5), strict=True):
        for a, b in zip(mine[:4], its[:4], strict=True):
            np.testing.assert_array_equal(a, b)


def test_it_is_what_gymnasium_expects_of_a_vector_environment():
    env = native(SWD, 3)
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    observation, info = env.reset(seed=[4, None, 6])
    assert observation in env.observation_space and observation.dtype == np.float32
    assert all(mask.all() and mask.shape == (3,) for key, mask in info.items() if key.startswith("_"))
    sync = gymnasium.make_vec(SWD, num_envs=3, vectorization_mode="sync")
    assert env.observation_space == sync.observation_space and env.action_space == sync.action_space
    both = zip(env.step(env.action_space.sample())[:4], (np.float32, float, bool, bool), strict=True)
    assert all(array.dtype == kind and len(array) == 3 for array, kind in both)
    env.close()


def test_a_wrapper_of_gymnasium_counts_the_returns():
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(native("vse_gym/StraightDriving-v0", 2, duration=0.5))
    env.reset(seed=0)
    steps = [env.step(np.zeros(env.action_space.shape, np.float32)) for _ in range(50)]
    assert steps[-1][3].all()
    np.testing.assert_allclose(steps[-1][4]["episode"]["l"], 50)
    np.testing.assert_allclose(steps[-1][4]["episode"]["r"], sum(step[1] for step in steps), rtol=1e-6)


def test_what_is_handed_out_does_not_reach_inside():
    env, twin = native(SWD, 2), native(SWD, 2)
    first = env.reset(seed=0)[0]
    twin.reset(seed=0)
    first[:] = 99.0
    actions = np.zeros(env.action_space.shape, np.float32)
    observation, reward, *_ = env.step(actions)
    twin.step(actions)
    observation[:], reward[:] = 99.0, 99.0
    np.testing.assert_array_equal(env.step(actions)[0], twin.step(actions)[0])
    with pytest.raises(ValueError, match="read-only"):
        env.step(actions)[-1]["_truth"][:] = False


def test_rows_that_are_reset_without_a_seed_go_on_with_what_theirs_draws():
    env = native(SWD, 2)
    singles = [gymnasium.make(SWD, disable_env_checker=True) for _ in range(2)]
    env.reset(seed=3)
    for i, single in enumerate(singles):
        single.reset(seed=3 + i)
    for seeds in (None, [None, 9]):
        seen = env.reset(seed=seeds)[0]
        own = [None, None] if seeds is None else seeds
        np.testing.assert_array_equal(
            seen, [single.reset(seed=seed)[0] for single, seed in zip(singles, own, strict=True)]
        )


class Swerve(Manoeuvre):
    """A driver in Python."""

    def drive(self, state, time, car):
        return Driver(0.1), state

    def verdict(self, log, nominal):
        raise NotImplementedError


REFUSED = {
    "a particle filter": ({"estimator": "pf"}, "BootstrapParticleFilter is neither truth nor of the Gaussian family"),
    "a told filter": ({"estimator": "ekf_told"}, "ToldExtendedKalmanFilter is neither"),
    "one of several": ({"estimator": ("ekf", "enkf")}, "EnsembleKalmanFilter is neither"),
    "a predictive controller": ({"controller": "mpc"}, "ModelPredictiveControl is no law of yaw moments"),
    "a driver of one's own": ({"manoeuvre": Swerve()}, "Swerve has a driver of its own"),
    "an unknown name": ({"estimator": "nobody"}, "no estimator named 'nobody'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_rows_cannot_drive_is_refused_with_what_can(case):
    settings, message = REFUSED[case]
    with pytest.raises(Exception, match=message):
        StabilityControlVectorEnv(2, **settings)


def test_wrong_calls_are_told_what_was_expected():
    env = native(SWD, 2)
    with pytest.raises(gymnasium.error.ResetNeeded, match="begin with reset"):
        env.step(np.zeros((2, 4), np.float32))
    with pytest.raises(ValueError, match="needs 2 seeds, one for each row, not 3"):
        env.reset(seed=[1, 2, 3])
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"finite and have the shape \(2, 4\)"):
        env.step(np.zeros((2, 3), np.float32))
    with pytest.raises(ValueError, match="finite"):
        env.step(np.full((2, 4), np.nan, np.float32))
    with pytest.raises(ValueError, match="rows and threads must be at least 1, not 0 and None"):
        StabilityControlVectorEnv(0)
    with pytest.raises(ValueError, match="not 2 and 0"):
        Drives(StabilityControlEnv(), 2, 0)


def test_most_of_the_gaussian_family_is_supported():
    assert {"truth", "ekf", "ukf", "ckf", "sr_ukf", "ekf_cauchy_gaussian", "strong_tracking"} <= set(FILTERS)
    assert {"none", "esc", "sideslip_esc", "sliding_mode", "phase_plane"} <= set(LAWS)
    assert vse_gym.__name__ == "vse_gym"
