"""Whether a study's cells rank: shares of pairs, stability of orders, and the floor under tiny disturbances."""

import importlib.util
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import spearmanr

from vse_gym.evaluation import Cell, Randomise, Study
from vse_gym.report.statistics import cube
from vse_gym.simulation import rollout

PROGRAM = Path(__file__).parent.parent / "benchmarks" / "separation.py"
CELL = Cell(
    "short", "sine_with_dwell", settings={"speed_kmh": 80, "amplitude_deg": 120, "friction": 0.5, "duration": 3}
)
STUDY = Study("short", 1, (CELL,), seeds=2, randomise=Randomise(mass=(1.0, 1.25)))


@pytest.fixture(scope="module")
def separation():
    spec = importlib.util.spec_from_file_location("separation", PROGRAM)
    module = sys.modules["separation"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["separation"]


def test_pairs_that_differ_by_as_much_at_every_seed_are_apart_and_equal_ones_are_not(separation):
    values = np.random.default_rng(0).uniform(0, 5, 10) + np.array([[0.0], [0.0], [0.3], [2.0]])
    assert separation.pairs_apart(values) == pytest.approx(5 / 6)  # all but the first two
    assert separation.pairs_apart(values, 0.4) == pytest.approx(3 / 6)  # those with the last
    assert math.isnan(separation.pairs_apart(values[:1]))


def test_pairs_of_one_law_are_apart_as_seldom_as_the_interval_says(separation):
    values = np.random.default_rng(1).normal(3.0, 1.0, (40, 20))
    # 5 %; pairs share their rows: over draws of 40 rows the share scatters by about 2 %
    assert separation.pairs_apart(values) < 0.11


@given(arrays(float, (2, 9), elements=st.integers(0, 5).map(float)))
def test_the_rank_correlation_is_spearmans_where_he_defines_one(separation, values):
    first, second = values
    ours = separation.rank_correlation(first, second)
    if np.ptp(first) and np.ptp(second):
        assert ours == pytest.approx(spearmanr(first, second).statistic, abs=1e-12)
    else:
        assert ours == float(np.ptp(first) == np.ptp(second))


def test_an_order_that_every_seed_shows_is_stable_and_one_of_noise_is_not(separation):
    rng = np.random.default_rng(2)
    clear = np.arange(8.0)[:, None, None] + rng.uniform(0, 0.4, (8, 20, 1))
    noise = rng.normal(0, 1, (8, 20, 1))
    assert separation.halves(clear, rng) == separation.stability(clear, 1, 1, rng) == 1
    # halves of 20 values have sample means in opposition about the whole mean: 0 on average is the most
    assert separation.halves(noise, rng) < 0.25
    assert separation.stability(noise, 20, 1, rng) == pytest.approx(1)
    assert separation.stability(noise, 1, 1, rng) < 0.6


def test_cells_that_disagree_make_more_cells_worth_more_than_more_seeds(separation):
    rng = np.random.default_rng(3)
    own = rng.normal(0, 1, (8, 1, 10))  # an order of each cell, the same at every seed
    values = own + 0.1 * rng.normal(0, 1, (8, 20, 10))
    by_cells, by_seeds = separation.stability(values, 1, 8, rng), separation.stability(values, 20, 1, rng)
    assert by_cells > by_seeds + 0.2
    runs = table_of(values)
    left = separation.one_left_out(cube(runs))
    assert [figure for _, figure in left] == sorted(figure for _, figure in left)
    heads, rows = separation.over_all(cube(runs))
    assert rows[-1][-1] == "1.00" and len(heads) == len(rows[0])


def table_of(values):
    """A table of runs from regrets (E, S, C)."""
    return pl.DataFrame(
        [
            {"estimator": f"e{e}", "seed": s, "cell": f"c{c}", "regret": float(r), "replaced": 0}
            for (e, s, c), r in np.ndenumerate(values)
        ]
    )


def test_markers_are_in_no_pair(separation):
    runs = table_of(np.zeros((3, 2, 1))).with_columns(pl.col("estimator").replace({"e0": "truth", "e2": "none"}))
    assert separation.regrets(runs).estimators == ("e1",)


@pytest.mark.parametrize(
    ("share", "floor", "word"), [(0.9, 0.41, "chaos"), (0.9, 0.4, "ranks"), (0.2, 0.1, "ranks nobody")]
)
def test_chaos_ranks_nobody_whoever_is_apart(separation, share, floor, word):
    assert separation.verdict(share, floor) == word


def test_the_table_of_cells_says_what_was_measured(separation):
    values = np.arange(6.0)[:, None, None] + np.random.default_rng(4).uniform(0, 0.1, (6, 4, 1))
    heads, rows = separation.per_cell(table_of(values), {"c0": separation.Floor(0.1, 0.2)})
    row = dict(zip(heads, rows[0], strict=True))
    assert row["apart %"] == row["matters %"] == "100" and row["verdict"] == "ranks"
    assert row["floor vy"] == "0.10" and row["floor wheel"] == "0.20" and row["halves"] == "1.00"


@pytest.mark.parametrize("manoeuvre", ["sine_with_dwell", "double_lane_change"])
def test_the_hand_wheel_goes_further_round_whatever_the_driver_means(separation, manoeuvre):
    cell = Cell("short", manoeuvre, settings={"duration": 3.0})
    scenario = cell.scenario(STUDY.randomise, 0)
    plain = rollout(scenario, "truth", "none", 0)
    turned = rollout(replace(scenario, manoeuvre=separation.oversteered(scenario.manoeuvre)), "truth", "none", 0)
    first = np.flatnonzero(plain.hand_wheel)[0]  # from there on a driver sees another car
    assert turned.hand_wheel[first] == pytest.approx(separation.HAND_WHEEL * plain.hand_wheel[first], rel=1e-12)


def test_a_drive_that_nothing_disturbs_has_no_floor_and_a_larger_disturbance_a_higher_one(separation, monkeypatch):
    monkeypatch.setattr(separation, "HAND_WHEEL", 1.0)
    monkeypatch.setattr(separation, "VY", 0.0)
    assert separation.floor_of(STUDY, CELL, 0) == (0.0, 0.0)
    monkeypatch.setattr(separation, "HAND_WHEEL", 1.05)
    monkeypatch.setattr(separation, "VY", 0.5)
    disturbed = separation.floors(STUDY, seeds=2, jobs=1)["short"]
    assert min(disturbed) > 0.05


def test_a_cell_whose_truth_ends_badly_has_no_floor_at_that_seed(separation):
    spins = Cell("spins", "sine_with_dwell", controller="none", settings={"amplitude_deg": 270, "friction": 0.9})
    study = replace(STUDY, cells=(spins,))
    assert separation.floor_of(study, spins, 0) is None
    floor = separation.floors(study, 1, 1)["spins"]
    assert separation.verdict(1.0, max(floor)) == "chaos"


TABLE = """version = 1
[[cell]]
name = "here"
manoeuvre = "sine_with_dwell"
settings = { duration = 2.0 }
[[cell]]
name = "there"
manoeuvre = "held_steer"
settings = { duration = 2.0 }
"""


def test_the_program_reads_a_finished_table_and_drives_the_floor_alone(separation, tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.toml").write_text(TABLE)
    values = np.random.default_rng(5).uniform(0, 1, (4, 2, 2))
    cells = pl.col("cell").replace({"c0": "here", "c1": "there"})
    table_of(values).with_columns(cells).write_parquet(tmp_path / "runs.parquet")
    monkeypatch.setattr(separation, "evaluate", None)
    monkeypatch.setenv("COLUMNS", "200")
    arguments = [str(tmp_path / "mine.toml"), "--runs", str(tmp_path / "runs.parquet")]
    monkeypatch.setattr(sys, "argv", ["separation.py", *arguments])
    separation.main()
    told = capsys.readouterr().out
    assert "mine, 2 seeds" in told and "here" in told and "there" in told and "rank correlation" in told
    monkeypatch.setattr(sys, "argv", ["separation.py", *arguments, "--cells", "nowhere"])
    with pytest.raises(SystemExit):
        separation.main()
    assert "no such cell: nowhere; known: here, there" in capsys.readouterr().err
