"""The command line as a stranger meets it."""

import polars as pl
import pytest
from typer.testing import CliRunner

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.cli import app

runner = CliRunner()


def call(*words):
    return runner.invoke(app, list(words), catch_exceptions=False)


@pytest.mark.parametrize("command", [[], ["list"], ["run"], ["bench"]])
def test_every_command_explains_itself(command):
    result = call(*command, "--help")
    assert result.exit_code == 0
    assert "Usage" in result.output


def test_list_names_everything():
    result = call("list")
    assert result.exit_code == 0
    for name in (*ESTIMATORS, *CONTROLLERS, *MANOEUVRES, "qin2014", "cauchy_gaussian", "demo"):
        assert name in result.output


@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
def test_run_drives_and_judges(manoeuvre):
    result = call("run", manoeuvre, "--estimator", "ukf", "--sensors", "loud")
    assert result.exit_code == 0
    assert "verdict: " in result.output


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_run_draws_what_it_drove(tmp_path, ending):
    path = tmp_path / f"drive.{ending}"
    result = call("run", "held_steer", "--amplitude-deg", "30", "--speed-kmh", "60", "--plot", str(path))
    assert result.exit_code == 0
    assert path.stat().st_size > 20_000


def test_a_spin_is_said_with_its_time():
    result = call("run", "sine_with_dwell", "--controller", "none")
    assert "failed" in result.output
    assert "spin" in result.output


WRONG = [
    (["run", "sine"], "known: sine_with_dwell"),
    (["run", "sine_with_dwell", "--estimator", "ekff"], "known: truth"),
    (["run", "sine_with_dwell", "--controller", "abs"], "known: none"),
    (["run", "sine_with_dwell", "--vehicle", "beetle"], "known: bmw_320i, "),
    (["run", "sine_with_dwell", "--sensors", "best"], "known: clean"),
    (["run", "sine_with_dwell", "--friction", "0"], "friction"),
    (["run", "straight_driving", "--amplitude-deg", "10"], "amplitude"),
    (["run", "straight_driving", "--plot", "no/such/folder/a.png"], "no/such/folder"),
    (["run", "straight_driving", "--plot", "a.jpgg"], "jpgg"),
    (["bench", "headlin"], "known: demo"),
    (["run", "straight_driving", "--vehicle", "[bold]x"], "'[bold]x'"),
    (["bench", "demo", "--estimators", "ekf,ukff"], "no estimator named 'ukff'"),
]


@pytest.mark.parametrize(("words", "sentence"), WRONG, ids=lambda x: " ".join(x) if isinstance(x, list) else "")
def test_a_mistake_is_a_sentence_with_the_choices_and_not_a_traceback(words, sentence):
    result = call(*words)
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())


def test_bench_prints_its_tables_and_writes_its_folder(tmp_path):
    study = tmp_path / "mine.toml"
    study.write_text('version = 3\n[[cell]]\nname = "a"\nmanoeuvre = "held_steer"\nsettings = { duration = 1.5 }\n')
    out = tmp_path / "out"
    result = call("bench", str(study), "--estimators", "truth,zero", "--seeds", "2", "--out", str(out))
    assert result.exit_code == 0
    assert "mine, version 3" in result.output
    assert "none (potential)" in result.output
    assert len(pl.read_parquet(out / "runs.parquet")) == 2 * 3
