"""The command line as a stranger meets it."""

import re
import sys

import polars as pl
import pytest
from typer.testing import CliRunner

from vse_gym import vehicles
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.cli import app
from vse_gym.evaluation import study_names
from vse_gym.sensors import SUITES

COMMANDS = ("list", "run", "bench", "fmvss126", "entry-speed", "check", "tune")
runner = CliRunner()


def call(*words):
    return runner.invoke(app, list(words), catch_exceptions=False)


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_every_command_explains_itself(command):
    result = call(*command, "--help")
    assert result.exit_code == 0
    assert "Usage" in result.output


def test_the_help_of_all_names_every_command():
    output = call("--help").output
    assert all(name in output for name in COMMANDS)


def test_list_names_everything_and_says_what_it_is():
    result = call("list")
    assert result.exit_code == 0
    for name in (*ESTIMATORS, *CONTROLLERS, *MANOEUVRES, *vehicles.names(), *SUITES, *study_names()):
        # Long names are cut off on a screen of 80 columns.
        (line,) = [line for line in result.output.splitlines() if f"│ {name[:23]} " in line]
        assert len(line.split("│")[3].strip()) > 5


def test_list_says_of_a_car_the_head_of_its_file_and_of_a_suite_how_it_differs():
    said = " ".join(call("list").output.replace("│", " ").split())
    assert "so that it understeers like a production car." in said
    assert "Li, Li, Cao, Trans. CSAM 45(10), 2014" in said  # an abbreviation ends no sentence
    assert "A first look, in seconds: four drives and ten seeds. " in said
    assert "Too few for a ranking" not in said
    assert "no noise" in said
    assert "0.05 m/s2, 0.1 deg/s; silence rate 0.5" in said


@pytest.mark.parametrize("kind", ["estimators", "estimator"])
def test_list_shows_one_kind_alone_if_asked(kind):
    result = call("list", kind)
    assert result.exit_code == 0
    assert {line.split("│")[1].strip() for line in result.output.splitlines() if "│" in line} <= {"estimator", ""}
    assert all(f"│ {name[:23]} " in result.output for name in ESTIMATORS)


def test_run_says_what_a_drive_cost_in_words_with_units():
    said = " ".join(call("run", "straight_driving").output.replace("│", " ").split())
    for row in (r"peak sideslip [\d.]+ deg", "spin no", r"brake energy [\d.]+ kJ", r"speed lost [-\d.]+ m/s"):
        assert re.search(row, said)
    assert "_" not in said.partition("limit")[2].partition("verdict")[0].replace("straight_driving", "")


def test_ctrl_c_is_a_word_and_its_exit_code(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("vse_gym.simulation.rollout", interrupted)
    result = call("run", "straight_driving")
    assert result.exit_code == 130
    assert result.output.split() == ["stopped"]


def test_without_matplotlib_a_sentence_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    result = call("run", "straight_driving", "--plot", str(tmp_path / "a.png"))
    assert result.exit_code == 2
    assert "pip install 'vse-gym[report]'" in " ".join(result.output.split())


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
    (["run", "straight_driving", "--plot", "tests"], "ending"),
    (["run", "straight_driving", "--plot", "a.jpgg"], "jpgg"),
    (["bench", "headlin"], "known: attribution-v1, demo"),
    (["run", "straight_driving", "--vehicle", "[bold]x"], "'[bold]x'"),
    (["bench", "demo", "--estimators", "ekf,ukff"], "no estimator named 'ukff'"),
    (["run", "sine_with_dwell", "--speed-kmh", "80kmh"], "--speed-kmh"),
    (["run", "sine_with_dwell", "--speed-kmh", "-80"], "speed must be positive"),
    (["run", "sine_with_dwell", "--vehicle", "tests"], "known: "),
    (["run", "sine_with_dwell", "--vehicle", "mine.toml"], "the path of a .toml file"),
    (["list", "cars"], "known: estimators, controllers, manoeuvres, vehicles, sensors, studies"),
    (["bench", "demo", "--jobs", "0"], "must be at least 1, or -1 for all cores, not 0"),
    (["bench", "demo", "--tunings", "nothere"], "there is no tunings file or folder nothere"),
    (["drive"], "No such command"),
]


@pytest.mark.parametrize(("words", "sentence"), WRONG, ids=lambda x: " ".join(x) if isinstance(x, list) else "")
def test_a_mistake_is_a_sentence_with_the_choices_and_not_a_traceback(words, sentence):
    result = call(*words)
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.replace("│", " ").split())


def test_bench_prints_its_tables_and_writes_its_folder(tmp_path):
    study = tmp_path / "mine.toml"
    study.write_text('version = 3\n[[cell]]\nname = "a"\nmanoeuvre = "held_steer"\nsettings = { duration = 1.5 }\n')
    out = tmp_path / "out"
    result = call("bench", str(study), "--estimators", "truth,zero", "--seeds", "2", "--out", str(out))
    assert result.exit_code == 0
    assert "mine, version 3" in result.output
    assert "none (potential)" in result.output
    assert len(pl.read_parquet(out / "runs.parquet")) == 2 * 3
