"""Studies: paired, repeatable, and robust against estimators that are not."""

from dataclasses import dataclass

import numpy as np
import polars as pl
import pytest

from vse_gym.controllers.base import Controller
from vse_gym.env import StabilityControlEnv
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.evaluation import TIMES, Cell, Randomise, Study, contenders, evaluate, run_cell, study_names
from vse_gym.evaluation.contenders import PARTS
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.report import reasons
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import BrakeDemand, Estimate

RANDOM = Randomise(speed=1.0, steer=0.1, friction=0.03, mass=(1.0, 1.25), stiffness=(0.75, 1.0))


def short(**changes):
    settings = {"speed_kmh": 80, "amplitude_deg": 120, "friction": 0.5, "duration": 3.0}
    cell = Cell("short", "sine_with_dwell", sensors="outliers", controller="sideslip_esc", settings=settings | changes)
    return Study("short", 1, (cell,), seeds=2, estimators=("truth", "ekf"), randomise=RANDOM)


@dataclass(frozen=True)
class Breaks(Estimator):
    """Fails in a chosen way after a while."""

    how: str = "raise"
    after: float = 0.7

    def init(self, nominal, rng):
        return 0.0, nominal.speed

    def update(self, state, reading, rng):
        if self.how == "raise" and reading.time > self.after:
            raise ZeroDivisionError("no sideslip left")
        return reading.time, state[1]

    def estimate(self, state):
        return Estimate(vx=float("nan") if self.how == "nan" and state[0] > self.after else state[1])


def test_two_runs_give_the_same_table_but_for_the_time_they_took():
    first, second = evaluate(short()).drop(TIMES), evaluate(short()).drop(TIMES)
    assert first.equals(second, null_equal=True)


def test_two_processes_give_the_same_table_as_one():
    assert evaluate(short(), jobs=2).drop(TIMES).equals(evaluate(short(), jobs=1).drop(TIMES), null_equal=True)


def test_renaming_and_reordering_estimators_changes_nothing():
    named = evaluate(short(), {"b": "ekf", "a": "kinematic"})
    plain = evaluate(short(), ["kinematic", "ekf"])
    renamed = named.with_columns(pl.col("estimator", "parent").replace({"b": "ekf", "a": "kinematic"}))
    keys = ["cell", "seed", "estimator"]
    assert renamed.sort(keys).drop(TIMES).equals(plain.sort(keys).drop(TIMES), null_equal=True)


def test_every_estimator_has_a_row_beside_the_car_without_control():
    runs = evaluate(short())
    assert sorted(runs["estimator"].unique()) == ["ekf", "none", "truth"]
    assert len(runs) == 2 * 3
    truth = runs.filter(pl.col("estimator") == "truth")
    assert truth["regret"].to_list() == [0.0, 0.0]
    assert truth["shadow_sideslip_rmse_deg"].to_list() == [0.0, 0.0]


def test_differences_are_to_the_truth_s_drive_of_the_same_seed():
    runs = evaluate(short())
    both = runs.pivot(on="estimator", index="seed", values=["loop_brake_energy_kJ", "loop_brake_energy_kJ_diff"])
    wanted = both["loop_brake_energy_kJ_ekf"] - both["loop_brake_energy_kJ_truth"]
    np.testing.assert_allclose(both["loop_brake_energy_kJ_diff_ekf"], wanted)


@pytest.mark.parametrize(
    ("how", "reason"), [("raise", "raised ZeroDivisionError: no sideslip left"), ("nan", "estimate not finite")]
)
def test_an_estimator_that_breaks_is_a_row_with_its_reason(how, reason):
    runs = evaluate(short(), {"broken": Breaks(how), "ekf": "ekf"})
    broken = runs.filter(pl.col("estimator") == "broken")
    assert set(broken["loop_ended"]) == {reason}
    assert set(broken["shadow_ended"]) == {reason}
    assert broken["regret"].to_list() == [14.0, 14.0]
    assert set(runs.filter(pl.col("estimator") == "ekf")["loop_ended"]) == {""}


def test_an_estimator_that_never_starts_is_a_row_too():
    runs = evaluate(short(), {"broken": Breaks(after=-1.0)})
    assert set(runs.filter(pl.col("estimator") == "broken")["regret"]) == {14.0}


def test_a_seed_whose_truth_drive_ends_badly_is_replaced_and_counted():
    # 270 deg without control spins: no seed can serve, and the study says which cell is at fault
    study = short(amplitude_deg=270, friction=0.9, duration=6.0)
    cell = Cell("hopeless", "sine_with_dwell", controller="none", settings=study.cells[0].settings)
    with pytest.raises(ValueError, match=r"hopeless.*spin"):
        run_cell(study, cell, 0, contenders(["ekf"]))
    assert evaluate(short())["replaced"].sum() == 0


def test_in_shadow_an_estimator_hears_what_it_would_hear_beside_the_truth():
    drive = scenario("sine_with_dwell", sensors="outliers", duration=3.0)
    log = rollout(drive, "truth", "esc", 4)
    trace = shadow(log, ExtendedKalmanFilter(), drive.nominal, 4)
    # the loop with an estimator that drives nothing (no controller) reads the same car as its own shadow
    alone = rollout(drive, "ekf", "none", 4)
    np.testing.assert_array_equal(shadow(alone, ExtendedKalmanFilter(), drive.nominal, 4).estimate, alone.estimate)
    assert np.isfinite(trace.nis).all()
    assert not trace.ended


@pytest.mark.parametrize("name", study_names())
def test_every_study_that_ships_can_be_driven(name):
    study = Study.load(name)
    runs = evaluate(study, ["zero"], seeds=1)
    parts = [f"zero: {part}" for part in PARTS] if study.attribution else []
    expected = sorted(["zero", *parts, *([] if study.matched else ["none"])])
    assert runs["cell"].n_unique() == len(study.cells)
    assert all(part["estimator"].to_list() == expected for part in runs.partition_by("cell"))


BAD_STUDIES = {
    "no cell": ("version = 1", "at least one"),
    "unknown key": ("version = 1\ncolour = 1\n[[cell]]\nname='a'\nmanoeuvre='held_steer'", "colour"),
    "unknown name": ("version = 1\n[[cell]]\nname='a'\nmanoeuvre='held_wheel'", "known: sine_with_dwell"),
    "unknown setting": ("version = 1\n[[cell]]\nname='a'\nmanoeuvre='held_steer'\nsettings={jumpp=1}", "jumpp"),
    "twice": ("version=1" + "\n[[cell]]\nname='a'\nmanoeuvre='held_steer'" * 2, "same name"),
}


@pytest.mark.parametrize(("text", "sentence"), BAD_STUDIES.values(), ids=BAD_STUDIES)
def test_a_study_that_cannot_be_is_refused_with_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises((KeyError, ValueError, TypeError), match=sentence):
        Study.load(path)


def test_an_unknown_study_is_told_the_known():
    with pytest.raises(KeyError, match=r"known: .*demo"):
        Study.load("headlin")


def test_the_name_of_the_uncontrolled_car_is_taken():
    with pytest.raises(ValueError, match="without stability control"):
        evaluate(short(), {"none": "ekf"})


@pytest.mark.parametrize("seeds", [0, -1])
def test_a_study_needs_seeds(seeds):
    with pytest.raises(ValueError, match="at least 1"):
        evaluate(short(), ["truth"], seeds=seeds)


def test_a_failing_estimator_is_not_flattered_by_what_it_survived():
    broken = evaluate(short(), {"broken": Breaks()}).filter(pl.col("estimator") == "broken")
    assert broken["shadow_sideslip_rmse_deg"].null_count() == len(broken)
    assert broken["shadow_diverged"].all()
    assert [line.split(":")[0] for line in reasons(evaluate(short(), {"broken": Breaks()}))] == ["broken"]


@dataclass(frozen=True)
class Demands(Controller):
    """Asks for the same at every step."""

    added: object
    release: object = (0.0, 0.0, 0.0, 0.0)

    def init(self, nominal):
        return None

    def act(self, state, estimate, reading):
        return BrakeDemand(self.added, self.release), None


@pytest.mark.parametrize("added", [[100, 0, 0, 0], (100.0, 0.0, 0.0, 0.0), np.array([100, 0, 0, 0])])
def test_a_controller_may_ask_in_lists_and_whole_numbers_and_both_faces_do_the_same(added):
    log = rollout(scenario("straight_driving", duration=0.5), "truth", Demands(added), 0)
    env = StabilityControlEnv("straight_driving", "truth", controller=Demands(added), duration=0.5)
    env.reset(seed=0)
    for _ in range(50):
        *_, info = env.step(np.zeros(4, np.float32))
    assert info["truth"]["vx"] == log.truth[-1, p.VX] < log.truth[0, p.VX]


@pytest.mark.parametrize("added", [[np.nan, 0, 0, 0], [1.0, 2.0, 3.0]])
def test_a_controller_s_fault_is_its_own_and_not_a_row_of_the_estimator(added):
    with pytest.raises(ValueError, match=r"four|inhomogeneous"):
        rollout(scenario("straight_driving"), "truth", Demands(added), 0)
    env = StabilityControlEnv("straight_driving", "truth", controller=Demands(added))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"four|inhomogeneous"):
        env.step(np.zeros(4, np.float32))


def test_two_estimators_of_one_name_are_refused():
    with pytest.raises(ValueError, match="mapping"):
        evaluate(short(), [ExtendedKalmanFilter(), ExtendedKalmanFilter()])


def test_an_estimator_whose_init_raises_is_a_row_too():
    @dataclass(frozen=True)
    class NeverBegins(Breaks):
        def init(self, nominal, rng):
            raise RuntimeError("no model")

    log = rollout(scenario("straight_driving"), NeverBegins(), "esc", 0)
    assert log.ended == "raised RuntimeError: no model"
    assert not scenario("straight_driving").manoeuvre.judge(log, scenario("straight_driving").nominal).passed


def test_a_drive_that_ended_early_fails_whatever_its_figures():
    drive = scenario("straight_driving")
    log = rollout(drive, Breaks(), "none", 0)
    verdict = drive.manoeuvre.judge(log, drive.nominal)
    assert drive.manoeuvre.verdict(log, drive.nominal).passed
    assert not verdict.passed
    assert "ZeroDivisionError" in verdict.criteria[-1].name
