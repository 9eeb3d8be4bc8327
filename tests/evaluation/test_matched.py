"""Matched drives: the noise that is said, the same for everybody, and as known as their filters say."""

import tomllib
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation import STUDIES, TIMES, Bench, Cell, Randomise, Study, contenders, evaluate
from vse_gym.evaluation.matched import (
    TUNINGS,
    matched,
    matched_bound,
    matched_drive,
    noise_information,
    run_matched,
)
from vse_gym.inference.model import heed, observe
from vse_gym.models import DoubleTrackTuning, SingleTrackTuning
from vse_gym.noise import contamination
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.sensors import FITTED, LOUD, SUITES, Resolution, Sensors, suite
from vse_gym.types import Estimate

SETTINGS = {"speed_kmh": 80, "amplitude_deg": 45, "friction": 0.9, "duration": 4.0}
CELLS = {s: Cell(s, "sine_with_dwell", controller="none", sensors=s, settings=SETTINGS) for s in SUITES}
UNFIT = ["clean", "biased", "dropout", "outliers", "growing", "late", "harsh"]
KINDS = (SingleTrackTuning, DoubleTrackTuning)


@cache
def setting(sensors="loud"):
    return CELLS[sensors].scenario(Randomise(), 0)


def rows_of(cell, seed, *names, **others):
    """Rows of a matched cell, one per estimator."""
    study = Study("matched", 1, (cell,), matched=True)
    return run_matched(study, cell, seed, contenders({name: name for name in names} | others))


def noise(sensors, seed):
    """Readings minus what the model says without noise, (T, channels)."""
    log, model = matched_drive(setting(sensors), TUNINGS[DoubleTrackTuning], seed), None
    model = TUNINGS[DoubleTrackTuning].build(setting(sensors).nominal)
    states = log.truth[:, [p.VX, p.VY, p.YAW_RATE], None]
    silent = np.full(10, np.nan)
    clean = [observe(model, x, heed(model, u, silent))[:, 0] for x, u in zip(states, log.inputs, strict=True)]
    return (log.readings - np.array(clean))[:, :FITTED]


@pytest.mark.parametrize("sensors", ["loud", "cauchy_gaussian"])
def test_the_noise_has_the_suite_s_law_without_its_range(sensors):
    z = np.concatenate([noise(sensors, seed) for seed in range(10)])
    share = contamination(suite(sensors).alpha)
    heavy, core = stats.cauchy(scale=np.sqrt(0.5)), stats.norm()
    z /= [LOUD.acceleration, LOUD.acceleration, LOUD.yaw_rate, *4 * [LOUD.wheel_speed]]
    for k in range(FITTED):
        here = share if k < 3 else 0.0  # wheels have no heavy tails
        found = stats.kstest(z[:, k], lambda x, here=here: here * heavy.cdf(x) + (1 - here) * core.cdf(x))
        assert found.statistic < 1.95 / np.sqrt(len(z))  # Kolmogorov's bound at the 0.1 % level
    if share:
        assert np.abs(z[:, :3]).max() * LOUD.acceleration > 2 * suite(sensors).acceleration_range


@pytest.mark.parametrize("sensors", UNFIT)
def test_noise_that_is_not_independent_in_time_is_refused(sensors):
    with pytest.raises(ValueError, match=rf"cell '{sensors}'.* independent .* gaussian, loud, cauchy_gaussian"):
        rows_of(CELLS[sensors], 0, "ekf")


@pytest.mark.parametrize(
    "change",
    [
        {"freedom": 3.0},
        {"growth": 2.0},
        {"yaw_rate_bias": 0.01},
        {"acceleration_walk": 0.1},
        {"delay": 0.02},
        {"resolution": Resolution(yaw_rate=0.01)},
    ],
)
def test_whatever_spoils_the_law_is_refused_and_named(change):
    with pytest.raises(ValueError, match="no bound is known for these sensors, as their noise"):
        noise_information(Sensors(**change))


def test_what_the_range_or_another_sheet_is_does_not_matter():
    for sensors in ("loud", "loud+optical+roll_rate", replace(suite("loud"), acceleration_range=1.0)):
        np.testing.assert_array_equal(noise_information(suite(sensors)), 1.0)
    heavy = noise_information(suite("cauchy_gaussian"))
    np.testing.assert_array_equal(heavy < 1, [True] * 3 + 6 * [False] + [True])


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_drive_and_another_seed_another(kind):
    first, again, other = (matched_drive(setting(), TUNINGS[kind], seed) for seed in (0, 0, 1))
    for name in ("truth", "readings", "inputs"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_array_equal(first.inputs, other.inputs)  # one steering, so that one bound fits all
    assert np.abs(first.truth - other.truth).max() > 0.1


def test_both_models_meet_the_same_draws():
    single, double = (matched_drive(setting(), TUNINGS[kind], 0) for kind in KINDS)
    # Before the steering begins both models drive straight on alike, but for what little vy and yaw rate there is.
    np.testing.assert_allclose(single.truth[:50, p.VX], double.truth[:50, p.VX], atol=0.02)
    assert np.corrcoef(np.diff(single.truth[:, p.VX]), np.diff(double.truth[:, p.VX]))[0, 1] > 0.99


def test_rows_do_not_depend_on_who_else_is_judged():
    alone = rows_of(CELLS["loud"], 3, "pf")[0]
    together = {row["estimator"]: row for row in rows_of(CELLS["loud"], 3, "ekf_double_track", "ekf", "pf")}
    assert {k: v for k, v in together["pf"].items() if k not in TIMES} == {
        k: v for k, v in alone.items() if k not in TIMES
    } | {"shadow_nis": pytest.approx(np.nan, nan_ok=True)}
    assert [row["model"] for row in together.values()] == ["DoubleTrack", "SingleTrack", "SingleTrack"]


@pytest.mark.parametrize(("name", "kind"), [("ekf", SingleTrackTuning), ("ekf_double_track", DoubleTrackTuning)])
def test_under_gaussian_noise_the_extended_filter_is_as_wrong_as_it_says(name, kind):
    drives, instants = 30, slice(50, None, 50)  # half a second apart, longer than an error lasts
    estimator, squares = matched(ESTIMATORS.make(name), suite("loud")), []
    for seed in range(drives):
        log = matched_drive(setting(), TUNINGS[kind], seed)
        heard = shadow(log, estimator, setting().nominal, seed)
        error = (heard.estimate[:, :3] - log.truth[:, [p.VX, p.VY, p.YAW_RATE]])[instants]
        squares.append(np.einsum("ti,tij,tj->t", error, np.linalg.inv(heard.cov[instants]), error))
    total = np.sum(squares)
    lower, upper = stats.chi2.ppf([0.0005, 0.9995], 3 * np.size(squares))
    assert lower < total < upper, total / (3 * np.size(squares))


@pytest.mark.parametrize("kind", KINDS)
def test_under_heavy_tails_the_filter_that_expects_them_is_as_wrong_as_it_says(kind):
    # Its errors are not Gaussian, so their NEES has the right mean but another law: the band is from its own spread.
    estimator = matched(replace(ESTIMATORS.make("ekf_cauchy_gaussian"), model=TUNINGS[kind]), suite("cauchy_gaussian"))
    nees, nis = [], []
    for seed in range(30):
        log = matched_drive(setting("cauchy_gaussian"), TUNINGS[kind], seed)
        heard = shadow(log, estimator, setting("cauchy_gaussian").nominal, seed)
        error = heard.estimate[:, :3] - log.truth[:, [p.VX, p.VY, p.YAW_RATE]]
        nees.append(np.mean(np.einsum("ti,tij,tj->t", error, np.linalg.inv(heard.cov), error)) / 3)
        nis.append(heard.nis.mean())
    for square in (nees, nis):
        assert np.mean(square) == pytest.approx(1, abs=4 * np.std(square) / np.sqrt(30))


def multiples(sensors, name, seeds=10):
    rows = [row for seed in range(seeds) for row in rows_of(CELLS[sensors], seed, name)]
    return tuple(
        np.sqrt(np.mean([row[f"shadow_{error}"] ** 2 for row in rows])) / rows[0][least]
        for error, least in (("sideslip_rmse_deg", "bound_sideslip_deg"), ("vx_rmse_mps", "bound_vx_mps"))
    )


@pytest.mark.parametrize("name", ["ekf", "sr_ukf", "pf", "ukf_double_track"])
def test_under_gaussian_noise_filters_come_near_the_bound_and_stay_above(name):
    # Of ten drives the mean square spreads by some 3 %.
    assert all(0.95 < multiple < 1.1 for multiple in multiples("loud", name))


def test_under_heavy_tails_filters_that_expect_them_come_near_and_the_others_do_not():
    for name in ("ekf_cauchy_gaussian", "pf_cauchy_gaussian"):
        assert all(0.95 < multiple < 1.2 for multiple in multiples("cauchy_gaussian", name))
    assert multiples("cauchy_gaussian", "ekf")[0] > 3


@pytest.mark.parametrize("kind", KINDS)
def test_the_bound_is_known_to_the_error_that_it_states(kind):
    few, many = matched_bound(setting(), TUNINGS[kind], 80), matched_bound(setting(), TUNINGS[kind])
    assert many.error < 0.005
    # The standard error of eight parts may itself be half of what it should be.
    assert abs(few.sideslip / many.sideslip - 1) < 8 * (few.error + many.error)


def test_heavy_tails_raise_the_bound_and_an_optical_sensor_lowers_it():
    cells = (CELLS["loud"], CELLS["cauchy_gaussian"], replace(CELLS["loud"], sensors="loud+optical"))
    plain, heavy, optical = (matched_bound(c.scenario(Randomise(), 0), TUNINGS[SingleTrackTuning]) for c in cells)
    assert optical.sideslip < 0.9 * plain.sideslip < 0.9 * heavy.sideslip
    assert heavy.sideslip < plain.sideslip / np.sqrt(0.88)  # each reading tells 0.883 of a Gaussian one


def test_filters_are_told_the_trust_and_the_law_that_drives_are_drawn_with():
    heavy, even = (matched(ESTIMATORS.make("pf_cauchy_gaussian"), suite(s)) for s in ("cauchy_gaussian", "loud"))
    assert heavy.cauchy_share == pytest.approx(contamination(1.3), rel=1e-12)
    assert set(heavy.heavy) == {"ax", "ay", "yaw_rate", "roll_rate"}
    assert even.cauchy_share == 0.0
    other = matched(ESTIMATORS.make("pf_cauchy_gaussian"), Sensors(alpha=1.3, alpha_rule="log_moment"))
    assert other.cauchy_share == pytest.approx(contamination(1.3, "log_moment"), rel=1e-12)
    assert heavy.model == even.model == TUNINGS[SingleTrackTuning]
    assert matched(kinematic := ESTIMATORS.make("kinematic"), suite("loud")) is kinematic


@dataclass(frozen=True)
class Breaks(Estimator):
    """Raises after a while."""

    def init(self, nominal, rng):
        return 0.0

    def update(self, state, reading, rng):
        if reading.time > 0.5:
            raise ZeroDivisionError("no sideslip left")
        return reading.time

    def estimate(self, state):
        return Estimate(20.0)


def test_an_estimator_that_breaks_is_a_row_with_its_reason_and_without_errors():
    (row,) = rows_of(CELLS["loud"], 0, broken=Breaks())
    assert row["shadow_ended"] == "raised ZeroDivisionError: no sideslip left"
    assert row["shadow_sideslip_rmse_deg"] is None and row["bound_sideslip_deg"] > 0


def test_the_study_s_cells_can_be_driven_and_name_noise_that_has_a_bound():
    table = tomllib.loads((STUDIES / "matched-v1.toml").read_text(encoding="utf-8"))
    assert table["matched"] is True
    assert set(table["estimators"]) <= set(ESTIMATORS)
    cells = [Cell(**cell) for cell in table["cell"]]
    assert len({cell.name for cell in cells}) == len(cells)
    laws = [noise_information(suite(cell.sensors)).min() < 1 for cell in cells]
    assert any(laws) and not all(laws)


def test_a_matched_study_is_driven_as_any_other():
    study = Study("matched", 1, (CELLS["loud"],), seeds=2, matched=True)
    runs = evaluate(study, ["ekf", "zero"])
    assert runs["estimator"].to_list() == 2 * ["ekf", "zero"]  # nobody brakes: there is no row of the potential
    assert "regret" not in runs.columns
    times = [name for name in TIMES if name in runs.columns]
    assert runs.drop(times).equals(evaluate(study, ["ekf", "zero"], jobs=2).drop(times), null_equal=True)


def test_a_matched_study_has_no_precision_of_regret():
    study = Study("matched", 1, (CELLS["loud"],), matched=True)
    with pytest.raises(ValueError, match="no regret"):
        Bench(study, contenders(["ekf"]), 1).drive_until(0.1)
