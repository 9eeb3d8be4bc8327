"""Sets of sensors: what their settings and their names add to the truth, and which settings cannot be."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats

from vse_gym.models import DataSheet, Nominal
from vse_gym.noise import contamination, growing_sigma
from vse_gym.registry import UnknownNameError
from vse_gym.sensors import FITTED, LOUD, QUIET, Resolution, Sensors, suite
from vse_gym.types import CHANNELS
from vse_gym.vehicles import load

DT = 0.01
DEG = np.pi / 180
SEEDS = [0, 1, 2]
IMU = slice(0, 3)  # accelerometers and gyro
ABOARD = slice(0, FITTED)  # what every car has
BIASED = Sensors(noise=False, acceleration_bias=0.3, yaw_rate_bias=0.005)


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


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("alpha", [1.3, 1.5, 1.9])
@pytest.mark.parametrize("sheet", [QUIET, LOUD])
def test_heavy_tails_have_the_sheets_core(sheet, alpha, seed):
    added = Sensors(sheet, alpha=alpha).record(30_000, DT, seed).added
    for channel, sigma in enumerate((sheet.acceleration, sheet.acceleration, sheet.yaw_rate)):
        assert_follows(added[:, channel], mixture(alpha, sigma / np.sqrt(2)))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_other_rule_for_alpha_is_another_share(seed):
    one, other = (Sensors(alpha=1.3, alpha_rule=rule).record(30_000, DT, seed) for rule in ("published", "log_moment"))
    share = contamination(1.3, "log_moment")
    cdf = lambda x: share * stats.cauchy(scale=0.05 / np.sqrt(2)).cdf(x) + (1 - share) * stats.norm(scale=0.05).cdf(x)  # noqa: E731
    assert_follows(other.added[:, 1], cdf)
    differ = (one.added != other.added).any(axis=0)
    assert differ[IMU].all() and not differ[3:].any()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("freedom", [1.0, 3.0])
@pytest.mark.parametrize("sheet", [QUIET, LOUD])
def test_students_noise_has_the_sheets_sigma_for_its_scale(sheet, freedom, seed):
    added = Sensors(sheet, freedom=freedom).record(30_000, DT, seed).added
    for channel, sigma in enumerate((sheet.acceleration, sheet.acceleration, sheet.yaw_rate)):
        assert_follows(added[:, channel], stats.t(freedom, scale=sigma).cdf)
    np.testing.assert_array_equal(added[:, 3:], Sensors(sheet).record(30_000, DT, seed).added[:, 3:])


@pytest.mark.parametrize("law", [{}, {"alpha": 1.3}, {"freedom": 3.0}], ids=str)
def test_growing_noise_is_the_same_noise_times_its_growth(law):
    sensors = Sensors(**law, growth=6.0, growing=(2.0, 8.0), acceleration_bias=0.3)
    offset = replace(sensors, noise=False).record(1001, DT, 3).added
    grown, plain = (s.record(1001, DT, 3).added - offset for s in (sensors, replace(sensors, growth=1.0)))
    factor = np.ones((1001, len(CHANNELS)))
    factor[:, IMU] = growing_sigma(DT * np.arange(1001), 6.0, 2.0, 8.0)[:, None]
    np.testing.assert_allclose(grown, plain * factor, rtol=1e-9, atol=1e-12)  # the bias is added and taken off again
    assert factor[200, 0] == 1 and factor[800, 0] == 6


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
def test_a_walking_bias_has_its_density_in_each_inertial_channel_on_its_own(seed):
    sensors = Sensors(noise=False, acceleration_walk=0.02, yaw_rate_walk=0.003, acceleration_bias=0.3)
    added = sensors.record(30_001, DT, seed).added
    np.testing.assert_allclose(np.abs(added[0]), [0.3, 0.3, *8 * [0.0]])
    steps = np.diff(added[:, IMU], axis=0) / np.sqrt(DT) / [0.02, 0.02, 0.003]
    for channel in steps.T:
        assert_follows(channel, stats.norm.cdf)
    assert np.abs(np.corrcoef(steps.T) - np.eye(3)).max() < 5 / np.sqrt(30_000)  # five standard deviations
    assert not added[:, 3:].any()


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


def test_no_rate_means_no_silence():
    assert not suite("gaussian").record(10_000, DT, 0).silent[:, ABOARD].any()


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


def test_the_growing_suite_is_quiet_at_first_and_louder_than_the_loud_one_at_last():
    added = suite("growing").record(100_000, DT, 0).added
    for channel, quiet, loud, times in ((0, 0.05, 0.3, 10 / 3), (2, 0.1 * DEG, 1.0 * DEG, 2)):
        assert added[:200, channel].std() == pytest.approx(quiet, rel=0.25)  # 200 draws: five times 5 %
        assert added[800:, channel].std() == pytest.approx(times * loud, rel=0.02)  # 100 000: five times 0.2 %
    assert suite("growing").sheet == QUIET  # which is what estimators go on being told


def test_the_harsh_suite_is_loud_at_its_core_with_tails_like_a_real_cars():
    sensors = suite("harsh")
    offset = replace(sensors, noise=False).record(200_000, DT, 0).added
    for channel, sigma in ((0, LOUD.acceleration), (2, LOUD.yaw_rate)):
        noise = (sensors.record(200_000, DT, 0).added - offset)[:, channel]
        assert_follows(noise, mixture(1.75, sigma / np.sqrt(2)))
        beyond = np.abs(noise) > 3 * np.median(np.abs(noise)) / 0.6745
        assert 0.003 < beyond.mean() < 0.06  # cars measured beyond three sigmas: 0.3 to 6 %


@pytest.mark.parametrize("field", [f.name for f in fields(Sensors) if isinstance(f.default, float)])
@pytest.mark.parametrize("wrong", [-0.1, float("nan"), "much"])
def test_a_setting_that_is_no_number_or_negative_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=field):
        Sensors(**{field: wrong})


@pytest.mark.parametrize("field", [f.name for f in fields(Sensors) if type(f.default) is tuple])
@pytest.mark.parametrize("wrong", [(-0.1, 0.2), (0.3, 0.2), (0.1, float("inf")), (0.1,), 0.1, ("a", "b")])
def test_a_time_span_that_cannot_be_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=field):
        Sensors(**{field: wrong})


@pytest.mark.parametrize("field", Resolution._fields)
@pytest.mark.parametrize("wrong", [-0.1, float("nan"), float("inf")])
def test_a_resolution_that_cannot_be_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=f"resolution.{field}"):
        Sensors(resolution=Resolution(**{field: wrong}))


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"alpha": 1.5, "freedom": 3.0}, "two laws of one noise"),
        ({"freedom": 0.5}, "at least 1"),
        ({"alpha_rule": "best"}, "one of published, log_moment"),
        ({"growing": (2.0, 2.0)}, "growing takes time"),
        ({"resolution": 0.1}, "must be a Resolution"),
        ({"resolution": Resolution(acceleration=50.0)}, "acceleration_range must be positive and wider"),
        ({"yaw_rate_range": 0.0}, "yaw_rate_range must be positive"),
        ({"sheet": (0.1, 0.1, 0.1, 0.1, 0.1)}, "sheet must be a DataSheet"),
    ],
    ids=str,
)
def test_settings_that_contradict_each_other_are_refused_with_a_sentence(settings, sentence):
    with pytest.raises(ValueError, match=sentence):
        Sensors(**settings)


@pytest.mark.parametrize("field", DataSheet._fields)
@pytest.mark.parametrize("wrong", [-0.1, float("inf")])
def test_neither_sensors_nor_estimators_take_a_data_sheet_that_cannot_be(field, wrong):
    sheet = QUIET._replace(**{field: wrong})
    with pytest.raises(ValueError, match=rf"sheet\.{field} must be"):
        Sensors(sheet)
    with pytest.raises(ValueError, match=rf"sheet\.{field} must be"):
        Nominal(load("qin2014"), sheet, 20.0)


@pytest.mark.parametrize("field", DataSheet._fields)
def test_only_sensors_that_a_car_may_lack_have_no_sigma(field):
    sheet = QUIET._replace(**{field: float("nan")})
    if field in ("speed", "sideslip", "roll_rate"):
        assert Sensors(sheet).record(1, DT, 0).silent[0, CHANNELS.index(field)]
    else:
        with pytest.raises(ValueError, match=rf"sheet\.{field} must be"):
            Sensors(sheet)


def test_an_unknown_suite_is_told_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"'perfect'; known: clean, gaussian.*harsh, each also with \+optical"):
        suite("perfect")


def test_a_suite_of_ones_own_is_taken_as_it_is():
    assert suite(BIASED) is BIASED
