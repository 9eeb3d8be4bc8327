"""A folder of results: whole parts or none, gone on with to the same end, and nothing swallowed."""

import errno
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from vse_gym import vehicles
from vse_gym.evaluation import (
    TIMES,
    Bench,
    Results,
    ResultsError,
    contenders,
    evaluate,
    provenance,
    read_runs,
    unfinished,
)
from vse_gym.evaluation import results as module
from vse_gym.evaluation.runs import run_cell

JUDGED = contenders(["truth", "ekf"])


def untimed(runs):
    return runs.drop(TIMES)


def same(a, b):
    return untimed(a).equals(untimed(b), null_equal=True)


def bench(study, folder, judged=JUDGED, seeds=2, **options):
    return Bench(study, judged, seeds, finished=Results(folder, study, judged, seeds=seeds, **options))


@pytest.fixture(scope="module")
def unbroken(short):
    return evaluate(short)


@pytest.fixture
def folder(short, tmp_path):
    """Results of half a study."""
    work = bench(short, tmp_path / "out", seeds=1)
    work.drive()
    return tmp_path / "out"


def test_what_is_gone_on_with_ends_as_if_it_had_never_stopped(short, folder, unbroken):
    work = bench(short, folder, resume=True)
    assert len(work.tasks()) == 2
    work.drive()
    assert same(work.runs, unbroken)


def test_what_is_finished_is_not_driven_again(short, folder):
    assert bench(short, folder, seeds=1, resume=True).tasks() == []


def test_an_estimator_that_is_added_is_driven_alone_and_gets_the_same_rows(short, folder):
    added = contenders(["truth", "ekf", "zero"])
    work = bench(short, folder, added, seeds=1, resume=True)
    assert [(t[1].name, [c.name for c in t[3]], t[4]) for t in work.tasks()] == [
        (cell.name, ["zero"], False) for cell in short.cells
    ]
    work.drive()
    assert same(work.runs, evaluate(short, ["truth", "ekf", "zero"], seeds=1))


def test_another_tuning_under_the_same_name_is_driven_and_takes_the_old_one_s_place(short, folder):
    tuned = contenders(["truth", "ekf"], {"ekf": (_with_more_noise(), "mine")})
    work = bench(short, folder, tuned, seeds=1, resume=True)
    assert [[c.name for c in t[3]] for t in work.tasks()] == [["ekf"], ["ekf"]]
    work.drive()
    runs = work.runs
    assert len(runs) == len(bench(short, folder, seeds=1, resume=True).runs) == 2 * 3
    assert set(runs.filter(pl.col("estimator") == "ekf")["tuning"]) == {"mine"}


def _with_more_noise():
    plain = JUDGED[1].estimator
    return replace(plain, model=replace(plain.model, vy_noise=3.0))


@pytest.mark.parametrize("harm", ["cut short", "a bit turned", "emptied"])
def test_a_damaged_part_is_said_set_aside_and_driven_again(short, folder, harm):
    part = sorted((folder / "parts").glob("*.parquet"))[0]
    content = bytearray(part.read_bytes())
    content[len(content) // 2] ^= 1
    part.write_bytes({"cut short": content[:-100], "a bit turned": content, "emptied": b""}[harm])
    work = bench(short, folder, seeds=1, resume=True)
    assert work.finished.damaged == [str(part.with_suffix(".damaged"))]
    assert len(work.tasks()) == 1
    work.drive()
    assert same(work.runs, evaluate(short, seeds=1))


def test_a_part_that_was_being_written_when_the_run_was_killed_is_swept_away(short, folder):
    dead, alive = (folder / "parts" / f".held-0000-abc.parquet.{pid}" for pid in (2**22 + 1, os.getpid()))
    dead.write_bytes(b"half")  # of a number that no process has
    alive.write_bytes(b"half")  # somebody is writing there at this moment
    assert bench(short, folder, seeds=1, resume=True).tasks() == []
    assert [path for path in (folder / "parts").iterdir() if path.suffix != ".parquet"] == [alive]


def test_a_full_disk_is_said_and_leaves_what_was_there(short, folder, monkeypatch):
    before = {path.name for path in (folder / "parts").iterdir()}

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        bench(short, folder, resume=True).drive()
    assert {path.name for path in (folder / "parts").iterdir()} == before


def test_results_are_not_overwritten_by_oversight(short, folder):
    with pytest.raises(ResultsError, match=r"--resume goes on.*--overwrite"):
        Results(folder, short)
    assert Results(folder, short, overwrite=True).missing("short", 0, JUDGED) == (JUDGED, True)


def test_results_of_other_drives_are_not_gone_on_with(short, folder):
    other = replace(short, cells=short.cells[:1])
    with pytest.raises(ResultsError, match="other cells or draws"):
        Results(folder, other, resume=True)


def test_results_of_other_code_are_not_gone_on_with(short, folder, monkeypatch):
    monkeypatch.setattr(module, "source_digest", lambda: "0123456789ab")
    with pytest.raises(ResultsError, match="another state of the code"):
        Results(folder, short, resume=True)


@pytest.mark.parametrize("text", ["", "{", "[1]", None])
def test_a_manifest_that_cannot_be_read_is_said(short, folder, text):
    (folder / "run.json").unlink() if text is None else (folder / "run.json").write_text(text)
    with pytest.raises(ResultsError, match="cannot be read"):
        Results(folder, short, resume=True)


def test_a_file_is_no_folder(short, tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(ResultsError, match="is a file"):
        Results(tmp_path / "out", short)


def test_times_and_machine_lie_apart_and_come_back_when_read(short, tmp_path):
    runs = evaluate(short, seeds=1, out=tmp_path)
    stored = pl.read_parquet(tmp_path / "runs.parquet")
    assert not set(TIMES) & set(stored.columns)
    assert set(TIMES) < set(pl.read_parquet(tmp_path / "times.parquet").columns)
    back = read_runs(tmp_path)
    assert back.select(runs.columns).equals(runs, null_equal=True)


def test_two_runs_with_the_same_seeds_write_the_same_bytes(short, tmp_path):
    for name in ("a", "b"):
        evaluate(short, seeds=1, out=tmp_path / name)
    assert (tmp_path / "a" / "runs.parquet").read_bytes() == (tmp_path / "b" / "runs.parquet").read_bytes()


def test_a_killed_run_s_folder_can_be_read(short, folder):
    assert same(read_runs(folder), evaluate(short, seeds=1))


def test_a_folder_without_results_is_said(tmp_path):
    with pytest.raises(ResultsError, match="neither"):
        read_runs(tmp_path)
    with pytest.raises(ResultsError, match="no folder"):
        read_runs(tmp_path / "nowhere")


def test_a_row_says_where_it_comes_from(short, folder):
    row = run_cell(short, short.cells[0], 0, JUDGED)[2]
    assert row["package"] == provenance.package_version()
    assert row["commit"] == provenance.commit()
    assert "commit" in TIMES  # a run that is gone on with after a commit to the README is the same run
    assert row["study_digest"] == short.digest
    assert row["machine"] == provenance.machine()
    assert (row["estimator"], row["parent"], row["part"], row["tuning"]) == ("ekf", "ekf", "whole", "default")


def test_the_manifest_says_what_was_driven_by_whom(short, tmp_path):
    evaluate(short, seeds=1, out=tmp_path)
    told = json.loads((tmp_path / "run.json").read_text())
    assert told["study"] == "short" and told["study_digest"] == short.digest
    assert list(told["tunings"]) == ["truth", "ekf"]
    assert told["source"] == provenance.source_digest()


def test_the_digest_of_the_source_is_that_of_its_files(monkeypatch, tmp_path):
    def digest():
        provenance.source_digest.cache_clear()
        return provenance.source_digest()

    monkeypatch.setattr(provenance, "PACKAGE", Path(tmp_path))
    (tmp_path / "a.py").write_text("one")
    first = digest()
    assert digest() == first
    (tmp_path / "a.py").write_text("two")
    assert digest() != first
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    second = digest()
    (tmp_path / "b.py").write_text("one")
    assert digest() not in (first, second)
    monkeypatch.undo()
    provenance.source_digest.cache_clear()


def test_a_vehicle_file_that_changes_is_another_study(short, tmp_path):
    car = tmp_path / "car.toml"
    text = (vehicles.FOLDER / "bmw_320i.toml").read_text()
    car.write_text(text)
    study = replace(short, cells=(replace(short.cells[0], vehicle=str(car)),))
    before = study.digest
    assert study.digest == before
    heavier = re.sub(r"^mass = \S+", "mass = 1900.0", text, flags=re.MULTILINE)
    assert heavier != text
    car.write_text(heavier)
    assert study.digest != before


def test_results_made_with_other_libraries_are_not_gone_on_with(short, folder, monkeypatch):
    monkeypatch.setattr(module, "libraries", lambda: "numpy 1.0")
    with pytest.raises(ResultsError, match="made with numpy"):
        Results(folder, short, JUDGED, resume=True)


def test_what_a_killed_second_run_had_finished_is_read(short, tmp_path):
    out = tmp_path / "out"
    evaluate(short, ["truth"], seeds=1, out=out)
    work = bench(short, out, seeds=2, resume=True)  # killed before it wrote its tables
    work.drive()
    assert same(read_runs(out), evaluate(short))


def test_a_part_that_was_altered_is_not_read(short, folder):
    part = sorted((folder / "parts").glob("*.parquet"))[0]
    part.write_bytes(part.read_bytes()[:-100])
    assert read_runs(folder)["cell"].n_unique() == 1


def test_the_label_of_a_tuning_is_today_s(short, folder):
    default = JUDGED[1].estimator
    named = contenders(["truth", "ekf"], {"ekf": (default, "mine")})
    work = bench(short, folder, named, seeds=1, resume=True)
    assert work.tasks() == []  # the settings are the same
    assert set(work.runs.filter(pl.col("estimator") == "ekf")["tuning"]) == {"mine"}


def test_who_is_added_later_stands_beside_those_who_were_there(short, folder):
    work = bench(short, folder, contenders(["zero"]), seeds=1, resume=True)
    work.drive()
    assert work.runs["estimator"].unique().sort().to_list() == ["none", "zero"]
    everybody = work.finished.everybody(work.numbers)
    assert same(everybody, evaluate(short, ["truth", "ekf", "zero"], seeds=1))
    assert list(json.loads((folder / "run.json").read_text())["tunings"]) == ["truth", "ekf", "zero"]


def test_evaluate_gives_those_asked_for_and_the_folder_keeps_all(short, tmp_path):
    evaluate(short, ["truth"], seeds=1, out=tmp_path)
    runs = evaluate(short, ["zero"], seeds=1, out=tmp_path)
    assert runs["estimator"].unique().sort().to_list() == ["none", "zero"]
    assert read_runs(tmp_path)["estimator"].unique().sort().to_list() == ["none", "truth", "zero"]


def test_what_is_missing_is_said(short, folder):
    assert unfinished(read_runs(folder), folder) == ""
    part = next((folder / "parts").glob("gentle*"))
    part.unlink()
    assert "1 of 2" in unfinished(read_runs(folder), folder) and "Gentle, 90" in unfinished(read_runs(folder), folder)


def test_overwriting_leaves_nothing_of_the_old_tables(short, folder):
    for name in ("table.md", "question.png", "report.html", "runs.parquet"):
        (folder / name).write_text("old")
    Results(folder, short, JUDGED, overwrite=True)
    assert {path.name for path in folder.iterdir()} == {"parts", "run.json"}
