"""The commands bench and report: folders that survive whatever happens."""

import os
import random
import signal
import subprocess
import sys
import time

import polars as pl
import pytest
from typer.testing import CliRunner

from vse_gym.cli import app

SEEDS = "6"


def call(*words):
    return CliRunner().invoke(app, list(map(str, words)), env={"COLUMNS": "200"})


def started(*words):
    """The command in a process group of its own, with its workers."""
    command = [sys.executable, "-m", "vse_gym.cli", *map(str, words)]
    return subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


@pytest.fixture
def unbroken(study_file, tmp_path):
    assert call("bench", study_file, "--seeds", SEEDS, "--out", tmp_path / "unbroken").exit_code == 0
    return (tmp_path / "unbroken" / "runs.parquet").read_bytes()


def test_a_run_that_is_killed_at_ten_random_points_ends_as_if_it_never_had_been(study_file, tmp_path, unbroken):
    out, luck, finished = tmp_path / "out", random.Random(0), []
    for kill in range(10):
        work = started("bench", study_file, "--seeds", SEEDS, "--jobs", "2", "--out", out, "--resume")
        limit = time.monotonic() + 60
        begun = len(finished)
        while time.monotonic() < limit and work.poll() is None:  # until a cell more than last time is there
            finished = list((out / "parts").glob("*.parquet"))
            if len(finished) > begun or kill < 2:  # the first two at any time, also before there is a folder
                break
            time.sleep(0.01)
        time.sleep(luck.uniform(0, 0.3))
        if work.poll() is None:
            os.killpg(work.pid, signal.SIGKILL)
        work.communicate()
    said = call("bench", study_file, "--seeds", SEEDS, "--out", out, "--resume")
    assert said.exit_code == 0, said.output
    assert (out / "runs.parquet").read_bytes() == unbroken


def test_ctrl_c_leaves_a_folder_that_can_be_read_and_gone_on_with(study_file, tmp_path, unbroken):
    out = tmp_path / "out"
    work = started("bench", study_file, "--seeds", "500", "--jobs", "2", "--out", out)
    limit = time.monotonic() + 60
    while len(list((out / "parts").glob("*.parquet"))) < 4 and time.monotonic() < limit:
        time.sleep(0.05)
    os.killpg(work.pid, signal.SIGINT)  # as a terminal does: to all processes of the group
    output, _ = work.communicate(timeout=60)
    assert work.returncode == 130, output
    assert "stopped early" in output and "Traceback" not in output, output
    assert pl.read_parquet(out / "runs.parquet")["seed"].n_unique() >= 1
    assert (out / "table.md").exists()
    assert call("bench", study_file, "--seeds", SEEDS, "--out", out, "--resume").exit_code == 0
    assert (out / "runs.parquet").read_bytes() == unbroken


def test_a_folder_is_neither_overwritten_nor_gone_on_with_unasked(study_file, tmp_path):
    words = ("bench", study_file, "--seeds", "1", "--out", tmp_path / "out")
    assert call(*words).exit_code == 0
    refused = call(*words)
    assert refused.exit_code == 2
    assert "--resume" in refused.output and "--overwrite" in refused.output
    assert call(*words, "--resume").exit_code == call(*words, "--overwrite").exit_code == 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--resume"], "need --out"),
        (["--out", "o", "--resume", "--overwrite"], "give one"),
        (["--backend", "spark"], "loky, ray, dask"),
        (["--estimators", "nowhere:Mine"], "no module"),
        (["--precision", "0"], "--precision"),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, list) else "",
)
def test_options_that_cannot_be_are_a_sentence(study_file, words, sentence):
    said = call("bench", study_file, *words)
    assert said.exit_code == 2
    assert sentence in " ".join(said.output.split())


def test_an_estimator_of_one_s_own_needs_no_name_in_the_catalogue(study_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_filter.py").write_text(
        "from vse_gym.estimators.anchors import ZeroSideslip\nclass Mine(ZeroSideslip): pass\n"
    )
    out = tmp_path / "out"
    said = call("bench", study_file, "--seeds", "1", "--estimators", "truth,my_filter:Mine", "--out", out)
    assert said.exit_code == 0, said.output
    assert set(pl.read_parquet(out / "runs.parquet")["estimator"]) == {"truth", "Mine", "none"}


def test_a_precision_says_whether_it_was_reached(study_file):
    said = call("bench", study_file, "--precision", "0.001", "--max-seeds", "3")
    assert said.exit_code == 0
    assert "with 3 seeds" in said.output
    said = call("bench", study_file, "--precision", "14")
    assert "precision 14 reached" in said.output


def test_report_makes_the_tables_again_of_a_killed_run_too(study_file, tmp_path):
    out = tmp_path / "out"
    assert call("bench", study_file, "--seeds", "2", "--out", out).exit_code == 0
    before = (out / "table.md").read_text().splitlines()[1:]
    for name in ("runs.parquet", "times.parquet", "table.md"):
        (out / name).unlink()
    said = call("report", out)
    assert said.exit_code == 0, said.output
    assert (out / "table.md").read_text().splitlines()[1:] == before


def test_report_of_no_results_is_a_sentence(tmp_path):
    said = call("report", tmp_path)
    assert said.exit_code == 2
    assert "neither runs.parquet nor any finished cell" in " ".join(said.output.split())


def test_a_tuning_of_whom_nobody_judges_is_said(study_file, tmp_path):
    from vse_gym.evaluation.tunings import Tuning

    Tuning("kinematic", {"leak": 1.0}).save(tmp_path / "kinematic.toml")
    said = call("bench", study_file, "--seeds", "1", "--tunings", tmp_path / "kinematic.toml")
    assert said.exit_code == 0
    assert "not used: tunings of kinematic" in " ".join(said.output.split())


def test_a_folder_that_lacks_a_cell_says_so(study_file, tmp_path):
    out = tmp_path / "out"
    assert call("bench", study_file, "--seeds", "2", "--out", out).exit_code == 0
    (out / "runs.parquet").unlink()
    for part in (out / "parts").glob("straight*"):
        part.unlink()
    assert "2 of 4 cells x seeds are driven, none of straight on" in " ".join(call("report", out).output.split())
