"""Sensors that no production car has: how they are switched on, what they read, and what a filter makes of them."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy import stats
from typer.testing import CliRunner

from vse_gym.catalogue import ESTIMATORS
from vse_gym.cli import app
from vse_gym.controllers.observation import LAYOUTS
from vse_gym.physics import parameters as p
from vse_gym.registry import UnknownNameError
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.sensors import EXTRAS, LOUD, QUIET, SUITES, Sensors, suite, with_extras
from vse_gym.simulation import rollout
from vse_gym.types import CHANNELS, Y_ROLL_RATE, Y_SIDESLIP, Y_SPEED, Y_YAW_RATE

DT = 0.01
DEG = np.pi / 180
SEEDS = [0, 1, 2]
OPTICAL = [Y_SPEED, Y_SIDESLIP]
ALL = "+optical+roll_rate"


@pytest.mark.parametrize("extra", EXTRAS)
@pytest.mark.parametrize("name", SUITES)
def test_every_suite_can_have_every_extra_and_stays_as_it_is_otherwise(name, extra):
    plain, full = suite(name), suite(f"{name}+{extra}")
    assert replace(full, sheet=plain.sheet) == plain
    assert full.sheet[:5] == plain.sheet[:5]
    assert np.isnan(plain.sheet[5:]).all()
    assert np.isfinite(full.sheet[5:]).any()


def test_extras_come_in_any_order_and_to_sensors_of_ones_own():
    assert suite("loud+optical+roll_rate") == suite("loud+roll_rate+optical")
    mine = Sensors(LOUD, delay=0.1)
    assert with_extras(mine, "optical") == Sensors(LOUD._replace(speed=0.05, sideslip=0.1 * DEG), delay=0.1)
    assert with_extras(mine) is mine


@pytest.mark.parametrize("name", ["gaussian+laser", "gaussian+", "gaussian+optical+optica"])
def test_an_unknown_extra_is_told_the_known_ones(name):
    with pytest.raises(UnknownNameError, match=r"no extra sensor named .*; known: optical, roll_rate"):
        suite(name)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("name", "sheet"), [("gaussian", QUIET), ("loud", LOUD)])
def test_their_noise_is_normal_with_the_sheets_sigma(name, sheet, seed):
    added = suite(name + ALL).record(30_000, DT, seed).added
    for channel, sigma in zip((7, 8, 9), (0.05, 0.1 * DEG, sheet.yaw_rate), strict=True):
        # Kolmogorov's bound at the 0.1 % level
        assert stats.kstest(added[:, channel], stats.norm(scale=sigma).cdf).statistic < 1.95 / np.sqrt(30_000)


@pytest.mark.parametrize(
    "fault",
    [
        {"yaw_rate_bias": 0.01},
        {"yaw_rate_walk": 0.01},
        {"burst_rate": 2.0},
        {"alpha": 1.3},
        {"freedom": 2.0},
        {"growth": 6.0},
    ],
    ids=lambda fault: next(iter(fault)),
)
def test_a_roll_gyro_has_the_gyros_faults_by_draws_of_its_own(fault):
    plain = suite("gaussian" + ALL)
    faulty = replace(plain, **fault)
    change = faulty.record(5000, DT, 1).added - plain.record(5000, DT, 1).added
    assert change[:, Y_ROLL_RATE].any()
    assert not np.array_equal(change[:, Y_ROLL_RATE], change[:, Y_YAW_RATE])
    assert not change[:, OPTICAL].any()
    quiet = replace(faulty, noise=False).record(1, DT, 1).added[0]
    assert abs(quiet[Y_ROLL_RATE]) == abs(quiet[Y_YAW_RATE])  # the bias has one size
    limits = faulty.record(1, DT, 1).limits
    assert limits[Y_ROLL_RATE] == limits[Y_YAW_RATE]


def test_they_drop_out_as_often_as_the_others():
    silent = suite("dropout" + ALL).record(200_000, DT, 0).silent
    # As in the test of silences: 1000 episodes a channel spread by 3 %
    np.testing.assert_allclose(silent.mean(axis=0), -np.expm1(-0.5 * 0.125), rtol=0.15)
    assert len({column.tobytes() for column in silent.T}) == len(CHANNELS)


def sliding(sensors, **settings):
    """A drive on snow that the stability control has to save; no estimate is as good there as on a dry road."""
    return scenario("sine_with_dwell", sensors=sensors, friction=0.4, amplitude=100 * DEG, **settings)


def sideslip_rmse(trace, log):
    guess = np.arctan2(trace.estimate[:, 1], trace.estimate[:, 0])
    return float(np.sqrt(np.mean((guess - log.sideslip) ** 2)))


@pytest.fixture(scope="module")
def slides():
    """Drives of the true states with an optical sensor on board, one a seed."""
    cell = sliding("gaussian+optical+roll_rate")
    return cell.nominal, [rollout(cell, "truth", "esc", seed) for seed in SEEDS]


@pytest.mark.parametrize("name", ["ekf", "ukf", "pf"])
def test_a_filter_with_an_optical_sensor_is_better_by_more_than_half(slides, name):
    told, logs = slides
    untold = replace(told, sheet=QUIET)
    estimator = ESTIMATORS.make(name)
    for seed, log in zip(SEEDS, logs, strict=True):
        seeing, blind = (sideslip_rmse(shadow(log, estimator, n, seed), log) for n in (told, untold))
        assert seeing < 0.5 * blind
        assert seeing < 0.15 * DEG  # the sensor's own sigma is 0.1 deg


@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_the_angle_alone_helps_and_the_speed_adds_little(slides, name):
    told, (log, *_) = slides
    estimator = ESTIMATORS.make(name)
    blind, angle, both = (
        sideslip_rmse(shadow(log, estimator, replace(told, sheet=QUIET._replace(**sigma)), 0), log)
        for sigma in ({}, {"sideslip": 0.1 * DEG}, {"sideslip": 0.1 * DEG, "speed": 0.05})
    )
    assert angle < 0.5 * blind
    assert both < 1.1 * angle  # the speed says little about the angle


@pytest.mark.parametrize("name", [name for name in ESTIMATORS if not name.startswith("truth")])
def test_a_sensor_that_is_absent_costs_nothing(slides, name):
    # Whether an estimator is not told of sensors that speak, or told of sensors that are silent: bit by bit the same.
    told, (log, *_) = slides
    readings = log.readings.copy()
    readings[:, 7:] = np.nan
    estimator = ESTIMATORS.make(name)
    bare = shadow(log._replace(readings=readings), estimator, replace(told, sheet=QUIET), 0)
    untold = shadow(log, estimator, replace(told, sheet=QUIET), 0)
    silent = shadow(log._replace(readings=readings), estimator, told, 0)
    for other in (untold, silent):
        np.testing.assert_array_equal(other.estimate, bare.estimate)
        np.testing.assert_array_equal(other.cov, bare.cov)
        np.testing.assert_array_equal(other.nis, bare.nis)


def test_an_extra_sensor_aboard_does_not_change_the_drive_of_who_does_not_use_it():
    bare, full = (rollout(sliding("loud" + extras), "zero", "esc", 3) for extras in ("", ALL))
    np.testing.assert_array_equal(bare.truth, full.truth)
    np.testing.assert_array_equal(bare.readings[:, :7], full.readings[:, :7])


@pytest.mark.parametrize("observation", LAYOUTS)
def test_gymnasium_s_checker_has_nothing_to_say_of_an_optical_sensor(observation):
    check_env(
        gymnasium.make("vse_gym/SineWithDwell-v0", observation=observation, sensors="harsh+optical+roll_rate").unwrapped
    )


def names(layout):
    return [feature.name for feature in LAYOUTS[layout]]


@pytest.mark.parametrize("extras", ["", "+optical", ALL])
def test_an_agent_sees_extra_sensors_where_they_are_and_zeros_where_they_are_not(extras):
    env = gymnasium.make("vse_gym/HeldSteer-v0", observation="reading", sensors="gaussian" + extras, duration=1.0)
    env.reset(seed=0)
    where = {name: k for k, name in enumerate(names("reading"))}
    for _ in range(50):
        seen, *_, info = env.step(np.zeros(4, np.float32))
        assert env.observation_space.contains(seen)
        for name in ("speed", "sideslip", "roll_rate"):
            aboard = (name in ("speed", "sideslip") and "optical" in extras) or name in extras
            assert seen[where[f"{name}_valid"]] == aboard
            assert (seen[where[name]] != 0) == aboard
    truth = info["truth"]
    if extras:  # five sigmas
        assert seen[where["speed"]] == pytest.approx(np.hypot(truth["vx"], truth["vy"]), abs=0.25)
        assert seen[where["sideslip"]] == pytest.approx(truth["sideslip"], abs=0.5 * DEG)


def test_the_limits_of_an_agents_readings_hold_a_fast_slide():
    low = {f.name: f.low for f in LAYOUTS["reading"]}
    high = {f.name: f.high for f in LAYOUTS["reading"]}
    assert low["speed"] == 0 and high["speed"] > 250 / 3.6
    assert high["sideslip"] == -low["sideslip"] == np.pi
    assert high["roll_rate"] == -low["roll_rate"] > Sensors().yaw_rate_range
    assert all(low[f"{name}_valid"] == 0 and high[f"{name}_valid"] == 1 for name in CHANNELS)


def test_the_roll_sensor_reads_the_plants_roll_rate():
    log = rollout(scenario("held_steer", sensors="clean+roll_rate", duration=1.0), "zero", "none", 0)
    np.testing.assert_array_equal(log.readings[:, Y_ROLL_RATE], log.truth[:, p.ROLL_RATE])
    assert np.isnan(log.readings[:, OPTICAL]).all()


def test_the_command_line_knows_extra_sensors():
    call = CliRunner().invoke
    driven = call(app, ["run", "held_steer", "--sensors", "loud+optical"])
    assert driven.exit_code == 0 and "loud+optical sensors" in " ".join(driven.output.split())
    refused = call(app, ["run", "held_steer", "--sensors", "loud+laser"])
    assert refused.exit_code == 2 and "known: optical, roll_rate" in " ".join(refused.output.split())
    listed = call(app, ["list"]).output
    assert all(f"+{extra}" in listed for extra in EXTRAS)
