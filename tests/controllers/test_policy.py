"""A trained agent as a controller: the environment that it was trained in, and nothing else, in plain numbers."""

import io
import json
import pickle
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.controllers.canonical import (
    ACTIONS,
    TYPICAL,
    all_from_canonical,
    all_to_canonical,
    canonical,
    held_canonical,
)
from vse_gym.controllers.network import answer, network, shapes
from vse_gym.controllers.observation import LAYOUTS, Encoder
from vse_gym.physics import parameters as p
from vse_gym.policy import CARD, WEIGHTS, PolicyError, TrainedPolicy, digest
from vse_gym.probing import mirror
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.testing import CONTROLLER_CHECKS
from vse_gym.wrappers import CanonicalView

KINDS = {
    "ppo": {"activation": "tanh", "squash": "clip", "memory": 0},
    "sac": {"activation": "relu", "squash": "tanh", "memory": 0},
    "td3": {"activation": "relu", "squash": "tanh", "memory": 0},
    "recurrent_ppo": {"activation": "tanh", "squash": "clip", "memory": 6},
}
SEEN = ("estimate", "reading")


def draw_arrays(observation, action, memory, seed=0):
    rng = np.random.default_rng(seed)
    wanted = shapes(len(LAYOUTS[observation]), [8, 5, ACTIONS[action]], memory)
    return {name: rng.normal(0, 0.7, shape).astype(np.float32) for name, shape in wanted.items()}


def write(folder, arrays=None, weights=None, **changes):
    """An agent with a random net, or what is said in its place."""
    card = {"format": 1, "algorithm": "ppo", "observation": "estimate", "action": "brakes", "controller": "none"}
    card |= KINDS.get(changes.get("algorithm"), KINDS["ppo"]) | {"weights": ""} | changes
    card.setdefault("sizes", [8, 5, ACTIONS.get(card["action"], 4)])
    if arrays is None:
        arrays = draw_arrays(card["observation"], card["action"], card["memory"])
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    content = buffer.getvalue() if weights is None else weights
    card["weights"] = card["weights"] or digest(content)
    folder.mkdir(exist_ok=True)
    (folder / WEIGHTS).write_bytes(content)
    lines = [f"{key} = {json.dumps(value)}" for key, value in card.items() if value is not None]
    (folder / CARD).write_text("\n".join(lines))
    return str(folder)


@pytest.fixture(scope="module")
def agents(tmp_path_factory):
    """Agents of every algorithm, layout and kind of action, with random nets."""
    folder = tmp_path_factory.mktemp("agents")
    return {
        (algorithm, observation, action): write(
            folder / f"{algorithm}-{observation}-{action}",
            algorithm=algorithm,
            observation=observation,
            action=action,
            controller="esc" if algorithm == "sac" else "none",
        )
        for algorithm in KINDS
        for observation in SEEN
        for action in ACTIONS
    }


# -- what the environment does, the controller does -------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", KINDS)
@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("observation", SEEN)
@pytest.mark.parametrize("sensors", ["loud", "dropout"])
def test_an_environment_driven_by_the_net_is_a_rollout_with_the_policy(agents, algorithm, observation, action, sensors):
    path = agents[algorithm, observation, action]
    policy = TrainedPolicy(path)
    card, kind = policy.card, KINDS[algorithm]
    arrays = draw_arrays(observation, action, card.memory)
    net = network(arrays, len(LAYOUTS[observation]), card.sizes, card.memory, kind["activation"], kind["squash"])
    env = CanonicalView(
        gymnasium.make(
            "vse_gym/SineWithDwell-v0",
            observation=observation,
            action=action,
            controller=card.controller,
            sensors=sensors,
            friction=0.6,
        )
    )
    seen, info = env.reset(seed=4)
    hidden, motion, over = np.zeros(2 * card.memory), [info["truth"]], False
    while not over:
        out, hidden = answer(net, seen, hidden)
        seen, _, terminated, truncated, info = env.step(out.astype(np.float32))
        motion.append(info["truth"])
        over = terminated or truncated
    log = rollout(env.unwrapped.scenario, "ekf", policy, seed=4)
    assert len(log.time) == len(motion) > 100
    assert log.added.any()
    for name, column in (("vx", p.VX), ("vy", p.VY), ("yaw_rate", p.YAW_RATE)):
        np.testing.assert_allclose([m[name] for m in motion], log.truth[:, column], rtol=0, atol=1e-9)


@pytest.mark.parametrize("check", CONTROLLER_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("observation", SEEN)
@pytest.mark.parametrize("algorithm", ["recurrent_ppo", "sac"])
def test_an_agent_keeps_the_promises_of_controllers_whatever_its_net(
    agents, algorithm, observation, action, check, nominal, estimates, readings
):
    check(TrainedPolicy(agents[algorithm, observation, action]), nominal, estimates, readings)


def test_a_residual_agent_that_answers_nothing_leaves_its_controller_alone(tmp_path):
    arrays = {k: np.zeros_like(v) for k, v in draw_arrays("estimate", "brakes", 0).items()}
    idle = TrainedPolicy(write(tmp_path / "idle", arrays, controller="lqr"))
    drive = scenario("sine_with_dwell", friction=0.5)
    mine, its = (rollout(drive, "ekf", c, seed=2) for c in (idle, "lqr"))
    np.testing.assert_array_equal(mine.truth, its.truth)
    assert its.added.any()


def test_two_drives_with_an_agent_are_the_same_to_the_bit(agents):
    policy = TrainedPolicy(agents["recurrent_ppo", "reading", "brakes"])
    first, second = (rollout(scenario("double_lane_change"), "ukf", policy, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first.truth, second.truth)
    np.testing.assert_array_equal(first.added, second.added)


# -- the canonical form -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_feature_has_a_typical_size_within_its_limits(layout):
    form = canonical(layout, "brakes")
    for k, feature in enumerate(LAYOUTS[layout]):
        assert 0 < form.size[k] <= feature.high
        assert feature.low <= form.middle[k] <= feature.high
        assert feature.name in TYPICAL or feature.name.endswith("_valid")


@given(seed=st.integers(0, 10**6), observation=st.sampled_from(SEEN), action=st.sampled_from(sorted(ACTIONS)))
def test_a_mirrored_observation_looks_the_same_and_its_action_is_mirrored(seed, observation, action, drive):
    nominal, rng = drive.nominal, np.random.default_rng(seed)
    encoder = Encoder(observation)
    estimate = drive.estimates[int(rng.integers(len(drive.estimates)))]
    reading = drive.readings[int(rng.integers(len(drive.readings)))]
    reading = reading._replace(y=reading.y + rng.normal(0, 0.01, 10))
    form, view = held_canonical(observation, action), encoder.view(nominal)
    out = rng.uniform(-1, 1, (1, ACTIONS[action])).astype(np.float32)
    acted = []
    for e, r in ((estimate, reading), (mirror(estimate), mirror(reading))):
        heard = np.where(np.isnan(r.y), 0.0, r.y)
        vector, _ = encoder.encode(view, np.zeros(2), e, r.steer, r, heard)
        seen, side, counts = all_to_canonical(form, vector[None])
        acted.append((seen, side, counts, all_from_canonical(form, out, side, counts)[0]))
    (one, left, much, act), (other, right, same, opposite) = acted
    np.testing.assert_allclose(one, other, atol=1e-6)
    assert left == -right and much == pytest.approx(same)
    np.testing.assert_array_equal(opposite, -act if action == "yaw_moment" else act[[1, 0, 3, 2]])


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("observation", LAYOUTS)
def test_rows_are_turned_as_a_single_environment_turns_them(observation, action):
    env = CanonicalView(gymnasium.make("vse_gym/HeldSteer-v0", observation=observation, action=action, sensors="loud"))
    form, rng = held_canonical(observation, action), np.random.default_rng(0)
    plain = gymnasium.make("vse_gym/HeldSteer-v0", observation=observation, action=action, sensors="loud")
    seen, _ = env.reset(seed=1)
    vector, _ = plain.reset(seed=1)
    for _ in range(80):
        rows, side, counts = all_to_canonical(form, vector[None])
        np.testing.assert_array_equal(rows[0], seen)
        out = rng.uniform(-1, 1, (1, ACTIONS[action])).astype(np.float32)
        seen, reward, *_ = env.step(out[0])
        vector, full, *_ = plain.step(all_from_canonical(form, out, side, counts)[0])
        assert reward == pytest.approx(full / 10)
    assert env.observation_space.contains(seen)


def test_only_a_car_is_seen_so():
    with pytest.raises(TypeError, match="StabilityControlEnv"):
        CanonicalView(gymnasium.make("CartPole-v1"))


# -- a folder that is no agent ----------------------------------------------------------------------------------------


class Bomb:
    def __reduce__(self):
        return exec, ("raise SystemExit('it ran')",)


def pickled():
    buffer = io.BytesIO()
    np.savez(buffer, **{"layers.0.weight": np.array([Bomb()], dtype=object)})
    return buffer.getvalue()


def changed(**changes):
    return {**draw_arrays("estimate", "brakes", 0), **changes}


WRONG = {
    "pickled": ({"weights": pickled()}, "pickle"),
    "no zip": ({"weights": b"not a zip at all"}, "that can be loaded"),
    "empty": ({"weights": b""}, "that can be loaded"),
    "shape": ({"arrays": changed(**{"layers.1.bias": np.zeros(4)})}, r"layers\.1\.bias must be \(5,\)"),
    "whole numbers": ({"arrays": changed(**{"layers.1.bias": np.zeros(5, int)})}, "floats"),
    "not finite": ({"arrays": changed(**{"layers.1.bias": np.full(5, np.nan)})}, "not finite"),
    "one too many": ({"arrays": changed(more=np.zeros(1))}, "the arrays must be"),
    "lacking": ({"arrays": {"layers.0.weight": np.zeros((8, 11))}}, "the arrays must be"),
    "algorithm": ({"algorithm": "a2c"}, "ppo, sac, td3"),
    "layout": ({"observation": "everything", "arrays": changed()}, "estimate, reading"),
    "truth": ({"observation": "truth"}, "no controller sees the truth"),
    "action": ({"action": "steer", "arrays": changed()}, "brakes, yaw_moment"),
    "controller": ({"controller": "abs"}, "none, esc"),
    "activation": ({"activation": "gelu"}, "tanh, relu"),
    "squash": ({"squash": "none"}, "clip, tanh"),
    "sizes": ({"sizes": [8, 5, 3], "arrays": changed()}, "4 numbers, not 3"),
    "sizes in words": ({"sizes": "8 5 4"}, "widths"),
    "negative sizes": ({"sizes": [-8, 5, 4]}, "widths"),
    "enormous": ({"sizes": [10**9, 5, 4]}, "widths"),
    "memory": ({"memory": 2.5, "arrays": changed()}, "widths"),
    "format": ({"format": 2}, "known is 1"),
    "another key": ({"digest_of": "0"}, "no key digest_of"),
    "lacks a key": ({"controller": None}, "lacks controller"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_damaged_or_foreign_folder_is_refused_with_a_sentence(case, tmp_path):
    settings, sentence = WRONG[case]
    path = write(tmp_path / "agent", **settings)
    with pytest.raises(PolicyError, match=sentence) as caught:
        TrainedPolicy(path)
    assert path in str(caught.value)


def test_weights_of_another_agent_are_refused(tmp_path):
    path = write(tmp_path / "agent")
    other = write(tmp_path / "other", changed(**{"layers.1.bias": np.ones(5)}))
    Path(path, WEIGHTS).write_bytes(Path(other, WEIGHTS).read_bytes())
    with pytest.raises(PolicyError, match="digests differ"):
        TrainedPolicy(path)


@pytest.mark.parametrize("name", [CARD, WEIGHTS])
def test_a_folder_that_lacks_a_file_says_which(tmp_path, name):
    path = write(tmp_path / "agent")
    Path(path, name).unlink()
    with pytest.raises(PolicyError, match=f"lacks {name}"):
        TrainedPolicy(path)


def test_a_cut_off_file_is_refused(tmp_path):
    path = write(tmp_path / "agent")
    whole = Path(path, WEIGHTS).read_bytes()
    for length in range(0, len(whole), 97):
        Path(path, WEIGHTS).write_bytes(whole[:length])
        with pytest.raises(PolicyError):
            TrainedPolicy(path)


def test_an_agent_that_was_written_anew_is_another(tmp_path):
    first = TrainedPolicy(write(tmp_path / "agent"))
    sent = pickle.dumps(first)
    second = TrainedPolicy(write(tmp_path / "agent", changed(**{"layers.1.bias": np.ones(5)})))
    assert first != second
    with pytest.raises(PolicyError, match="its weights are"):
        TrainedPolicy(first.path, first.digest)
    for kept in (first, pickle.loads(sent)):
        with pytest.raises(PolicyError, match="its weights are"):
            kept.init(scenario("held_steer").nominal)
        with pytest.raises(PolicyError, match="its weights are"):
            _ = kept.card


def test_an_agent_runs_without_the_library_that_trained_it(agents):
    code = f"""
import sys
from vse_gym import rollout, scenario
from vse_gym.policy import TrainedPolicy
policy = TrainedPolicy({agents["ppo", "estimate", "brakes"]!r})
log = rollout(scenario('straight_driving', duration=0.1), 'ekf', policy, 0)
print(len(log.time), 'torch' in sys.modules, 'stable_baselines3' in sys.modules)
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "11 False False", done.stderr


def test_an_agent_asleep_asks_for_nothing(agents):
    policy = TrainedPolicy(agents["ppo", "estimate", "brakes"])
    drive = scenario("straight_driving", sensors="gaussian", duration=1.0)
    log = rollout(drive, "ekf", policy, seed=0)
    assert np.mean(log.added.any(axis=1)) < 0.05
