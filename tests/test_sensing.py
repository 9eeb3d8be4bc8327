"""From the truth to a reading: delay, noise, range, resolution, silence."""

import copy
import hashlib
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.sensing import STANDING, read_sensors, unread_sensors
from vse_gym.sensors import FITTED, Resolution, Sensors, suite
from vse_gym.simulation import Simulation, rollout
from vse_gym.types import CHANNELS, WHEELS, Y_SIDESLIP, Y_SPEED

DT = 0.01
DEG = np.pi / 180
SEEDS = [0, 1, 2]
ABOARD = slice(0, FITTED)  # what every car has
LATE = [0, 1, 2, 7, 8, 9]  # what comes over the bus
REST = p.Inputs(0.0, np.zeros(4), np.zeros(4))
FINE = Resolution(0.0359, 0.244 * DEG, 0.05, 0.1 * DEG, 0.02, 0.1 * DEG, 0.2 * DEG)
STEPS = np.array([FINE[0], FINE[0], FINE[1], *4 * [FINE[2]], *FINE[4:]])  # of each channel


def readings(record, states, inputs=REST):
    """All readings of a record, (steps, 9) and (steps, 10), and what was last heard; of one state or of one a step."""
    states = np.broadcast_to(states, (len(record.added), p.STATE_SIZE)).copy()
    memory, rows = unread_sensors(record.delay, states[0]), []
    for step, state in enumerate(states):
        u, y, memory = read_sensors(record, step, state, inputs, memory)
        rows.append((u, y, memory[0]))
    return tuple(map(np.array, zip(*rows, strict=True)))


def true_values(states):
    """What perfect sensors would read, (..., 10)."""
    vx, vy = states[..., p.VX], states[..., p.VY]
    inertial = states[..., [p.AX, p.AY, p.YAW_RATE]]
    motion = (np.hypot(vx, vy), np.arctan2(vy, vx), states[..., p.ROLL_RATE])
    return np.concatenate((inertial, states[..., p.WHEEL_SPEEDS], np.stack(motion, axis=-1)), axis=-1)


STATE = 0.1 * np.arange(1.0, p.STATE_SIZE + 1)  # within every range
TRUE_Y = true_values(STATE)
EVERYTHING = "clean+optical+roll_rate"


def some_drive(steps, seed):
    """States of a car that moves at random, above walking pace and within every range."""
    return np.random.default_rng(seed).uniform(1.0, 2.0, (steps, p.STATE_SIZE))


@pytest.mark.parametrize("seed", SEEDS)
def test_readings_stop_at_the_sensors_range(seed):
    sensors = replace(suite("cauchy_gaussian"), acceleration_range=3.0, yaw_rate_range=0.2)
    _, y, _ = readings(sensors.record(2000, DT, seed), np.zeros(p.STATE_SIZE))
    for channel, limit in enumerate((3.0, 3.0, 0.2)):
        assert y[:, channel].max() == limit
        assert y[:, channel].min() == -limit


@pytest.mark.parametrize("extras", ["", "+optical+roll_rate"])
def test_clean_readings_are_the_truth(extras):
    inputs = p.Inputs(0.03, np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0]))
    u, y, heard = readings(suite("clean" + extras).record(50, DT, 0), STATE, inputs)
    there = slice(0, 10 if extras else FITTED)
    np.testing.assert_allclose(y[:, there], np.tile(TRUE_Y[there], (50, 1)), rtol=1e-15)  # two libraries' square root
    assert np.isnan(y[:, there.stop :]).all() and not heard[:, there.stop :].any()
    np.testing.assert_array_equal(heard[:, there], y[:, there])
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
    spoken = np.where(record.silent, 0.0, TRUE_Y + record.added)
    last = np.maximum.accumulate(np.where(record.silent, -1, np.arange(3000)[:, None]), axis=0)
    expected = np.where(last < 0, unread_sensors(0, STATE)[0], np.take_along_axis(spoken, np.maximum(last, 0), axis=0))
    np.testing.assert_array_equal(heard, expected)


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_before_its_first_reading_no_wheel_is_taken_for_locked(delay):
    memory = unread_sensors(delay, STATE)
    np.testing.assert_array_equal(memory[0, WHEELS], STATE[p.WHEEL_SPEEDS])
    assert not memory[0, LATE].any()
    np.testing.assert_array_equal(memory[1:], np.tile(TRUE_Y, (delay, 1)))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("delay", "dt", "steps"), [(0.0, 0.01, 0), (0.01, 0.01, 1), (0.04, 0.01, 4), (0.04, 0.02, 2)])
def test_a_late_sensor_reads_the_old_truth_and_the_start_until_there_is_one(delay, dt, steps, seed):
    states = some_drive(50, seed)
    _, y, _ = readings(replace(suite(EVERYTHING), delay=delay).record(50, dt, seed), states)
    true = true_values(states)
    then = np.maximum(np.arange(50) - steps, 0)
    np.testing.assert_allclose(y[:, LATE], true[then][:, LATE], rtol=1e-15)
    np.testing.assert_array_equal(y[:, WHEELS], true[:, WHEELS])  # the brake unit reads them itself


@pytest.mark.parametrize("seed", SEEDS)
def test_a_late_reading_has_the_noise_and_the_silences_of_its_own_instant(seed):
    states, sensors = some_drive(500, seed), Sensors(silence_rate=1.0, acceleration_bias=0.3)
    prompt, late = sensors.record(500, DT, seed), replace(sensors, delay=0.04).record(500, DT, seed)
    true, then = true_values(states), np.maximum(np.arange(500) - 4, 0)
    _, y, _ = readings(late, states)
    expected = np.where(prompt.silent, np.nan, true[then] + prompt.added)
    np.testing.assert_allclose(y[:, :3], expected[:, :3], rtol=1e-15)
    np.testing.assert_array_equal(np.isnan(y), prompt.silent)


def test_inputs_are_prompt():
    inputs = p.Inputs(0.03, np.full(4, 100.0), np.full(4, 900.0))
    prompt, late = (readings(suite(name).record(20, DT, 1), STATE, inputs)[0] for name in ("gaussian", "late"))
    np.testing.assert_array_equal(prompt, late)


def test_in_a_drive_a_late_suite_reads_what_was_forty_milliseconds_ago():
    log = rollout(scenario("held_steer", sensors=Sensors(noise=False, delay=0.04), duration=1.0), "zero", "none", 0)
    true = true_values(log.truth)
    np.testing.assert_array_equal(log.readings[4:, :3], true[:-4, :3])
    np.testing.assert_array_equal(log.readings[:4, :3], np.tile(true[0, :3], (4, 1)))
    np.testing.assert_array_equal(log.readings[:, WHEELS], true[:, WHEELS])
    assert np.abs(np.diff(true[:, 1])).max() > 0  # else late and prompt would look alike


@pytest.mark.parametrize("seed", SEEDS)
def test_a_reading_is_the_multiple_of_its_resolution_nearest_to_the_exact_one(seed):
    exact, coarse = suite("loud+optical+roll_rate"), replace(suite("loud+optical+roll_rate"), resolution=FINE)
    states = some_drive(3000, seed)
    (u, y, _), (v, z, _) = (readings(sensors.record(3000, DT, seed), states) for sensors in (exact, coarse))
    for fine, rounded, step in ((y, z, STEPS), (u[:, 0], v[:, 0], FINE.steer)):
        np.testing.assert_allclose(rounded / step, np.rint(fine / step), rtol=1e-12)
    np.testing.assert_array_equal(u[:, 1:], v[:, 1:])
    # Where the noise is wider than the step the error is uniform (Widrow 1956): of these, accelerometer and wheels.
    for channel in (0, 1, 3, 4, 5, 6):
        error = (z - y)[:, channel] / STEPS[channel]
        assert stats.kstest(error, stats.uniform(-0.5, 1).cdf).statistic < 1.95 / np.sqrt(3000)  # at the 0.1 % level


def test_a_rounded_reading_stays_within_the_range():
    sensors = replace(suite("cauchy_gaussian+roll_rate"), resolution=Resolution(0.3, 0.7 * DEG, roll_rate=0.7 * DEG))
    _, y, _ = readings(sensors.record(3000, DT, 0), np.zeros(p.STATE_SIZE))
    # 66 steps of 0.3 m/s2 fit into 20 m/s2, and 142 of 0.7 deg/s into 100 deg/s
    for channel, limit in ((0, 66 * 0.3), (1, 66 * 0.3), (2, 142 * 0.7 * DEG)):
        np.testing.assert_allclose([y[:, channel].max(), y[:, channel].min()], [limit, -limit], rtol=1e-12)
    assert np.abs(y[:, 9]).max() <= 100 * DEG


def test_a_range_of_whole_steps_is_used_to_its_end():
    record = Sensors(acceleration_range=20.0, resolution=Resolution(acceleration=0.1)).record(1, DT, 0)
    assert record.limits[0] == pytest.approx(20.0, rel=1e-12)


def test_an_optical_sensor_gives_no_angle_of_a_car_that_stands():
    states = np.zeros((4, p.STATE_SIZE))
    states[:, p.VX] = 2 * STANDING, 1.01 * STANDING, 0.99 * STANDING, -0.1
    _, y, heard = readings(suite("clean+optical").record(4, DT, 0), states)
    np.testing.assert_array_equal(np.isnan(y[:, Y_SIDESLIP]), [False, False, True, True])
    np.testing.assert_array_equal(y[:, Y_SPEED], np.abs(states[:, p.VX]))
    assert not heard[:, Y_SIDESLIP].any()


def test_nothing_that_was_handed_over_is_edited():
    record, memory = suite("late").record(3, DT, 0), unread_sensors(4, STATE)
    before = memory.copy()
    _, _, after = read_sensors(record, 0, STATE, REST, memory)
    np.testing.assert_array_equal(memory, before)
    assert not np.shares_memory(memory, after)
    assert after.shape == (5, len(CHANNELS))


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("gaussian", "c8974a033e4edf0b"),
        ("cauchy_gaussian", "be1317dba2c7113b"),
        ("outliers", "3d627a4760e890b3"),
    ],
)
def test_published_suites_read_what_they_always_read(name, digest):
    # Frozen: a change here moves every published result.
    u, y, _ = readings(suite(name).record(600, DT, 1), STATE, p.Inputs(0.03, np.full(4, 100.0), np.full(4, 900.0)))
    rounded = np.round(np.column_stack((u, y[:, ABOARD])), 9) + 0.0  # 9 digits: libm's last bit may differ by platform
    assert hashlib.blake2b(rounded.tobytes(), digest_size=8).hexdigest() == digest


def test_a_copy_made_in_mid_drive_hears_the_same_late_readings():
    drive = Simulation(scenario("held_steer", sensors="harsh+optical", duration=1.0), "zero")
    drive.reset(2)
    for _ in range(40):
        drive.step()
    twin = copy.deepcopy(drive)
    for _ in range(20):
        np.testing.assert_array_equal(drive.step().reading.y, twin.step().reading.y)
