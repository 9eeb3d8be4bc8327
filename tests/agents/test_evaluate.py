"""Agents in a study's drives beside other controllers, and what the tables say of them."""

import evaluate
import numpy as np
import polars as pl
import pytest
import tables
from typer.testing import CliRunner

from vse_gym.evaluation import Cell, Study
from vse_gym.evaluation.battery import OWN, battery, yaw_error_degps
from vse_gym.evaluation.runs import TIMES
from vse_gym.physics import parameters as p
from vse_gym.policy import TrainedPolicy
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

CELLS = (
    Cell("held", "held_steer", controller="sideslip_esc", settings={"friction": 0.5, "duration": 1.5}),
    Cell("spins", "sine_with_dwell", settings={"speed_kmh": 110, "amplitude_deg": 300, "friction": 0.5}),
)
STUDY = Study("two", 1, CELLS, seeds=2)


@pytest.fixture(scope="module")
def runs(agent):
    return battery(STUDY, {"none": "none", OWN: OWN, "agent": TrainedPolicy(str(agent))}, ["truth", "ekf"])


def one(runs, **where):
    found = runs.filter(**where)
    assert len(found) == 1
    return found.row(0, named=True)


def test_every_controller_drives_every_seed_by_every_estimator(runs):
    assert len(runs) == 2 * 2 * 3 * 2
    assert set(runs["controller"]) == {"none", OWN, "agent"}


def test_a_row_is_the_rollout_of_its_controller_by_its_estimator(runs, agent):
    scenario = CELLS[0].scenario(STUDY.randomise, 1)
    for name, controller in (("agent", TrainedPolicy(str(agent))), (OWN, "sideslip_esc"), ("none", "none")):
        log = rollout(scenario, "ekf", controller, 1)
        row = one(runs, controller=name, estimator="ekf", seed=1, cell="held")
        assert row["loop_peak_sideslip_deg"] == np.degrees(log.peak_sideslip)


def test_the_same_drive_twice_has_no_regret_and_a_truth_that_spins_gives_none(runs):
    kept = runs.filter((pl.col("estimator") == "truth") & (pl.col("truth_ended") == ""))
    assert kept["regret"].to_list() == [0.0] * len(kept) and len(kept)
    spun = runs.filter(pl.col("truth_ended") != "")
    assert len(spun) and spun["regret"].null_count() == len(spun)
    assert "spin" in set(spun.filter(controller="none")["loop_ended"])


def test_an_agent_evaluates_to_the_same_numbers_twice_and_in_two_processes(runs, agent):
    who = {"none": "none", OWN: OWN, "agent": TrainedPolicy(str(agent))}
    again = battery(STUDY, who, ["truth", "ekf"], jobs=2)
    assert again.drop(TIMES, strict=False).equals(runs.drop(TIMES, strict=False), null_equal=True)


def test_a_car_that_turns_as_it_is_steered_has_no_yaw_error_and_one_that_goes_straight_has_all():
    """Neutral at a gentle lateral acceleration; and with steered wheels that never turn it."""
    drive = scenario("gentle_curve", lateral=2.0)
    log = rollout(drive, "truth", "none", 0)
    turned = np.degrees(np.abs(log.truth[:, p.YAW_RATE]).mean())
    assert yaw_error_degps(log, drive.nominal) < 0.1 * turned
    still = log.truth.copy()
    still[:, p.YAW_RATE] = 0.0
    assert yaw_error_degps(log._replace(truth=still), drive.nominal) == pytest.approx(turned, rel=0.1)


# -- tables, from runs that are known ---------------------------------------------------------------------------------


@pytest.fixture
def known():
    """Ten seeds, two cells, two estimators: at every seed the agent slides 2 deg less than esc, and none spins once."""
    rng, rows = np.random.default_rng(0), []
    for seed in range(10):
        for cell in "ab":
            for estimator in ("ekf", "ukf"):
                slide = 5 + rng.normal()
                for controller, less in (("none", -4.0), ("esc", 0.0), ("agent", 2.0)):
                    spun = controller == "none" and seed == 3
                    rows.append(
                        {
                            "controller": controller,
                            "estimator": estimator,
                            "seed": seed,
                            "cell": cell,
                            "loop_ended": "spin" if spun else "",
                            "loop_peak_sideslip_deg": 85.0 if spun else slide - less,
                            "loop_brake_energy_kJ": 10.0,
                            "loop_yaw_error_degps": 1.0,
                            "loop_passed": not spun,
                            "regret": None if spun else 1.0,
                        }
                    )
    return pl.DataFrame(rows)


def test_a_paired_difference_has_no_noise_of_what_both_share(known):
    names, difference = tables.differences(known, tables.SLIDE, "esc")
    k = names.index("agent")
    assert difference.value[k] == pytest.approx(-2) and difference.low[k] == pytest.approx(-2, abs=1e-9)
    assert difference.high[k] == pytest.approx(-2, abs=1e-9)


def test_a_drive_that_ended_early_has_the_largest_slide_that_counts(known):
    names, values = tables.cube(known, tables.SLIDE)
    assert (values[names.index("none"), 3] == tables.MOST).all()
    assert values.max() == tables.MOST


def test_the_matrix_has_a_row_for_each_controller_and_a_column_for_each_estimator(known):
    heads, rows = tables.matrix(known, ["none", "agent"])
    assert heads == ["controller", "ekf", "ukf"] and [row[0] for row in rows] == ["none", "agent"]
    mean = known.filter(controller="agent", estimator="ekf")["loop_peak_sideslip_deg"].mean()
    assert rows[1][1] == f"{mean:.2f}"


def test_a_summary_says_all_figures_and_a_dash_where_none_is_known(known):
    heads, rows = tables.summary(known, ["none", "esc", "agent"])
    assert heads == ["controller", "slide deg", "yaw error deg/s", "ended early %", "brakes kJ", "passed %", "regret"]
    assert rows[0][3].startswith("10.0") and rows[0][6] == "-"
    assert rows[2][6].startswith("1.00")


# -- the program ------------------------------------------------------------------------------------------------------

FILE = """version = 1
seeds = 1
[[cell]]
name = "held"
manoeuvre = "held_steer"
settings = { friction = 0.5, duration = 0.5 }
"""


def test_the_program_prints_and_writes_the_tables(agent, tmp_path):
    study = tmp_path / "brief.toml"
    study.write_text(FILE)
    words = [str(agent), "--estimators", "truth", "--study", str(study), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(evaluate.app, [*words, "--beside", "lqr"])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "out" / "agents.md").read_text()
    for word in ("| random |", "| esc |", "| lqr |", "| none |", "trained with ukf"):
        assert word in text
    assert (tmp_path / "out" / "agents.png").stat().st_size > 5000
    assert len(pl.read_parquet(tmp_path / "out" / "runs.parquet")) == 5


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["nobody"], "neither an agent's folder"),
        (["AGENT", "--estimators", "ekff"], "known: truth"),
        (["AGENT", "--study", "no"], "no study named"),
        (["AGENT", "--beside", "abs"], "known: none"),
        (["AGENT", "AGENT"], "folders of different names"),
    ],
)
def test_a_wrong_word_is_told_what_can_be(words, sentence, agent):
    refused = CliRunner().invoke(evaluate.app, [str(agent) if word == "AGENT" else word for word in words])
    assert refused.exit_code == 2
    assert sentence in " ".join(refused.output.split())
