"""The command that searches for a tuning, as a stranger meets it."""

import sys

import pytest
from typer.testing import CliRunner

from vse_gym.cli import app
from vse_gym.evaluation import tune
from vse_gym.evaluation.tunings import Tuning

STUDY = """
version = 1
seeds = 2
first_seed = 5000
[[cell]]
name = "swerve"
manoeuvre = "sine_with_dwell"
sensors = "biased"
settings = { friction = 0.5, duration = 2.0, amplitude_deg = 120 }
"""


def call(*words):
    return CliRunner().invoke(app, ["tune", *map(str, words)], catch_exceptions=False)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("studies") / "mine.toml"
    path.write_text(STUDY)
    return path


def said(result):
    return " ".join(result.output.split())


def test_it_writes_a_file_and_says_what_came_of_it(study, tmp_path):
    out = tmp_path / "new" / "kinematic.toml"
    result = call("kinematic", "--budget", 6, "--study", study, "--out", out)
    assert result.exit_code == 0
    tuning = Tuning.load(out)
    assert tuning.estimator == "kinematic"
    assert tuning.origin["command"] == f"vse-gym tune kinematic --budget 6 --study {study} --seeds 2 --seed 0"
    assert tuning.label in said(result)
    assert "mean regret, training, seeds 5000 to 5001: tuned " in said(result)
    assert "mean regret, validation, seeds 5002 to 5011: tuned " in said(result)
    assert f"{tuning.make().leak:.3g}" in result.output
    assert max(map(len, result.output.splitlines())) <= 80


def test_without_a_file_s_name_it_goes_where_all_tunings_lie(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call("kinematic", "--budget", 1, "--study", study)
    assert result.exit_code == 0
    assert "nothing better than the default was found" in said(result)  # there was no other trial
    assert Tuning.load("tunings/kinematic.toml").origin["validation"]["difference"]["mean"] == 0


def test_ctrl_c_writes_the_best_so_far_and_says_so(study, tmp_path, monkeypatch):
    drives, real = iter(range(100)), tune.regret

    def regret(drawn, estimator):
        if next(drives) == 5:
            raise KeyboardInterrupt
        return real(drawn, estimator)

    monkeypatch.setattr(tune, "regret", regret)
    result = call("kinematic", "--budget", 6, "--study", study, "--out", tmp_path / "a.toml")
    assert result.exit_code == 130
    assert "stopped early: this is the best so far" in said(result)
    assert Tuning.load(tmp_path / "a.toml").origin["finished"] == 2


def test_ctrl_c_at_once_writes_nothing(study, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(tune, "regret", interrupted)
    result = call("kinematic", "--study", study, "--out", tmp_path / "a.toml")
    assert result.exit_code == 130
    assert "stopped" in result.output
    assert not list(tmp_path.iterdir())


REFUSED = {
    "unknown estimator": (("eckf",), "no estimator named 'eckf'; known: truth"),
    "nothing to tune": (("zero",), "estimator 'zero' has nothing to tune"),
    "unknown study": (("ekf", "--study", "trainning"), "no study named 'trainning'; known: "),
    "a table's study": (("ekf", "--study", "demo"), "study 'demo' is not for tuning"),
    "no budget": (("ekf", "--budget", 0), "budget"),
    "no file": (("ekf", "--out", "tunings"), "--out needs a file that ends in .toml, not 'tunings'"),
}


@pytest.mark.parametrize(("words", "sentence"), REFUSED.values(), ids=REFUSED)
def test_a_mistake_is_a_sentence(words, sentence):
    result = call(*words)
    assert result.exit_code == 2
    assert sentence in said(result)


def test_without_optuna_it_says_what_to_install(study, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    result = call("kinematic", "--study", study, "--out", tmp_path / "a.toml")
    assert result.exit_code == 2
    assert "pip install 'vse-gym[tune]'" in said(result)
