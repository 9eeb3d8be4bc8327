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
    assert tuning.origin["outcome"] in said(result)
    assert "mean regret, training, seeds 5000 to 5001: tuned " in said(result)
    assert "mean regret, validation, seeds 5002 to 5011: tuned " in said(result)
    assert f"{tuning.make().leak:.3g}" in result.output
    assert max(map(len, result.output.splitlines())) <= 80


def test_without_a_file_s_name_it_goes_where_all_tunings_lie(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call("kinematic", "--budget", 1, "--study", study)
    assert result.exit_code == 0
    assert "nothing better than the default was found" in said(result)  # there was no other trial
    origin = Tuning.load("tunings/kinematic.toml").origin
    assert origin["validation"]["difference"]["mean"] == 0
    assert origin["outcome"] == "nothing better than the default was found"
    for name in ("training", "validation"):
        assert origin[name]["default"]["low"] >= 0  # regret is not negative


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


def test_what_cannot_be_written_is_found_out_before_the_search(study, tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "tune", lambda *_: pytest.fail("it searched"))
    taken, file = tmp_path / "taken.toml", tmp_path / "file"
    taken.write_text("mine"), file.write_text("no folder")
    for out, sentence in (
        (taken, "taken.toml exists: --overwrite replaces it"),
        (file / "a.toml", "cannot be written"),
    ):
        result = call("kinematic", "--study", study, "--out", out)
        assert result.exit_code == 2
        assert sentence in said(result)
    assert taken.read_text() == "mine"
    with pytest.raises(pytest.fail.Exception):
        call("kinematic", "--study", study, "--out", taken, "--overwrite")


def test_a_tuning_that_cannot_be_saved_after_all_is_shown_whole(study, tmp_path, monkeypatch):
    def full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(Tuning, "save", full)
    result = call("kinematic", "--budget", 1, "--study", study, "--out", tmp_path / "a.toml")
    assert result.exit_code == 2
    assert "could not be written: no space left on device" in said(result)
    shown = result.output[result.output.index('estimator = "kinematic"') : result.output.index("error:")]
    (tmp_path / "shown.toml").write_text(shown)
    assert Tuning.load(tmp_path / "shown.toml").origin["budget"] == 1


def test_a_filter_of_one_s_own_is_tuned_by_module_and_class(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    text = "from vse_gym.estimators.kinematic import KinematicObserver\nclass Mine(KinematicObserver): pass\n"
    (tmp_path / "tuned_filter.py").write_text(text)
    result = call("tuned_filter:Mine", "--budget", 1, "--study", study)
    assert result.exit_code == 0
    tuning = Tuning.load("tunings/Mine.toml")
    assert tuning.estimator == "tuned_filter:Mine" and type(tuning.make()).__name__ == "Mine"
    sys.modules.pop("tuned_filter")


REFUSED = {
    "unknown estimator": (("eckf",), "no estimator named 'eckf'; known: truth"),
    "nothing to tune": (("zero",), "estimator 'zero' has nothing to tune"),
    "unknown study": (("ekf", "--study", "trainning"), "no study named 'trainning'; known: "),
    "a table's study": (("ekf", "--study", "demo"), "study 'demo' is not for tuning"),
    "no budget": (("ekf", "--budget", 0), "budget"),
    "no class": (("vse_gym.metrics:Mine",), "vse_gym.metrics has no 'Mine'; it has"),
    "no estimator": (("vse_gym.manoeuvres.held_steer:HeldSteer",), "makes a HeldSteer, which is no estimator"),
    "no processes": (("ekf", "--jobs", 0), "must be at least 1, or -1 for all cores, not 0"),
    "no file": (("ekf", "--out", "tunings"), "--out needs a file that ends in .toml, not 'tunings'"),
}


@pytest.mark.parametrize(("words", "sentence"), REFUSED.values(), ids=REFUSED)
def test_a_mistake_is_a_sentence(words, sentence):
    result = call(*words)
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.replace("│", " ").split())


def test_without_optuna_it_says_what_to_install(study, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    result = call("kinematic", "--study", study, "--out", tmp_path / "a.toml")
    assert result.exit_code == 2
    assert "pip install 'vse-gym[tune]'" in said(result)
