"""Each noise law against its own density and figures, and the promise that a seed decides everything."""

import hashlib
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from vse_gym.physics import parameters as p
from vse_gym.registry import UnknownNameError
from vse_gym.sensors import (
    FITTED,
    LOUD,
    QUIET,
    SUITES,
    Sensors,
    cauchy_gaussian,
    contamination,
    episodes,
    read_sensors,
    stream,
    suite,
)
from vse_gym.simulation import rollout, scenario
from vse_gym.types import CHANNELS

DT = 0.01
DEG = np.pi / 180
SEEDS = [0, 1, 2]
IMU = slice(0, 3)  # accelerometers and gyro
ABOARD = slice(0, FITTED)  # what every car has
BIASED = Sensors(noise=False, acceleration_bias=0.3, yaw_rate_bias=0.005)
every_suite = pytest.mark.parametrize("name", SUITES)


def mixture(alpha, scale):
    """Distribution function whose density is A.3's: a Cauchy share and a normal one of variance 2 scale^2."""
    share = contamination(alpha)
    heavy, core = stats.cauchy(scale=scale), stats.norm(scale=np.sqrt(2) * scale)
    return lambda x: share * heavy.cdf(x) + (1 - share) * core.cdf(x)


def assert_follows(draws, distribution):
    # Kolmogorov's bound at the 0.1 % level, for any sample size.
    assert stats.kstest(draws, distribution).statistic < 1.95 / np.sqrt(draws.size)


def runs(flags):
    """Lengths of the unbroken runs of true in a column."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return edges[1::2] - edges[::2]


def test_the_contamination_runs_from_all_cauchy_to_all_gaussian():
    assert contamination(1) == 1
    assert contamination(2) == 0
    assert contamination(1.3) == pytest.approx((4 - 1.69) / 5.07, rel=1e-12)


@given(st.floats(1, 2), st.floats(1, 2))
def test_heavier_tails_mean_more_contamination(one, other):
    heavier, lighter = sorted((one, other))
    assert 1 >= contamination(heavier) >= contamination(lighter) >= 0


@pytest.mark.parametrize("alpha", [0.999, 2.001, -1.5, float("nan"), float("inf")])
def test_an_alpha_outside_one_to_two_is_refused(alpha):
    with pytest.raises(ValueError, match="alpha"):
        contamination(alpha)
    with pytest.raises(ValueError, match="alpha"):
        Sensors(alpha=alpha)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("alpha", [1.0, 1.3, 1.5, 1.9, 2.0])
@pytest.mark.parametrize("scale", [1.0, 0.05])
def test_draws_follow_the_cauchy_gaussian_density(alpha, scale, seed):
    draws = cauchy_gaussian(alpha, scale, (100_000,), np.random.default_rng(seed))
    assert_follows(draws, mixture(alpha, scale))


def test_the_core_has_the_variance_that_a_kalman_filter_is_told():
    draws = cauchy_gaussian(2.0, 0.7, (100_000,), np.random.default_rng(0))
    assert draws.var() == pytest.approx(2 * 0.7**2, rel=0.02)  # a variance of n normal draws spreads by sqrt(2/n)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("alpha", [1.3, 1.5, 1.9])
@pytest.mark.parametrize("sheet", [QUIET, LOUD])
def test_heavy_tails_have_the_sheets_core(sheet, alpha, seed):
    added = Sensors(sheet, alpha=alpha).record(30_000, DT, seed).added
    for channel, sigma in enumerate((sheet.acceleration, sheet.acceleration, sheet.yaw_rate)):
        assert_follows(added[:, channel], mixture(alpha, sigma / np.sqrt(2)))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("sheet", [QUIET, LOUD])
@pytest.mark.parametrize("alpha", [1.3, 2.0])
def test_what_is_not_heavy_tailed_is_normal_with_the_sheets_sigma(sheet, alpha, seed):
    record = Sensors(sheet, alpha=alpha).record(30_000, DT, seed)
    for wheel in range(4):
        assert_follows(record.added[:, 3 + wheel], stats.norm(scale=sheet.wheel_speed).cdf)
        assert_follows(record.brake[:, wheel], stats.norm(scale=sheet.brake).cdf)
    assert_follows(record.steer, stats.norm(scale=sheet.steer).cdf)
    if alpha == 2:
        assert_follows(record.added[:, 0], stats.norm(scale=sheet.acceleration).cdf)
        assert_follows(record.added[:, 2], stats.norm(scale=sheet.yaw_rate).cdf)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bias_is_constant_and_only_on_accelerometers_and_gyro(seed):
    added = BIASED.record(100, DT, seed).added
    assert np.all(added == added[0])
    np.testing.assert_array_equal(np.abs(added[0]), [0.3, 0.3, 0.005, 0, 0, 0, 0, 0, 0, 0])


def test_a_bias_has_either_sign_in_each_channel_on_its_own():
    signs = np.array([np.sign(BIASED.record(1, DT, seed).added[0, IMU]) for seed in range(200)])
    # 200 fair coins: the mean spreads by 0.07, and so does the product of two of them.
    assert np.all(np.abs(signs.mean(axis=0)) < 0.3)
    assert np.all(np.abs(signs.T @ signs / 200 - np.eye(3)) < 0.3)


@pytest.mark.parametrize("seed", SEEDS)
def test_silences_cover_the_share_of_time_that_their_rate_and_length_give(seed):
    # Episodes that begin at random and may overlap leave exp(-rate mean length) of the time untouched. 1000 episodes
    # a channel spread by 3 %, seven channels by 1.3 %.
    rate, shortest, longest = 0.5, 0.05, 0.2
    silent = Sensors(silence_rate=rate, silence=(shortest, longest)).record(200_000, DT, seed).silent
    expected = -np.expm1(-rate * (shortest + longest) / 2)
    assert silent.shape[1] == len(CHANNELS)
    assert silent[:, FITTED:].all()  # not on board
    assert silent[:, ABOARD].mean() == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(silent[:, ABOARD].mean(axis=0), expected, rtol=0.15)


@pytest.mark.parametrize("seed", SEEDS)
def test_episodes_last_as_long_as_they_may(seed):
    hit = episodes(0.05, 0.05, 0.2, 20_000, 20, DT, np.random.default_rng(seed))
    lengths = np.concatenate([runs(column != 0) for column in hit.T])
    assert lengths.size > 100
    # The end of the record may cut one a channel short; an overlap, 1 % here, makes one longer.
    assert np.mean(lengths >= 5) > 0.97
    assert np.mean(lengths <= 20) > 0.97
    # Uniform from 5 to 20 steps: mean 12.5, spread 4.3, of some 200.
    assert lengths.mean() == pytest.approx(12.5, abs=1.5)
    assert {5, 6, 19, 20} <= set(range(lengths.min(), lengths.max() + 1))


@pytest.mark.parametrize("seed", SEEDS)
def test_bursts_come_as_often_as_asked_with_either_sign_and_the_given_size(seed):
    sensors = Sensors(noise=False, burst_rate=0.2, acceleration_burst=8.0, yaw_rate_burst=30 * DEG)
    added = sensors.record(100_000, DT, seed).added
    for channel, size in enumerate((8.0, 8.0, 30 * DEG)):
        hit = added[:, channel] != 0
        np.testing.assert_array_equal(np.unique(np.abs(added[hit, channel])), [size])
        assert set(np.sign(added[hit, channel])) == {-1.0, 1.0}
        lengths = runs(hit)
        assert lengths.size / 1000 == pytest.approx(0.2, rel=0.3)  # 200 of them spread by 7 %; overlaps join 1.5 %
        assert np.mean((lengths >= 5) & (lengths <= 10)) > 0.93  # 50 to 100 ms, but for what overlaps or is cut
    assert not added[:, 3:].any()


def test_no_rate_means_no_episode():
    record = SUITES["gaussian"].record(10_000, DT, 0)
    assert not record.silent[:, ABOARD].any()
    assert not episodes(0.0, 0.05, 0.1, 1000, 7, DT, np.random.default_rng(0)).any()


def spread(name, seed=0):
    """Standard deviation of what a suite adds to each channel, to the steering angle and to the brakes."""
    record = suite(name).record(20_000, DT, seed)
    return [*record.added[:, ABOARD].std(axis=0), record.steer.std(), record.brake.std()]


@pytest.mark.parametrize(
    ("name", "acceleration", "gyro", "wheel"),
    [
        ("gaussian", 0.05, 0.1, 0.03),
        ("biased", 0.05, 0.1, 0.03),
        ("dropout", 0.05, 0.1, 0.03),
        ("loud", 0.3, 1.0, 0.1),
        ("clean", 0.0, 0.0, 0.0),
    ],
)
def test_suites_are_as_noisy_as_the_battery_says(name, acceleration, gyro, wheel):
    inputs = [0.0, 0.0] if name == "clean" else [0.02 * DEG, 0.02]
    expected = [acceleration, acceleration, gyro * DEG, *[wheel] * 4, *inputs]
    np.testing.assert_allclose(spread(name), expected, rtol=0.03)  # 20 000 draws: 0.5 % each


def test_the_heavy_tailed_suite_has_the_loud_core_and_clips():
    sensors = suite("cauchy_gaussian")
    assert sensors.alpha == 1.3
    added = sensors.record(100_000, DT, 0).added
    assert_follows(added[:, 0], mixture(1.3, 0.3 / np.sqrt(2)))
    assert_follows(added[:, 2], mixture(1.3, 1.0 * DEG / np.sqrt(2)))
    np.testing.assert_allclose(sensors.record(1, DT, 0).limits[IMU], [20, 20, 100 * DEG], rtol=1e-12)


def test_the_biased_suite_is_off_by_its_biases():
    mean = suite("biased").record(20_000, DT, 0).added.mean(axis=0)
    np.testing.assert_allclose(np.abs(mean[IMU]), [0.3, 0.3, 0.3 * DEG], rtol=0.01)  # noise averages to 0.2 % of it
    assert np.abs(mean[3:]).max() < 4 * 0.03 / np.sqrt(20_000)


def test_the_dropout_suite_silences_each_channel_once_in_two_seconds():
    silent = suite("dropout").record(200_000, DT, 0).silent
    lengths = [runs(column) for column in silent[:, ABOARD].T]
    # 1000 in 2000 s, of which 5 % run into the one before; shorter and longer ones are cut or joined.
    assert all(len(channel) / 2000 == pytest.approx(0.5, rel=0.15) for channel in lengths)
    assert np.mean(np.concatenate(lengths) >= 5) > 0.99
    assert np.mean(np.concatenate(lengths) <= 20) > 0.9


def test_the_outlier_suite_has_a_burst_a_second_and_channel():
    added = suite("outliers").record(200_000, DT, 0).added[:, IMU]
    size, sigma = np.array([8.0, 8.0, 30 * DEG]), np.array([0.05, 0.05, 0.1 * DEG])
    hit = np.abs(added) > size / 2
    for channel in range(3):
        assert len(runs(hit[:, channel])) / 2000 == pytest.approx(1.0, rel=0.15)  # 7 % run into the one before
        inside = np.abs(added[hit[:, channel], channel])
        assert inside.mean() == pytest.approx(size[channel], rel=1e-3)
        assert inside.std() == pytest.approx(sigma[channel], rel=0.05)


def readings(record, state, inputs=None):
    """All readings of a record at one state, (steps, 9), (steps, 10) and what was last heard, (steps, 10)."""
    inputs = inputs or p.Inputs(0.0, np.zeros(4), np.zeros(4))
    heard, rows = np.zeros(10), []
    for step in range(len(record.added)):
        u, y, heard = read_sensors(record, step, state, inputs, heard)
        rows.append((u, y, heard))
    return tuple(map(np.array, zip(*rows, strict=True)))


STATE = 0.1 * np.arange(1.0, p.STATE_SIZE + 1)  # within every range
TRUE_Y = np.concatenate((STATE[[p.AX, p.AY, p.YAW_RATE]], STATE[p.WHEEL_SPEEDS]))  # of what is on board


@pytest.mark.parametrize("seed", SEEDS)
def test_readings_stop_at_the_sensors_range(seed):
    sensors = replace(suite("cauchy_gaussian"), acceleration_range=3.0, yaw_rate_range=0.2)
    _, y, _ = readings(sensors.record(2000, DT, seed), np.zeros(p.STATE_SIZE))
    for channel, limit in enumerate((3.0, 3.0, 0.2)):
        assert y[:, channel].max() == limit
        assert y[:, channel].min() == -limit


def test_clean_readings_are_the_truth():
    inputs = p.Inputs(0.03, np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0]))
    u, y, heard = readings(suite("clean").record(50, DT, 0), STATE, inputs)
    assert np.all(y[:, ABOARD] == TRUE_Y) and np.isnan(y[:, FITTED:]).all()
    assert np.all(heard[:, ABOARD] == TRUE_Y) and not heard[:, FITTED:].any()
    assert np.all(u == [0.03, *inputs.brake, *inputs.drive])


def test_a_clean_drive_reads_what_happened():
    log = rollout(scenario("held_steer", sensors="clean", duration=1.0), "zero", "esc", 0)
    true = np.column_stack((log.truth[:, [p.AX, p.AY, p.YAW_RATE]], log.truth[:, p.WHEEL_SPEEDS]))
    np.testing.assert_array_equal(log.readings[:, ABOARD], true)
    np.testing.assert_array_equal(log.inputs[:, 0], log.steer)
    np.testing.assert_array_equal(log.inputs[:, 1:5], log.brake)


def test_a_silent_channel_says_nothing_and_its_last_word_is_kept():
    record = Sensors(silence_rate=3.0).record(3000, DT, 0)
    _, y, heard = readings(record, STATE)
    np.testing.assert_array_equal(np.isnan(y), record.silent)
    spoken = np.where(record.silent, 0.0, np.append(TRUE_Y, np.zeros(3)) + record.added)
    last = np.maximum.accumulate(np.where(record.silent, -1, np.arange(3000)[:, None]), axis=0)
    expected = np.where(last < 0, 0.0, np.take_along_axis(spoken, np.maximum(last, 0), axis=0))
    np.testing.assert_array_equal(heard, expected)


@every_suite
@pytest.mark.parametrize("seed", SEEDS)
def test_a_seed_gives_the_same_record_bit_for_bit(name, seed):
    one, other = (suite(name).record(1000, DT, seed) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@every_suite
def test_another_seed_gives_other_noise(name):
    one, other = (suite(name).record(1000, DT, seed) for seed in (0, 1))
    same = (one.added == other.added).all() and (one.steer == other.steer).all()
    assert same == (not suite(name).noise)


def test_what_goes_wrong_does_not_change_the_noise_beneath():
    plain, silenced, rough = (suite(name).record(1000, DT, 5) for name in ("gaussian", "dropout", "outliers"))
    np.testing.assert_array_equal(plain.added, silenced.added)
    difference = np.abs(rough.added - plain.added) / [8.0, 8.0, 30 * DEG, *7 * [1]]
    np.testing.assert_allclose(difference, np.rint(difference), atol=1e-12)  # nothing, or one whole burst
    assert set(np.rint(difference[:, IMU]).ravel()) == {0.0, 1.0}
    assert not difference[:, 3:].any()


def unit_noise(sensors, record):
    """Everything random in a record that is a number, over its sigma, (steps, 12)."""
    sheet = sensors.sheet
    sigma = [sheet.acceleration] * 2 + [sheet.yaw_rate] + [sheet.wheel_speed] * 4 + [sheet.steer] + [sheet.brake] * 4
    return np.column_stack((record.added[:, ABOARD], record.steer, record.brake)) / sigma


@pytest.mark.parametrize("name", ["gaussian", "loud"])
def test_no_draw_serves_twice_and_channels_are_not_correlated(name):
    n, sensors = 20_000, suite(name)
    both = np.column_stack([unit_noise(sensors, sensors.record(n, DT, seed)) for seed in (7, 8)])
    correlation = np.corrcoef(both.T) - np.eye(both.shape[1])
    assert np.abs(correlation).max() < 5 / np.sqrt(n)  # five standard deviations, for 276 pairs
    assert np.unique(np.round(both, 10)).size > 0.999 * both.size  # of 480 000 numbers some 10 agree by chance


@pytest.mark.parametrize("seed", SEEDS)
@every_suite
def test_an_estimators_generator_repeats_no_sensors_draws(name, seed):
    steps, sensors = 2000, suite(name)
    record = sensors.record(steps, DT, seed)
    sensed = unit_noise(sensors, record)
    for shape in ((steps, 12), (steps, 7), (steps, 5), (steps, 3), (steps,)):  # whatever it asks for first
        drawn = stream(seed, "estimator").standard_normal(shape)
        assert np.intersect1d(np.round(drawn, 12), np.round(sensed[sensed != 0], 12)).size < 3
    quiet = stream(seed, "estimator").random((steps, 7))
    silent = record.silent[:, ABOARD]
    begins = silent & ~np.roll(silent, 1, axis=0)
    if begins.any():  # drop-outs begin where a small uniform number was drawn
        assert quiet[begins].mean() > 0.3


def test_streams_differ_by_seed_and_by_name():
    firsts = {stream(seed, name).integers(2**63) for seed in range(50) for name in ("estimator", "sensors/noise", "a")}
    assert len(firsts) == 150


@pytest.mark.parametrize("field", [f.name for f in fields(Sensors) if isinstance(f.default, float)])
@pytest.mark.parametrize("wrong", [-0.1, float("nan")])
def test_a_negative_setting_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=field):
        Sensors(**{field: wrong})


@pytest.mark.parametrize("field", [f.name for f in fields(Sensors) if type(f.default) is tuple])
def test_a_negative_duration_is_refused_by_name(field):
    with pytest.raises(ValueError, match=field):
        Sensors(**{field: (-0.1, 0.2)})


def test_an_unknown_suite_is_told_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"gaussian.*outliers"):
        suite("perfect")


def test_a_suite_of_ones_own_is_taken_as_it_is():
    assert suite(BIASED) is BIASED


@pytest.mark.parametrize(
    ("name", "digest"),
    [("gaussian", "c8974a033e4edf0b"), ("cauchy_gaussian", "be1317dba2c7113b"), ("outliers", "3d627a4760e890b3")],
)
def test_published_suites_draw_what_they_always_drew(name, digest):
    # Frozen: a change here moves every published result.
    u, y, _ = readings(suite(name).record(600, DT, 1), STATE, p.Inputs(0.03, np.full(4, 100.0), np.full(4, 900.0)))
    rounded = np.round(np.column_stack((u, y[:, ABOARD])), 9) + 0.0  # 9 digits: libm's last bit may differ by platform
    assert hashlib.blake2b(rounded.tobytes(), digest_size=8).hexdigest() == digest
