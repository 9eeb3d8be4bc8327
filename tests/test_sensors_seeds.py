"""A seed decides everything, alike for everybody, and no kind of draw knows of another."""

from dataclasses import replace

import numpy as np
import pytest

import vse_gym.sensors
from vse_gym.scenarios import scenario
from vse_gym.sensors import FITTED, SUITES, Resolution, Sensors, stream, suite
from vse_gym.simulation import rollout

DT = 0.01
DEG = np.pi / 180
SEEDS = [0, 1, 2]
IMU = slice(0, 3)  # accelerometers and gyro
ABOARD = slice(0, FITTED)  # what every car has
every_suite = pytest.mark.parametrize("name", SUITES)


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


# What may go wrong, and what of a record it may touch.
LAWS = [{"alpha": 1.3}, {"freedom": 3.0}, {"growth": 6.0}]
OFFSETS = [
    {"acceleration_bias": 0.3, "yaw_rate_bias": 0.01},
    {"acceleration_walk": 0.02, "yaw_rate_walk": 0.01},
    {"burst_rate": 1.0},
]
FAULTS = {
    ("added",): LAWS + OFFSETS,
    ("silent",): [{"silence_rate": 0.5}],
    ("delay",): [{"delay": 0.04}],
    ("limits",): [{"acceleration_range": 20.0}],
    ("resolution", "limits"): [{"resolution": Resolution(wheel_speed=0.05)}],
}
CASES = [(touched, fault) for touched, faults in FAULTS.items() for fault in faults]
HARSH = replace(suite("harsh+optical+roll_rate"), alpha=2.0)


@pytest.mark.parametrize(("touched", "fault"), CASES, ids=lambda x: next(iter(x)))
@pytest.mark.parametrize("base", [Sensors(), HARSH], ids=["quiet", "harsh"])
def test_switching_a_fault_on_moves_nothing_else(base, touched, fault):
    one, other = base.record(2000, DT, 4), replace(base, **fault).record(2000, DT, 4)
    moved = {name for name in one._fields if not np.array_equal(getattr(one, name), getattr(other, name))}
    assert moved <= {*touched}
    assert moved or all(getattr(base, name) == value for name, value in fault.items())


@pytest.mark.parametrize("off", OFFSETS, ids=lambda x: next(iter(x)))
def test_an_offset_is_the_same_whatever_else_is_wrong(off):
    everything = {k: v for fault in OFFSETS for k, v in fault.items()}
    without = {k: v for k, v in everything.items() if k not in off}
    alone = Sensors(noise=False, **off).record(2000, DT, 4).added
    full, less = (Sensors(growth=2.0, **settings).record(2000, DT, 4).added for settings in (everything, without))
    np.testing.assert_allclose(full - less, alone, atol=1e-12)  # sums of numbers up to 10, in another order
    assert alone.any()


@pytest.mark.parametrize("law", [{"alpha": 1.3}, {"alpha": 2.0, "freedom": 3.0}], ids=lambda x: list(x)[-1])
def test_no_stream_serves_twice(law, monkeypatch):
    made = []

    def spy(seed, name):
        made.append(name)
        return stream(seed, name)

    monkeypatch.setattr(vse_gym.sensors, "stream", spy)
    replace(HARSH, burst_rate=1.0, **law).record(10, DT, 0)
    assert len(set(made)) == len(made) >= 12  # noise, inputs, two of silence, four kinds twice


@pytest.mark.parametrize("name", ["harsh", "cauchy_gaussian", "outliers", "dropout"])
def test_extra_sensors_aboard_do_not_move_the_others(name):
    bare, full = (suite(name + extras).record(2000, DT, 4) for extras in ("", "+optical+roll_rate"))
    np.testing.assert_array_equal(bare.added[:, ABOARD], full.added[:, ABOARD])
    np.testing.assert_array_equal(bare.silent[:, ABOARD], full.silent[:, ABOARD])
    np.testing.assert_array_equal(bare.brake, full.brake)
    one = suite(name + "+optical").record(2000, DT, 4)
    np.testing.assert_array_equal(one.added[:, :9], full.added[:, :9])


@pytest.mark.parametrize("name", ["growing", "late", "harsh+optical"])
def test_where_nobody_acts_on_an_estimate_every_estimator_has_the_same_readings(name):
    cell = scenario("sine_with_dwell", sensors=name, duration=2.0)
    one, other = (rollout(cell, estimator, "none", 1) for estimator in ("truth", "ekf"))
    np.testing.assert_array_equal(one.readings, other.readings)
    np.testing.assert_array_equal(one.inputs, other.inputs)


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
