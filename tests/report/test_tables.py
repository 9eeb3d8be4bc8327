"""The table that ranks, and those beside it, against small tables of which every figure is known."""

import math
from io import StringIO

import numpy as np
import polars as pl
import pytest
from rich.console import Console

from vse_gym.report import LEGEND, by_cell, cells_of, in_blocks, markdown, on_screen, reasons, summary
from vse_gym.report.details import (
    attribution,
    consistency,
    differences,
    false_interventions,
    found,
    gain_and_price,
    gain_by_cell,
    price_by_cell,
    tunings,
)
from vse_gym.report.sections import sections

NAMES = ["truth", "ekf", "a", "none"]


@pytest.fixture
def runs(table):
    """Two cells, eight seeds; the truth's regret is 0."""
    rng = np.random.default_rng(1)
    regret = np.array([0, 2, 5, 4])[:, None, None] + np.abs(rng.normal(0, 1, (4, 8, 2))) * [[[0]], [[1]], [[1]], [[1]]]
    return table(regret, NAMES)


def column(sheet, head):
    """A column by estimator."""
    at = sheet.heads.index(head)
    return {row[0]: row[at] for row in sheet.rows}


def test_the_summary_ranks_by_regret_and_never_ranks_the_uncontrolled_car(runs):
    found = summary(runs)
    assert found["estimator"].to_list() == ["truth", "ekf", "a", "none"]
    assert found["group"].to_list() == ["A", "B", "C", None]
    assert found["rank_best"].to_list() == found["rank_worst"].to_list() == [1, 2, 3, None]
    assert found["improvement"].to_list()[:2] == [1.0, 0.5] and found["improvement"].to_list()[3] is None
    inside = found.filter((pl.col("low") <= pl.col("regret")) & (pl.col("regret") <= pl.col("high")))
    assert len(inside) == 4


def test_renaming_and_reordering_changes_nothing(runs):
    new = {"truth": "x", "a": "truth", "none": "none", "ekf": "ekf"}
    other = summary(runs.sample(fraction=1, shuffle=True, seed=3).with_columns(pl.col("estimator").replace(new)))
    plain = summary(runs).with_columns(pl.col("estimator").replace(new))
    numbers = pl.selectors.numeric()
    assert plain.select(~numbers).equals(other.select(~numbers))
    np.testing.assert_allclose(plain.select(numbers), other.select(numbers), rtol=1e-12)


def test_how_many_drives_ended_badly_stands_beside_the_rank(runs):
    once = (pl.col("estimator") == "a") & (pl.col("seed") == 2) & (pl.col("cell") == "c1")
    found = summary(runs.with_columns(loop_ended=pl.when(once).then(pl.lit("spin")).otherwise(pl.lit(""))))
    paper, screen = cells_of(found), cells_of(found, narrow=True)
    counts = {"truth": "0 of 16", "ekf": "0 of 16", "a": "1 of 16", "none (potential)": "0 of 16"}
    assert column(paper, "ended badly") == counts
    assert paper.heads.index("ended badly") == paper.heads.index("rank") + 1
    assert column(screen, "bad")["a"] == "1"


def test_without_the_baseline_nothing_is_compared_with_it(runs):
    assert summary(runs.filter(pl.col("estimator") != "ekf"))["improvement"].is_nan().sum() == 2


def test_one_seed_is_shown_without_intervals(runs):
    one = runs.filter(pl.col("seed") == 0)
    _, rows = cells_of(summary(one), narrow=True)
    assert [row[2] for row in rows] == ["-"] * 4
    assert [row[3] for row in rows] == ["A", "A", "A", ""]
    assert "One seed gives no intervals." in sections(one, summary(one))[0].text


def test_seeds_that_a_cell_lacks_do_not_count(runs):
    runs = runs.with_columns(shadow_nis=pl.col("seed").cast(pl.Float64))  # so that plain means differ too
    ragged = runs.filter((pl.col("seed") < 7) | (pl.col("cell") == "c0"))
    assert summary(ragged).equals(summary(runs.filter(pl.col("seed") < 7)), null_equal=True)
    assert by_cell(ragged) == by_cell(runs.filter(pl.col("seed") < 7))
    assert "the 7 seeds that every cell has, of 8 begun" in sections(ragged, summary(ragged))[0].text


def test_the_table_for_the_screen_fits_eighty_columns(table):
    regret = np.random.default_rng(2).uniform(9, 14, (4, 6, 2))
    runs = table(regret, ["pf_cauchy_gaussian", "ekf", "truth_velocity", "none"], shadow_update_us=1234.0)
    screen = Console(width=80, record=True, file=StringIO())
    screen.print(on_screen(*cells_of(summary(runs), narrow=True), title="", whole=3))
    text = screen.export_text()
    assert "pf_cauchy_gaussian" in text and "none (potential)" in text and "1234" in text and "…" not in text
    assert max(map(len, LEGEND.splitlines())) <= 80


def test_a_study_of_ten_cells_fits_eighty_columns_in_blocks(table):
    regret = np.random.default_rng(2).uniform(9, 14, (2, 2, 10))
    runs = table(regret, ["pf_cauchy_gaussian", "ekf"])
    long = runs.with_columns(cell=pl.lit("held steer, friction jump, ") + pl.col("cell"))
    blocks = in_blocks(*by_cell(long))
    assert [len(block.heads) for block in blocks] == [6, 6]
    assert [head for block in blocks for head in block.heads[1:]] == by_cell(long).heads[1:]
    assert [a + b[1:] for a, b in zip(blocks[0].rows, blocks[1].rows, strict=True)] == by_cell(long).rows
    screen = Console(width=80, record=True, file=StringIO())
    for block in blocks:
        screen.print(on_screen(*block, title=""))
    assert "…" not in screen.export_text()


def test_why_drives_ended_is_counted_and_a_spin_is_no_reason(runs):
    ended = (
        pl.when((pl.col("estimator") == "a") & (pl.col("seed") < 2)).then(pl.lit("raised")).otherwise(pl.lit("spin"))
    )
    assert reasons(runs.with_columns(loop_ended=ended)) == ["a: 4 drives ended early, raised"]


def test_markdown_keeps_a_bar_inside_its_field():
    assert markdown(["a|b", "c"], [["1", "2"]]).splitlines()[0] == "| a\\|b | c |"


def test_differences_are_means_over_cells_of_paired_differences(runs):
    seeds = pl.col("seed").cast(pl.Float64)
    found = differences(runs.with_columns(loop_peak_sideslip_deg_diff=seeds, loop_path_deviation_m=pl.lit(0.25)))
    assert [row[0] for row in found.rows] == ["ekf", "a", "none"]
    assert all(text.startswith("+3.50 (+1.") for text in column(found, "peak sideslip deg").values())
    assert set(column(found, "path m, to either side").values()) == {"0.25 (0.25 to 0.25)"}
    assert set(column(found, "brake energy kJ").values()) == {"-"}  # no such column in this table


def test_a_single_missing_figure_leaves_a_mean_without_an_interval(runs):
    first = (pl.col("seed") == 0) & (pl.col("cell") == "c0")
    figures = pl.when(first & (pl.col("estimator") == "a")).then(None).otherwise(pl.lit(2.0))
    found = column(differences(runs.with_columns(loop_peak_sideslip_deg_diff=figures)), "peak sideslip deg")
    assert found["a"] == "+2.00" and found["ekf"] == "+2.00 (+2.00 to +2.00)"


def test_one_collapsed_filter_does_not_spoil_the_nees_of_the_others(runs):
    collapsed = pl.when(pl.col("seed") == 0).then(1e6).otherwise(1.5)
    found = consistency(summary(runs.with_columns(shadow_nees=collapsed, shadow_nis=pl.lit(float("nan")))))
    assert column(found, "NEES, median") == {"ekf": "1.5", "a": "1.5"}
    assert column(found, "NIS") == {"ekf": "-", "a": "-"}


def driven(runs):
    """With drives: the car without control spins in half of them and brakes nothing."""
    alone, odd = pl.col("estimator") == "none", pl.col("seed") % 2 == 1
    return runs.with_columns(
        loop_ended=pl.when(alone & odd).then(pl.lit("spin")).otherwise(pl.lit("")),
        loop_peak_sideslip_deg=pl.when(alone).then(pl.lit(40.0)).otherwise(pl.lit(5.0)),
        loop_brake_energy_kJ=pl.when(alone).then(pl.lit(0.0)).otherwise(pl.lit(60.0)),
        loop_speed_lost_mps=pl.lit(2.0),
    )


def test_gain_and_price_are_against_the_same_drive_without_control(runs):
    found = gain_and_price(driven(runs))
    assert column(found, "ended badly %")["a"] == "0" and column(found, "without control %")["a"] == "50"
    assert column(found, "peak sideslip deg, more")["a"] == "-35.0 (-35.0 to -35.0)"
    assert column(found, "brake energy kJ, more")["a"] == "+60.0 (+60.0 to +60.0)"
    assert gain_by_cell(driven(runs)).rows[-1] == ["none", "50 %, 40.0 deg", "50 %, 40.0 deg"]
    assert price_by_cell(driven(runs)).heads[1] == "c0 (esc)"
    assert price_by_cell(driven(runs)).rows[0][1] == "60 kJ, 2.0 m/s"


def test_gain_and_price_are_by_controller_and_not_of_benign_drives(runs):
    both = driven(runs).with_columns(controller=pl.concat_str(pl.lit("of "), "cell"), benign=pl.col("cell") == "c1")
    assert set(column(gain_and_price(both), "controller").values()) == {"of c0"}
    assert gain_and_price(both.filter(pl.col("estimator") != "none")) is None
    assert gain_and_price(both.filter("benign")) is None


def test_false_interventions_are_counted_in_benign_drives_alone(runs):
    benign = pl.col("cell") == "c1"
    braked = pl.when((pl.col("estimator") == "a") & (pl.col("seed") < 2)).then(pl.lit(0.5)).otherwise(pl.lit(0.0))
    found = false_interventions(runs.with_columns(benign=benign, loop_intervention_s=braked))
    assert column(found, "drives with any %")["a"].startswith("25 (")
    assert column(found, "drives with any %")["truth"] == "0 (0 to 0)"
    assert "none" not in column(found, "time s")
    assert false_interventions(runs) is None


def test_attribution_sets_the_parts_beside_the_whole(runs):
    mine = runs.filter(pl.col("estimator") == "a")
    parts = [
        mine.with_columns(estimator=pl.lit(f"a: {part}"), part=pl.lit(part), parent=pl.lit("a"), regret=pl.lit(figure))
        for part, figure in (("velocity", 3.0), ("yaw", 1.0), ("acceleration", 0.5))
    ]
    whole = runs.with_columns(part=pl.lit("whole"), parent=pl.col("estimator"))
    both = pl.concat([whole, *parts])
    (row,) = attribution(both).rows
    assert row[:2] == ["a", "esc"]
    assert row[3:] == ["3.00 (3.00 to 3.00)", "1.00 (1.00 to 1.00)", "0.50 (0.50 to 0.50)"]
    assert row[2].startswith(f"{mine['regret'].mean():.2f} (")
    assert summary(both).equals(summary(runs), null_equal=True)  # parts are not ranked
    only = attribution(pl.concat([whole, parts[1]])).rows
    assert only[0][3:] == ["-", "1.00 (1.00 to 1.00)", "-"]
    assert attribution(whole) is None and attribution(runs) is None


def test_which_tuning_each_row_used_is_said(runs):
    used = pl.when(pl.col("estimator") == "a").then(pl.lit("a.toml 1a2b")).otherwise(pl.lit("default"))
    assert tunings(runs.with_columns(tuning=used)).rows == [
        ["truth", "default"],
        ["ekf", "default"],
        ["a", "a.toml 1a2b"],
    ]
    assert tunings(runs) is None


def test_what_estimators_find_is_a_row_for_each_that_finds_it(table):
    runs = table(np.zeros((2, 6, 2)), ["ekf", "finder"])
    assert found(runs) is None
    finder = pl.col("estimator") == "finder"
    figures = {"rmse_kg": 30.0, "sheet_rmse_kg": 130.0, "final_kg": -12.0, "coverage_percent": 80.0}
    runs = runs.with_columns(
        pl.when(finder).then(value).otherwise(math.nan).alias(f"shadow_mass_{name}") for name, value in figures.items()
    )
    assert found(runs).rows == [["finder", "mass kg", "30", "130", "-12", "80"]]
