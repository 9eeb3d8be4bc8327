"""The command compare, as a stranger meets it."""

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from vse_gym.cli import app

runner = CliRunner()
LONG = "sine with dwell under heavy tails and bias"


def call(*words):
    return runner.invoke(app, ["compare", *map(str, words)], catch_exceptions=False)


@pytest.fixture
def results(tmp_path):
    """Two folders, of which the second costs the particle filter 0.5 more in every cell."""
    rng = np.random.default_rng(0)
    names, cells = ("ekf", "pf_cauchy_gaussian", "ekf:velocity"), (LONG, "curve [dry]")
    keys = [
        {"cell": c, "seed": s, "estimator": e, "regret": 9.9 + rng.normal()}
        for c in cells
        for s in range(8)
        for e in names
    ]
    table = pl.DataFrame(keys).with_columns(
        loop_ended=pl.lit(""), shadow_sideslip_rmse_deg=1.0, study_digest=pl.lit("d")
    )
    table = table.with_columns(commit=pl.lit("aaaa"))
    more = pl.when(pl.col("estimator") == names[1]).then(0.5).otherwise(0.0)
    for name, frame in (("a", table), ("b", table.with_columns(pl.col("regret") + more, commit=pl.lit("bbbb")))):
        (tmp_path / name).mkdir()
        frame.write_parquet(tmp_path / name / "runs.parquet")
    return tmp_path / "a", tmp_path / "b"


def test_what_changed_is_shown_within_80_columns_and_exits_with_0(results):
    result = call(*results)
    assert result.exit_code == 0
    said = " ".join(result.output.split())
    assert "commit: aaaa in A, bbbb in B" in said
    assert "not bit-equal: 16 differ, in regret" in said
    row = next(line for line in result.output.splitlines() if line.lstrip("│ ").startswith("pf_cauchy_gaussian"))
    assert "+0.50" in row and "0.50 to 0.50" in row and "worse" in row
    assert "No difference, for any estimator: shadow: RMSE of sideslip, deg; drives that ended badly, %." in said
    shown = [line for line in result.output.splitlines() if not any(str(path) in line for path in results)]
    assert max(map(len, shown)) <= 80 and "…" not in result.output


def test_a_folder_and_itself_are_said_to_be_equal(results):
    result = call(results[0], results[0])
    assert result.exit_code == 0
    assert "The 48 common runs are bit-equal" in " ".join(result.output.split())
    assert "worse" not in result.output.split("B - A: mean")[0]


def test_by_cell_shows_every_cell_with_its_name_as_it_is(results):
    result = call(*results, "--by-cell")
    rows = result.output.split("regret in all cells")[1]
    assert rows.count("ekf:velocity") == 2 and "[dry]" in rows
    assert max(map(len, rows.splitlines())) <= 80


def test_the_same_is_written_as_markdown(results, tmp_path):
    out = tmp_path / "new" / "changes.md"
    result = call(*results, "--out", out)
    text = out.read_text()
    assert result.exit_code == 0 and "written:" in result.output
    assert "- commit: aaaa in A, bbbb in B" in text
    assert "| pf_cauchy_gaussian |" in text and "| +0.50 | 0.50 to 0.50 | worse |" in text
    assert f"| {LONG} | pf_cauchy_gaussian |" in text


def test_a_mistake_is_a_sentence_with_exit_code_2(results, tmp_path):
    damaged = tmp_path / "damaged.parquet"
    damaged.write_bytes(b"no parquet")
    alone = tmp_path / "alone.parquet"
    pl.read_parquet(results[0] / "runs.parquet").with_columns(pl.col("cell") + ", other").write_parquet(alone)
    wrong = [
        ((results[0], tmp_path / "nowhere"), "there is no"),
        ((tmp_path, results[0]), "holds no runs.parquet"),
        ((results[0], damaged), "damaged"),
        ((results[0], alone), "no run in common"),
        ((*results, "--out", tmp_path), "directory"),
        ((results[0],), "Missing argument"),
    ]
    for words, sentence in wrong:
        result = call(*words)
        assert result.exit_code == 2
        assert sentence in " ".join(result.output.replace("│", " ").split())
