"""The switching estimator is its two schemes, and the switch is where it says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.switching import SwitchingEstimator
from vse_gym.inference.pretreatment import low_pass
from vse_gym.models.pretreatment import Pretreatment
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Y_AY, Y_YAW_RATE, Reading

ALL_PASS = Pretreatment(ay_band=np.inf, yaw_rate_band=np.inf)


@pytest.fixture(scope="module")
def cell():
    return scenario("slalom", "qin2014_understeer", "loud")


@pytest.fixture(scope="module")
def log(cell):
    return rollout(cell, "truth", "none", 0)


def heard(log, estimator, nominal):
    """Estimates (T, 5), and which scheme gave them."""
    rng = np.random.default_rng(0)
    state, said, kinematic = estimator.init(nominal, rng), [], []
    for k in range(len(log.time)):
        state = estimator.update(state, Reading(float(log.time[k]), log.inputs[k], log.readings[k]), rng)
        said.append(estimator.estimate(state)[:5])
        kinematic.append(state.kinematic)
    return np.array(said), np.array(kinematic)


def test_with_an_infinite_threshold_it_is_the_dynamic_scheme(log, cell):
    said, kinematic = heard(log, SwitchingEstimator(threshold=np.inf), cell.nominal)
    assert not kinematic.any()
    filtered = shadow(log, ESTIMATORS.make("kf"), cell.nominal, 0).estimate
    np.testing.assert_array_equal(said[:, [0, 1, 2, 4]], filtered[:, [0, 1, 2, 4]])


def test_with_a_threshold_of_zero_it_is_the_kinematic_scheme(log, cell):
    said, kinematic = heard(log, SwitchingEstimator(threshold=0.0, treatment=ALL_PASS), cell.nominal)
    assert kinematic.all()
    c = low_pass(100.0, 1.0, cell.dt)
    ay = signal.lfilter(c[:3], [1.0, *c[3:]], log.readings[:, Y_AY])
    vy = np.cumsum(cell.dt * (ay - log.readings[:, Y_YAW_RATE] * said[:, 0]))
    np.testing.assert_allclose(said[:, 1], vy, atol=1e-10)
    np.testing.assert_allclose(said[:, 4], ay, atol=1e-12)


def test_the_kinematic_scheme_runs_while_the_median_is_above_the_threshold(log, cell):
    _, kinematic = heard(log, SwitchingEstimator(treatment=ALL_PASS), cell.nominal)
    c = low_pass(100.0, 1.0, cell.dt)
    ay = signal.lfilter(c[:3], [1.0, *c[3:]], log.readings[:, Y_AY])
    median = np.array([np.median(ay[max(0, k - 4) : k + 1]) for k in range(len(ay))])
    np.testing.assert_array_equal(kinematic, np.abs(median) > 1.5)
    assert kinematic.any() and not kinematic.all()


def test_each_scheme_starts_from_the_others_vy(log, cell):
    said, kinematic = heard(log, SwitchingEstimator(), cell.nominal)
    jumps = np.abs(np.diff(said[:, 1]))
    switches = np.nonzero(np.diff(kinematic.astype(int)))[0]
    # vy moves at a switch by what a step moves it, ay dt and v r dt, and not by the schemes' disagreement
    assert jumps[switches].max() < 2 * np.quantile(jumps, 0.99)


def test_hysteresis_spares_switches(log, cell):
    # An ay at the threshold, of which the filters leave noise of some 0.15 m/s2
    readings = log.readings.copy()
    readings[:, Y_AY] = np.random.default_rng(2).normal(1.5, 0.3, len(readings))
    noisy = log._replace(readings=readings)

    def switches(hysteresis):
        estimator = SwitchingEstimator(hysteresis=hysteresis, treatment=ALL_PASS)
        _, kinematic = heard(noisy, estimator, cell.nominal)
        return int(np.sum(kinematic[1:] != kinematic[:-1]))

    assert switches(0.0) > 50
    assert switches(0.3) < 0.2 * switches(0.0)


def test_the_variance_grows_while_the_integral_runs(log, cell):
    estimator, rng = SwitchingEstimator(threshold=0.0), np.random.default_rng(0)
    state, variances = estimator.init(cell.nominal, rng), []
    for k in range(50):
        state = estimator.update(state, Reading(0.0, log.inputs[k], log.readings[k]), rng)
        variances.append(estimator.estimate(state).cov[1, 1])
    sheet, v = cell.nominal.sheet, cell.nominal.speed
    grown = cell.dt**2 * (sheet.acceleration**2 + v**2 * sheet.yaw_rate**2)
    np.testing.assert_allclose(np.diff(variances), grown, rtol=0.1)  # the speed is the wheels'


def test_it_knows_the_sideslip_where_tyres_slide_better_than_its_dynamic_scheme():
    cell = scenario("sine_with_dwell", "qin2014_understeer", "gaussian", friction=0.5)
    log = rollout(cell, "truth", "esc", 0)
    error = [
        np.std(shadow(log, ESTIMATORS.make(name), cell.nominal, 0).estimate[:, 1] - log.truth[:, p.VY])
        for name in ("switching", "kf")
    ]
    assert error[0] < 0.7 * error[1]


@pytest.mark.parametrize("channel", [Y_AY, Y_YAW_RATE], ids=["ay", "yaw rate"])
@pytest.mark.parametrize("name", ["switching", "fusion"])
def test_a_sensor_that_falls_silent_in_a_turn_is_not_integrated(name, channel, log, cell):
    # From the hardest turn on, for a second. The tyre model alone is off by 0.9 deg at most; the last reading,
    # integrated for as long as that, would be off by 14 to 22.
    begin = int(np.argmax(np.abs(log.truth[: len(log.time) - 200, p.AY])))
    readings = log.readings.copy()
    readings[begin : begin + 100, channel] = np.nan
    said = shadow(log._replace(readings=readings), ESTIMATORS.make(name), cell.nominal, 0).estimate
    error = np.degrees(np.arctan2(said[:, 1], said[:, 0]) - log.sideslip)
    assert np.abs(error[begin : begin + 200]).max() < 1.5


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"median": 4}, "median must be odd"),
        ({"hysteresis": 2.0}, "hysteresis must lie"),
        ({"stiffness": 0.0}, "stiffness"),
    ],
)
def test_wrong_settings_are_refused(settings, says):
    with pytest.raises(ValueError, match=says):
        replace(SwitchingEstimator(), **settings)
