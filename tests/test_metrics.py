"""Scores against drives whose figures are known by construction."""

import math

import numpy as np
import pytest

from vse_gym import metrics
from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Log


def straight_log(rows=101, speed=20.0, offset=0.0, dt=0.01, **columns):
    """A car that drives straight at a lateral offset; columns of the plant's state can be put in its place."""
    truth = np.zeros((rows, p.STATE_SIZE))
    time = dt * np.arange(rows)
    truth[:, p.VX], truth[:, p.X], truth[:, p.Y], truth[:, p.DISTANCE] = speed, speed * time, offset, speed * time
    for name, value in columns.items():
        truth[:, getattr(p, name)] = value
    zeros = np.zeros((rows, 4))
    return Log(
        time, truth, time * 0, time * 0, np.zeros((rows, 9)), np.zeros((rows, 7)), np.zeros((rows, 5)),
        np.zeros((rows, 3, 3)), zeros, zeros, zeros, time * 0 + 0.9, "", (),
    )  # fmt: skip


def made(truth, estimate, cov=None):
    rows = len(truth)
    unknown = np.full(rows, np.nan)
    return metrics.errors(truth, estimate, np.full((rows, 3, 3), np.nan) if cov is None else cov, unknown, unknown)


def test_direct_errors_of_a_constant_offset_are_that_offset():
    log = straight_log()
    estimate = np.zeros((101, 5))
    estimate[:, 0], estimate[:, 1], estimate[:, 2] = 20.5, 20.5 * math.tan(math.radians(2)), math.radians(3)
    scores = metrics.direct(made(log.truth, estimate))
    for summary in ("rmse", "mean_abs", "max_abs"):
        assert scores[f"sideslip_{summary}_deg"] == pytest.approx(2)
        assert scores[f"vx_{summary}_mps"] == pytest.approx(0.5)
        assert scores[f"yaw_rate_{summary}_degps"] == pytest.approx(3)
    assert not scores["diverged"]


def test_sideslip_errors_wrap_and_are_not_scored_below_walking_pace():
    log = straight_log(VX=-10.0, VY=0.1)
    estimate = np.zeros((101, 5))
    estimate[:, 0], estimate[:, 1] = -10.0, -0.1
    assert metrics.direct(made(log.truth, estimate))["sideslip_max_abs_deg"] == pytest.approx(1.146, abs=1e-3)
    slow = straight_log(speed=1.0)
    assert math.isnan(metrics.direct(made(slow.truth, estimate))["sideslip_rmse_deg"])


def test_an_estimate_that_stops_being_a_number_has_diverged():
    log = straight_log()
    estimate = np.tile([20.0, 0, 0, 0, 0], (101, 1))
    estimate[50, 1] = np.nan
    assert metrics.direct(made(log.truth, estimate))["diverged"]


def test_nees_of_errors_drawn_from_their_covariance_is_one_and_the_band_holds_95_percent():
    rng = np.random.default_rng(0)
    rows = 20_000
    truth = straight_log(rows=rows).truth
    cov = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.002], [0.0, 0.002, 0.01]])
    estimate = np.zeros((rows, 5))
    estimate[:, :3] = truth[:, [p.VX, p.VY, p.YAW_RATE]] + rng.multivariate_normal(np.zeros(3), cov, rows)
    e = made(truth, estimate, np.tile(cov, (rows, 1, 1)))
    # the mean of 20 000 chi-square(3)/3 scatters by sqrt(2/3/20000) = 0.006, the share by 0.15 %: four times each
    assert metrics.nees(e) == pytest.approx(1, abs=0.024)
    assert metrics.coverage(e) == pytest.approx(95, abs=0.6)


def test_one_collapsed_instant_does_not_hide_all_others():
    log = straight_log()
    estimate = np.tile([20.1, 0, 0, 0, 0], (101, 1))
    cov = np.tile(0.01 * np.eye(3), (101, 1, 1))
    cov[7] *= 1e-200
    assert metrics.nees(made(log.truth, estimate, cov)) <= 1 + metrics.COLLAPSED / 101


def test_the_truth_has_no_regret_and_a_drive_that_ended_badly_the_most():
    log = straight_log()
    assert metrics.regret(log, log, benign=False).total == 0
    assert metrics.regret(log._replace(ended="spin"), log, benign=False).total == metrics.WORST
    assert metrics.ENDED_BADLY.total == metrics.WORST


@pytest.mark.parametrize(
    ("columns", "part", "value"),
    [
        ({"VY": 20 * math.tan(math.radians(5))}, "sideslip", 1.0),
        ({"BRAKE_WORK": np.linspace(0, 50e3, 101)}, "energy", 1.0),
        ({"YAW": np.linspace(0, math.radians(10), 101)}, "heading", 1.0),
        ({"YAW": np.linspace(0, -math.radians(370), 101)}, "heading", 3.0),  # whole turns count, up to 30 deg
        ({"Y": 1.0}, "path", 1.0),
        ({"Y": -9.0}, "path", 3.0),
        ({"BRAKE_WORK": np.linspace(0, 500e3, 101)}, "energy", 4.0),
    ],
)
def test_each_part_of_regret_has_its_unit_and_its_limit(columns, part, value):
    regret = metrics.regret(straight_log(**columns), straight_log(), benign=False)
    assert getattr(regret, part) == pytest.approx(value)


def test_only_excess_sideslip_and_energy_are_regretted():
    eager = straight_log(BRAKE_WORK=np.linspace(0, 100e3, 101))
    assert metrics.regret(straight_log(), eager, benign=False).energy == 0


def test_in_a_benign_drive_only_needless_braking_counts():
    braked = straight_log(BRAKE_WORK=np.linspace(0, 10e3, 101), Y=2.0)
    assert metrics.regret(braked, straight_log(), benign=True).total == pytest.approx(2.0)


def test_path_deviation_is_taken_at_equal_arc_length_not_at_equal_time():
    assert metrics.path_deviation_m(straight_log(speed=15.0), straight_log(speed=20.0)) == pytest.approx(0, abs=1e-12)
    assert metrics.path_deviation_m(straight_log(speed=25.0, offset=-0.4), straight_log()) == pytest.approx(0.4)


def test_intervention_is_the_time_during_which_something_is_asked_for():
    log = straight_log()
    added = np.zeros((101, 4))
    added[10:30, 2] = 100.0
    assert metrics.intervention_s(log._replace(added=added)) == pytest.approx(0.2)


def test_every_metric_of_a_real_drive_is_a_number():
    log = rollout(scenario("sine_with_dwell"), "ekf", "esc", 0)
    for name, metric in metrics.METRICS.items():
        assert math.isfinite(metric(log)), name
    assert metrics.brake_energy_kJ(log) > 10
    assert metrics.spin(rollout(scenario("sine_with_dwell"), "ekf", "none", 0)) == 1
