"""The command check on other people's estimators, controllers and manoeuvres."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest
from typer.testing import CliRunner

from vse_gym.cli import app
from vse_gym.testing import CONTROLLER_CHECKS, ESTIMATOR_CHECKS, MANOEUVRE_CHECKS

runner = CliRunner()
HONEST = """
import numpy as np
from vse_gym import Estimate, Estimator
from vse_gym.manoeuvres.straight_driving import StraightDriving as _Straight

class NeverSlides(Estimator):
    def init(self, nominal, rng):
        return nominal, Estimate(vx=nominal.speed)

    def update(self, state, reading, rng):
        nominal, last = state
        heard = np.isfinite(reading.wheel_speeds)
        speed = nominal.vehicle.wheel_radius * reading.wheel_speeds[heard].mean() if heard.any() else last.vx
        return nominal, Estimate(vx=float(speed))

    def estimate(self, state):
        return state[1]

class Nests:
    Inner = NeverSlides

class BelievesSilence(NeverSlides):
    def update(self, state, reading, rng):
        return state[0], Estimate(vx=float(reading.wheel_speeds.mean()))

class LosesItsWay(NeverSlides):
    def update(self, state, reading, rng):
        raise LookupError("no [way] out")

class Half(Estimator):
    def init(self, nominal, rng):
        return None

class Greedy(NeverSlides):
    def __init__(self, gain):
        self.gain = gain

class Duck:
    pass

def factory():
    return NeverSlides()

class Straight(_Straight):
    pass

ready = NeverSlides()
SIZE = 500
"""


@pytest.fixture(autouse=True)
def mine(tmp_path, monkeypatch):
    """A folder with a file of one's own in it, in which the command is called."""
    (tmp_path / "mine.py").write_text(HONEST)
    (tmp_path / "broken.py").write_text("1 / 0")
    (tmp_path / "hungry.py").write_text("import no_such_package_at_all")
    (tmp_path / "exits.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    for name in ("mine", "broken", "hungry", "exits"):
        sys.modules.pop(name, None)


def call(*words, command="check"):
    result = runner.invoke(app, [command, *words], catch_exceptions=False)
    return result.exit_code, " ".join(result.output.replace("│", " ").split())


@pytest.mark.parametrize("target", ["mine:NeverSlides", "mine:factory", "mine:ready", "mine:Nests.Inner"])
def test_an_honest_class_instance_or_factory_passes(target):
    code, said = call(target)
    assert code == 0
    assert "verdict: keeps every promise" in said
    assert said.count(" ok ") == len(ESTIMATOR_CHECKS)


@pytest.mark.parametrize(
    ("name", "checks"),
    [("kinematic", ESTIMATOR_CHECKS), ("esc", CONTROLLER_CHECKS), ("held_steer", MANOEUVRE_CHECKS)],
)
def test_a_name_of_the_catalogue_is_checked_check_by_check(name, checks):
    code, said = call(name)
    assert code == 0
    assert said.count(" ok ") == len(checks)
    for check in checks:
        assert check.__name__.removeprefix("check_").replace("_", " ")[:20] in said


def test_a_broken_promise_is_explained_with_what_to_do_about_it():
    code, said = call("mine:BelievesSilence")
    assert code == 1
    assert "survives silence: BelievesSilence with all sensors silent" in said
    assert "expected finite vx and vy: leave silent channels out" in said
    assert "Traceback" not in said


def test_who_raises_is_told_once_for_all_checks_and_where_if_asked():
    code, said = call("mine:LosesItsWay")
    assert code == 1
    assert said.count("raised LookupError: no [way] out") == 1
    assert f"verdict: {len(ESTIMATOR_CHECKS)} promises broken" in said
    code, said = call("mine:LosesItsWay", "--verbose")
    assert code == 1
    assert 'raise LookupError("no [way] out")' in said


WRONG = {
    "mine:Half": "Half lacks estimate, update",
    "mine:Greedy": "name a function without arguments",
    "mine:Duck": "derives neither from Estimator nor from Controller nor from Manoeuvre",
    "mine:SIZE": "neither an Estimator nor a Controller nor a Manoeuvre: 500",
    "mine:Nothing": "it has BelievesSilence, Greedy, LosesItsWay, NeverSlides, Straight, factory, ready",
    "./mine:NeverSlides": "./mine is a path: write mine:NeverSlides",
    "deep/er/mine.py:X": "deep/er/mine.py is a path: write deep.er.mine:X",
    "../mine.py:X": "call the command in .. and write mine:X",
    "mine.NeverSlides": "did you mean mine:NeverSlides?",
    "mine.py": "did you mean mine:Class?",
    "mine.py:NeverSlides": "write mine:NeverSlides",
    "theirs:NeverSlides": "there is no module 'theirs'",
    "theirs.deeper:NeverSlides": "there is no module 'theirs'",
    "broken:X": "it raised ZeroDivisionError",
    "hungry:X": "No module named 'no_such_package_at_all'",
    "exits:X": "it raised SystemExit",
    "kinematik": "did you mean kinematic",
    ":": "write module:Name",
}


@pytest.mark.parametrize("target", WRONG)
def test_what_cannot_be_checked_is_a_sentence_with_exit_code_2(target):
    code, said = call(target)
    assert code == 2
    assert WRONG[target] in said
    assert "Traceback" not in said


RANGE = ("--low", "50", "--high", "60", "--scan", "10", "--tolerance", "10")


@pytest.mark.parametrize(
    "words", [("run", "mine:Straight"), ("entry-speed", "mine:Straight", *RANGE)], ids=["run", "entry-speed"]
)
def test_a_filter_and_a_manoeuvre_of_one_s_own_drive_wherever_those_of_the_catalogue_do(words):
    command, *rest = words
    assert call(*rest, "--estimator", "mine:NeverSlides", command=command)[0] == 0


@pytest.mark.parametrize(
    "words",
    [("run", "straight_driving"), ("entry-speed", "straight_driving"), ("fmvss126",)],
    ids=["run", "entry-speed", "fmvss126"],
)
def test_what_is_no_estimator_or_cannot_be_found_is_a_sentence_everywhere(words):
    command, *rest = words
    for option, target, sentence in (
        ("--estimator", "mine:Nothing", "mine has no 'Nothing'; it has BelievesSilence"),
        ("--estimator", "mine.NeverSlides", "did you mean mine:NeverSlides?"),
        ("--estimator", "theirs:X", "there is no module 'theirs'"),
        ("--controller", "mine:NeverSlides", "mine:NeverSlides makes a NeverSlides, which is no controller"),
    ):
        code, said = call(*rest, option, target, command=command)
        assert code == 2
        assert sentence in said


def test_as_a_program_it_finds_the_current_folder_and_stops_at_ctrl_c(mine):
    (mine / "interrupts.py").write_text(
        dedent("""
        import os, signal
        from mine import NeverSlides

        class Interrupts(NeverSlides):
            def init(self, nominal, rng):
                os.kill(os.getpid(), signal.SIGINT)
                return super().init(nominal, rng)
        """)
    )
    program = [sys.executable, "-m", "vse_gym.cli", "check", "interrupts:Interrupts"]
    result = subprocess.run(program, cwd=mine, env=os.environ, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 130
    assert result.stderr.split() == ["stopped"]
    assert "Traceback" not in result.stdout
