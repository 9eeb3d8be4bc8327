"""The program that trains: what it writes, what it refuses, and that it goes on."""

import csv
import json

import pytest
import train
from curve import draw_curve
from segments import Point
from stable_baselines3 import PPO
from typer.testing import CliRunner

from vse_gym.policy import TrainedPolicy
from vse_gym.simulation import rollout, scenario

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


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """Words of a run that takes a second."""
    monkeypatch.setattr(train.Run, "drives", 2)
    path = tmp_path / "settings.toml"
    path.write_text(SETTINGS)
    where = ["--env", "vse_gym/HeldSteer-v0", "--settings", str(path), "--out", str(tmp_path / "run")]
    return ["ppo", *where, "--controller", "esc", "--estimator", "truth", "--vehicle", "qin2014", "--seed", "5"]


def run(words):
    return CliRunner().invoke(train.app, words)


def test_a_run_leaves_an_agent_that_drives_its_curve_and_how_it_was_made(asked, tmp_path):
    done = run(asked)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "run"
    agent = TrainedPolicy(str(folder))
    assert (agent.card.algorithm, agent.card.controller, agent.card.action) == ("ppo", "esc", "brakes")
    trained = agent.card.trained
    assert trained["seed"] == 5 and trained["steps"] >= 300
    assert trained["task"]["env"] == ["vse_gym/HeldSteer-v0"] and "torch" in trained["versions"]
    assert trained["command"].startswith("python agents/train.py")
    rows = list(csv.DictReader((folder / "curve.csv").open()))
    assert [float(row["steps"]) for row in rows] == [256, 512]
    best = max(float(row["held_out"]) for row in rows)
    assert agent.card.evaluation["mean_return"] == pytest.approx(best, rel=1e-3)
    assert (folder / "curve.png").stat().st_size > 5000
    assert list(folder.glob("events.*"))
    PPO.load(folder / "model.zip")
    drive = scenario("held_steer", friction=0.5)
    first, second = (rollout(drive, "ekf", agent, seed=1) for _ in range(2))
    assert (first.truth == second.truth).all() and not first.ended


def test_a_folder_with_a_run_is_not_written_over_unasked(asked):
    assert run(asked).exit_code == 0
    again = run(asked)
    assert again.exit_code == 2 and "--resume goes on with it, --overwrite begins anew" in again.output
    other = run([*asked, "--resume", "--seed", "6"])
    assert other.exit_code == 2 and "holds another run" in other.output
    assert run([*asked, "--overwrite", "--seed", "6"]).exit_code == 0


def test_a_run_that_was_stopped_is_resumed_by_the_same_command(asked, tmp_path, monkeypatch):
    whole = run(asked)
    assert whole.exit_code == 0, whole.output
    wanted = TrainedPolicy(str(tmp_path / "run")).digest
    stopped = [*asked[:-2], "--seed", "5", "--out", str(tmp_path / "stopped")]
    begin = train.Run._begin

    def stop(self):
        if self.segment == 1:
            raise KeyboardInterrupt
        begin(self)

    with monkeypatch.context() as patch:
        patch.setattr(train.Run, "_begin", stop)
        assert run(stopped).exit_code == 130
    assert not (tmp_path / "stopped" / "policy.npz").exists()
    done = run([*stopped, "--resume"])
    assert done.exit_code == 0, done.output
    assert TrainedPolicy(str(tmp_path / "stopped")).digest == wanted


def test_an_agent_that_sees_the_truth_trains_but_is_no_controller(asked, tmp_path):
    done = run([*asked, "--observation", "truth"])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "run" / "model.zip").exists() and not (tmp_path / "run" / "policy.npz").exists()


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


def test_random_estimators_are_several_to_draw_from(asked, tmp_path):
    words = [word if word != "truth" else "random" for word in asked]
    assert run(words).exit_code == 0
    said = json.loads((tmp_path / "run" / train.ASKED).read_text())
    assert len(said["task"]["estimator"]) > 2


def test_a_curve_is_drawn(tmp_path):
    curve = [Point(k, 1.0 * k, 2.0 * k, 0.5 * k, 0.0) for k in range(1, 5)]
    draw_curve(tmp_path / "curve.png", curve, {"controller_alone": 3.0, "nobody": 1.0}, "a run")
    assert (tmp_path / "curve.png").stat().st_size > 5000
