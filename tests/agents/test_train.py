"""The program that trains: what it writes, what it refuses, and that it goes on."""

import csv
import json
from functools import partial

import pytest
import train
from curve import draw_curve
from environments import SOME
from segments import Point, Run
from stable_baselines3 import PPO
from typer.testing import CliRunner

from vse_gym.policy import TrainedPolicy
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

from .conftest import Brief

SETTINGS = """
n_envs = 4
n_timesteps = 300
segments = 2
policy = "MlpPolicy"
n_steps = 32
batch_size = 64
n_epochs = 1
[policy_kwargs]
net_arch = [8]
"""


def words_of(folder):
    """Of a run that takes a second."""
    folder.mkdir(exist_ok=True)
    path = folder / "settings.toml"
    path.write_text(SETTINGS)
    where = ["--env", "vse_gym/HeldSteer-v0", "--settings", str(path), "--out", str(folder / "run")]
    return ["ppo", *where, "--controller", "esc", "--estimator", "truth", "--vehicle", "qin2014", "--seed", "5"]


def run(words):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "Task", Brief)
        patch.setattr(train, "Run", partial(Run, drives=2))
        return CliRunner().invoke(train.app, words)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a run that came to its end, and its words."""
    folder = tmp_path_factory.mktemp("train")
    words = words_of(folder)
    done = run(words)
    assert done.exit_code == 0, done.output
    return folder / "run", words


def test_a_run_leaves_an_agent_that_drives_its_curve_and_how_it_was_made(finished):
    folder, _ = finished
    agent = TrainedPolicy(str(folder))
    assert (agent.card.algorithm, agent.card.controller, agent.card.action) == ("ppo", "esc", "brakes")
    trained = agent.card.trained
    assert trained["seed"] == 5 and trained["steps"] >= 300
    assert trained["task"]["env"] == ["vse_gym/HeldSteer-v0"] and "torch" in trained["versions"]
    assert trained["command"].startswith("python agents/train.py")
    with (folder / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["steps"]) for row in rows] == [256, 512]
    best = max(float(row["held_out"]) for row in rows)
    assert agent.card.evaluation["mean_return"] == pytest.approx(best, abs=0.01)
    assert (folder / "curve.png").stat().st_size > 5000
    assert list(folder.glob("events.*"))
    PPO.load(folder / "model.zip")
    drive = scenario("held_steer", friction=0.5)
    first, second = (rollout(drive, "ekf", agent, seed=1) for _ in range(2))
    assert (first.truth == second.truth).all() and not first.ended


def test_a_folder_with_a_run_is_not_written_over_unasked(finished):
    folder, words = finished
    before = TrainedPolicy(str(folder)).digest
    again = run(words)
    assert again.exit_code == 2 and "--resume goes on with it, --overwrite begins anew" in again.output
    other = run([*words, "--resume", "--seed", "6"])
    assert other.exit_code == 2 and "holds another run" in other.output
    assert TrainedPolicy(str(folder)).digest == before


def test_a_run_that_was_stopped_is_resumed_by_the_same_command(finished, tmp_path, monkeypatch):
    wanted, words = TrainedPolicy(str(finished[0])).digest, words_of(tmp_path)
    begin = Run._begin

    def stop(self):
        if self.segment == 1:
            raise KeyboardInterrupt
        begin(self)

    with monkeypatch.context() as patch:
        patch.setattr(Run, "_begin", stop)
        assert run(words).exit_code == 130
    assert not (tmp_path / "run" / "policy.npz").exists()
    done = run([*words, "--resume"])
    assert done.exit_code == 0, done.output
    assert TrainedPolicy(str(tmp_path / "run")).digest == wanted


def test_what_is_written_over_begins_anew(tmp_path):
    folder, asked = tmp_path / "run", {"seed": 1}
    train.prepare(folder, asked, resume=False, overwrite=False)
    (folder / train.CHECKPOINT).write_bytes(b"old")
    train.prepare(folder, asked, resume=True, overwrite=False)
    assert (folder / train.CHECKPOINT).exists()
    train.prepare(folder, {"seed": 2}, resume=False, overwrite=True)
    assert not (folder / train.CHECKPOINT).exists()
    assert json.loads((folder / train.ASKED).read_text()) == {"seed": 2}


def test_random_estimators_are_several_to_draw_from(tmp_path):
    words, made = words_of(tmp_path), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "Run", lambda *about: about)
        patch.setattr(train, "train", lambda *about: made.append(about[1]))
        done = CliRunner().invoke(train.app, [word if word != "truth" else "random" for word in words])
    assert done.exit_code == 0, done.output
    assert made[0][1].estimator == SOME and len(SOME) > 2


WRONG = [
    (["a2c"], "known: ppo, recurrent_ppo, sac, td3"),
    (["ppo", "--env", "vse_gym/Moon-v0"], "known: vse_gym/SineWithDwell-v0"),
    (["ppo", "--estimator", "ekff"], "known: truth"),
    (["ppo", "--friction", "0.9", "0.2"], "friction must be two positive numbers"),
    (["ppo", "--action", "steer"], "brakes, yaw_moment"),
]


@pytest.mark.parametrize(("words", "sentence"), WRONG)
def test_a_wrong_word_is_told_what_can_be(words, sentence, tmp_path):
    refused = run([*words, "--out", str(tmp_path / "run")])
    assert refused.exit_code == 2
    assert sentence in " ".join(refused.output.split())


def test_a_curve_is_drawn(tmp_path):
    curve = [Point(k, 1.0 * k, 2.0 * k, 0.5 * k, 0.0) for k in range(1, 5)]
    draw_curve(tmp_path / "curve.png", curve, {"controller_alone": 3.0, "nobody": 1.0}, "a run")
    assert (tmp_path / "curve.png").stat().st_size > 5000


def test_words_that_are_refused_leave_nothing_behind_and_harm_nothing(finished, tmp_path):
    folder, words = finished
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    for wrong in (["--controller", "ecs", "--overwrite"], ["--action", "steer", "--overwrite"]):
        assert run([*words, *wrong]).exit_code == 2
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    refused = run([*words, "--action", "steer", "--out", str(tmp_path / "new")])
    assert refused.exit_code == 2 and not (tmp_path / "new").exists()
