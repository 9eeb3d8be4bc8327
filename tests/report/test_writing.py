"""The folder of a study that was driven: what is in it, and that it opens anywhere."""

import sys

import polars as pl
import pytest

from vse_gym.evaluation import Cell, Study, evaluate
from vse_gym.report import by_cell, cells_of, markdown, summary, write, write_tables

FIGURES = {"regret.png", "ranks.png", "improvement.png"}


@pytest.fixture(scope="module")
def runs():
    settings = {"speed_kmh": 80, "amplitude_deg": 120, "friction": 0.5, "duration": 2.0}
    cells = (Cell("short", "sine_with_dwell", settings=settings), Cell("easy <b>", "straight_driving", benign=True))
    return evaluate(Study("short", 1, cells, seeds=2), ["truth", "ekf", "zero"])


def test_what_is_written_can_be_read_again(runs, tmp_path):
    write(runs, tmp_path / "out", "a command")
    assert pl.read_parquet(tmp_path / "out" / "runs.parquet").equals(runs, null_equal=True)
    text = (tmp_path / "out" / "table.md").read_text()
    assert "a command" in text and markdown(*cells_of(summary(runs))) in text and markdown(*by_cell(runs)) in text
    for name in FIGURES:
        assert (tmp_path / "out" / name).stat().st_size > 5000


def test_the_page_shows_the_same_tables_and_opens_without_a_network(runs, tmp_path):
    write_tables(runs, tmp_path, "a <command>")
    assert {path.name for path in tmp_path.iterdir()} == {
        "table.md",
        "question.md",
        "report.html",
        "plotly.min.js",
        *FIGURES,
    }
    text, page = ((tmp_path / name).read_text() for name in ("table.md", "report.html"))
    assert "<code>none</code> is the car without stability control" in page and "`none`" not in page
    assert "a &lt;command&gt;" in page and "<td>easy <b>" not in page
    titles = [line.removeprefix("## ") for line in text.splitlines() if line.startswith("## ")]
    assert len(titles) >= 7 and all(f"<h2>{title}</h2>" in page for title in titles)
    assert all(f"<td>{name}</td>" in page for name in ("truth", "ekf", "zero"))
    assert '<script src="plotly.min.js">' in page and page.count("Plotly.newPlot") == 4
    assert "http" not in page.replace("http://www.w3.org", "").replace("https://plotly.com", "")
    assert (tmp_path / "plotly.min.js").stat().st_size > 1_000_000


def test_without_the_extra_report_the_tables_are_written_all_the_same(runs, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    write(runs, tmp_path, "a command")
    assert {path.name for path in tmp_path.iterdir()} == {"runs.parquet", "table.md", "question.md"}
    assert "This table does not say: a rank correlation needs three" in (tmp_path / "question.md").read_text()


def test_an_estimator_without_a_single_drive_is_in_every_table(runs, tmp_path):
    # one that raises on the first reading has regret, and nothing else
    measured = [c for c in runs.columns if c.startswith(("loop_", "shadow_")) and runs[c].dtype == pl.Float64]
    never = pl.col("estimator") == "zero"
    broken = runs.with_columns(*(pl.when(never).then(None).otherwise(pl.col(c)).alias(c) for c in measured))
    write_tables(broken.with_columns(regret=pl.when(never).then(14.0).otherwise("regret")), tmp_path, "a command")
    assert "| zero | 14.00 | 14.00 to 14.00 |" in (tmp_path / "table.md").read_text()


def test_one_run_is_enough_for_a_folder(runs, tmp_path):
    one = runs.filter((pl.col("seed") == 0) & (pl.col("cell") == "short") & (pl.col("estimator") == "ekf"))
    write_tables(one, tmp_path, "a command")
    assert "One seed gives no intervals" in (tmp_path / "table.md").read_text()
