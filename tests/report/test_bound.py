"""Multiples of the bound: the right mean, an interval that covers, and nobody flattered by a drive given up."""

import math
from io import StringIO

import numpy as np
import polars as pl
import pytest
from rich.console import Console

from vse_gym.report import on_screen
from vse_gym.report.bound import ERRORS, bound_cells, bound_figure, multiples


def rows(name, sideslip, vx=None, cell="a", ended=""):
    vx = sideslip if vx is None else vx
    fixed = {"cell": cell, "estimator": name, "model": "SingleTrack", "bound_sideslip_deg": 0.5, "bound_vx_mps": 0.1}
    fixed |= {"bound_error_percent": 0.1, "shadow_nees": 1.0, "shadow_coverage_percent": 95.0, "shadow_update_us": 5.0}
    return [
        fixed | {"seed": k, "shadow_sideslip_rmse_deg": s, "shadow_vx_rmse_mps": v, "shadow_ended": ended}
        for k, (s, v) in enumerate(zip(sideslip, vx, strict=True))
    ]


def test_a_multiple_is_the_root_of_the_mean_square_over_the_bound():
    (row,) = multiples(pl.DataFrame(rows("one", [0.3, 0.4], [0.1, 0.2]))).iter_rows(named=True)
    assert row["sideslip"] == pytest.approx(math.sqrt((0.09 + 0.16) / 2) / 0.5, rel=1e-12)
    assert row["vx"] == pytest.approx(math.sqrt(0.025) / 0.1, rel=1e-12)
    assert row["seeds"] == 2 and row["ended"] == 0


@pytest.mark.parametrize("seeds", [3, 8, 20])
def test_the_interval_covers_as_often_as_it_says(seeds):
    # Errors of an estimator at 1.2 times the bound: each seed's mean square of 40 independent errors.
    rng = np.random.default_rng(0)
    errors = 0.6 * np.sqrt(rng.chisquare(40, (200, seeds)) / 40)
    found = multiples(pl.DataFrame([row for k, own in enumerate(errors) for row in rows(f"e{k}", own.tolist())]))
    inside = ((found["sideslip_low"] <= 1.2) & (found["sideslip_high"] >= 1.2)).mean()
    assert inside == pytest.approx(0.95, abs=3 * math.sqrt(0.05 * 0.95 / 200))  # three standard deviations


def test_every_seed_counts_with_its_own_bound():
    runs = pl.DataFrame(rows("one", [0.5, 1.0])).with_columns(bound_sideslip_deg=pl.Series([0.5, 1.0]))
    row = multiples(runs).row(0, named=True)
    assert row["sideslip"] == pytest.approx(1, rel=1e-12)
    assert row["bound_sideslip_deg"] == pytest.approx(math.sqrt((0.25 + 1) / 2), rel=1e-12)


def test_who_gives_up_a_drive_has_no_multiple_and_says_so():
    runs = pl.DataFrame(rows("sound", [0.5, 0.6]) + rows("broken", [0.5]) + rows("broken", [None], ended="raised"))
    times = multiples(runs)
    assert times["estimator"].to_list() == ["sound", "broken"]  # what is no number comes last
    broken = times.row(1, named=True)
    assert math.isnan(broken["sideslip"]) and broken["ended"] == 1
    heads, texts = bound_cells(times)
    assert texts[1][1] == "broken (1 of 2 drives given up)" and texts[1][2:4] == ["SingleTrack", "-"]
    assert all(len(text) == len(heads) for text in texts)


def test_the_table_for_the_screen_fits_eighty_columns_and_names_the_model():
    runs = rows("pf_cauchy_gaussian", [0.5, 0.6]) + rows("ekf_cauchy_gaussian", [12.5, None], ended="raised")
    screen = Console(width=80, record=True, file=StringIO())
    screen.print(on_screen(*bound_cells(multiples(pl.DataFrame(runs)), narrow=True), title=""))
    text = screen.export_text()
    assert "…" not in text and text.count("single") == 2 and "pf_cauchy_gaussian" in text and "2 of 2 drives" in text


def test_cells_are_apart_and_the_nearest_comes_first():
    runs = pl.DataFrame(
        rows("far", [2.0, 2.1])
        + rows("near", [0.5, 0.51])
        + rows("far", [0.5, 0.5], cell="b")
        + rows("near", [1.0, 1.0], cell="b")
    )
    times = multiples(runs)
    assert times["cell"].to_list() == ["a", "a", "b", "b"]
    assert times["estimator"].to_list() == ["near", "far", "far", "near"]


def test_renaming_changes_no_figure():
    values = [c for error, *_ in ERRORS for c in (error, f"{error}_low", f"{error}_high")]
    errors = np.random.default_rng(0).uniform(0.4, 0.6, 20).tolist()
    one, other = (multiples(pl.DataFrame(rows(name, errors))).select(values) for name in ("one", "other"))
    assert one.equals(other)


def test_one_seed_has_no_interval_and_a_sure_estimator_a_narrow_one():
    alone = multiples(pl.DataFrame(rows("one", [0.5]))).row(0, named=True)
    assert alone["sideslip"] == 1 and math.isnan(alone["sideslip_low"])
    sure = multiples(pl.DataFrame(rows("one", 3 * [0.0]))).row(0, named=True)
    assert sure["sideslip"] == sure["sideslip_low"] == sure["sideslip_high"] == 0


def test_the_figure_is_drawn(tmp_path):
    runs = pl.DataFrame(rows("one", [0.5, 0.6]) + rows("broken", [None, None], cell="b", ended="raised"))
    bound_figure(multiples(runs), tmp_path / "bound.png")
    assert (tmp_path / "bound.png").stat().st_size > 5000
