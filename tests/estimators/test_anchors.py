"""The ends of the scale: truth arrives exactly as the marker says, and zero sideslip believes rolling wheels only."""

import dataclasses

import numpy as np
import pytest

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.estimators.anchors import MOTION, Truth, TruthVelocity, ZeroSideslip
from vse_gym.scenarios import scenario
from vse_gym.simulation import Simulation
from vse_gym.types import Reading

STEPS = 300  # the first swerve, and braking against it


def frames_of(estimator, sensors="dropout", controller="esc"):
    """Frames of the first seconds of a drive at one seed."""
    setting = scenario("sine_with_dwell", sensors=sensors)
    simulation, law = Simulation(setting, estimator), CONTROLLERS.make(controller)
    state, frames = law.init(setting.nominal), [simulation.reset(3)]
    for _ in range(STEPS):
        demand, state = law.act(state, frames[-1].estimate, frames[-1].reading)
        frames.append(simulation.step(demand))
    return frames


@pytest.mark.parametrize("fields", [MOTION, ("vx", "vy"), ("yaw_rate",), ("ax", "ay"), ()])
def test_truth_fills_the_named_fields_exactly(fields):
    for frame in frames_of(Truth(fields)):
        for name in fields:
            assert getattr(frame.estimate, name) == getattr(frame.truth, name)


def test_what_truth_knows_has_no_variance_and_the_rest_is_unknown():
    known = frames_of(Truth())[-1].estimate.cov
    np.testing.assert_array_equal(known, np.zeros((3, 3)))
    partly = frames_of(Truth(("vx", "vy")))[-1].estimate.cov
    np.testing.assert_array_equal(partly, [[0, 0, 0], [0, 0, 0], [0, 0, np.nan]])


def test_truth_in_the_catalogue_is_the_whole_truth():
    for frame in frames_of("truth"):
        assert frame.estimate[:5] == tuple(getattr(frame.truth, name) for name in MOTION)


@pytest.mark.parametrize("steps", [1, 5, 20])
def test_truth_is_late_by_whole_steps(steps):
    frames = frames_of(Truth(delay=0.01 * steps))
    for k, frame in enumerate(frames):
        then = frames[max(0, k - steps)].truth  # before the drive nothing changed
        assert frame.estimate[:5] == tuple(getattr(then, name) for name in MOTION)


def test_the_gain_is_on_lateral_speed_alone():
    for frame in frames_of(Truth(gain=0.5)):
        assert frame.estimate.vy == 0.5 * frame.truth.vy
        for name in set(MOTION) - {"vy"}:
            assert getattr(frame.estimate, name) == getattr(frame.truth, name)


def test_the_bias_comes_after_the_gain_and_on_lateral_speed_alone():
    for frame in frames_of(Truth(gain=0.5, bias=0.5)):
        assert frame.estimate.vy == 0.5 * frame.truth.vy + 0.5
        for name in set(MOTION) - {"vy"}:
            assert getattr(frame.estimate, name) == getattr(frame.truth, name)


def test_true_velocity_takes_the_rest_from_the_last_reading_that_was_heard():
    heard, silent = dict.fromkeys(("yaw_rate", "ax", "ay"), 0.0), 0
    for frame in frames_of("truth_velocity"):
        assert (frame.estimate.vx, frame.estimate.vy) == (frame.truth.vx, frame.truth.vy)
        for name in heard:
            value = getattr(frame.reading, name)
            silent += np.isnan(value)
            heard[name] = heard[name] if np.isnan(value) else value
            assert getattr(frame.estimate, name) == heard[name]
    assert silent > 0  # else the drive shows nothing


def test_what_truth_does_not_fill_is_the_inner_estimators():
    inner = ESTIMATORS.make("ekf")
    frames = frames_of(Truth(("vy",), inner=inner))
    state, rng = inner.init(scenario("sine_with_dwell", sensors="dropout").nominal, None), None
    for frame in frames:
        state = inner.update(state, frame.reading, rng)
        alone = inner.estimate(state)
        assert frame.estimate.vy == frame.truth.vy
        for name in ("vx", "yaw_rate", "ax", "ay"):
            assert getattr(frame.estimate, name) == getattr(alone, name)
        cov = alone.cov.copy()
        cov[1, :] = cov[:, 1] = 0.0
        np.testing.assert_array_equal(frame.estimate.cov, np.where([[1, 0, 1], [0, 0, 0], [1, 0, 1]], alone.cov, 0.0))


def test_an_inner_estimator_that_is_told_the_friction_is_told_it_behind_truth_too():
    slippery = scenario("sine_with_dwell", friction=0.4)
    told, marked = (
        Simulation(slippery, estimator) for estimator in ("ekf_told", Truth(("vx",), inner=ESTIMATORS.make("ekf_told")))
    )
    told.reset(3)
    marked.reset(3)
    for _ in range(STEPS):  # no demand, so that both see the same readings
        alone, behind = told.step().estimate, marked.step().estimate
        assert behind.vy == alone.vy


@pytest.mark.parametrize("kind", [Truth, TruthVelocity])
def test_a_field_that_does_not_exist_is_refused(kind):
    with pytest.raises(ValueError, match=r"no such field of the estimate: \['sideslip'\]; known: vx, vy, yaw_rate"):
        kind(fields=("vx", "sideslip"))


@pytest.mark.parametrize("delay", [-0.01, np.nan])
def test_a_delay_that_cannot_be_is_refused(delay):
    with pytest.raises(ValueError, match="delay"):
        Truth(delay=delay)


def test_fields_may_come_as_a_list_from_a_table_of_settings():
    assert ESTIMATORS.make("truth", fields=["vx", "vy"]) == Truth(("vx", "vy"))


# -- no sideslip ------------------------------------------------------------------------------------------------------


def reading_of(speeds, radius, brake=(0.0, 0.0, 0.0, 0.0)):
    """Wheels that turn like those of a car at these speeds [m/s], under these brake torques [N m]."""
    y = np.concatenate([[0.0, 1.0, 0.1], np.array(speeds) / radius])
    return Reading(0.0, np.array([0.0, *brake, 0.0, 0.0, 0.0, 0.0]), y)


@pytest.fixture
def speed_after(nominal):
    """Speed that ZeroSideslip believes after some readings."""

    def believe(*readings):
        estimator = ZeroSideslip()
        state = estimator.init(dataclasses.replace(nominal, speed=25.0), None)
        for reading in readings:
            state = estimator.update(state, reading, None)
        return estimator.estimate(state).vx

    return believe


@pytest.fixture
def radius(nominal):
    return nominal.vehicle.wheel_radius


def test_zero_sideslip_takes_the_mean_of_the_wheels(speed_after, radius):
    assert speed_after(reading_of([19.0, 21.0, 20.0, 22.0], radius)) == pytest.approx(20.5)


def test_zero_sideslip_ignores_braking_wheels(speed_after, radius):
    braking = reading_of([5.0, 21.0, 6.0, 22.0], radius, brake=[500.0, 0.0, 300.0, 0.0])
    assert speed_after(braking) == pytest.approx(21.5)


def test_zero_sideslip_ignores_a_wheel_for_a_while_after_it_braked(speed_after, radius):
    braking = reading_of([5.0, 20.0, 20.0, 20.0], radius, brake=[500.0, 0.0, 0.0, 0.0])
    released = reading_of([5.0, 20.0, 20.0, 20.0], radius)
    assert speed_after(braking, *[released] * 9) == pytest.approx(20.0)
    assert speed_after(braking, *[released] * 11) == pytest.approx(16.25)  # 0.1 s later it counts again


def test_zero_sideslip_takes_the_fastest_while_all_brake(speed_after, radius):
    assert speed_after(reading_of([5.0, 25.2, 6.0, 12.0], radius, brake=[500.0] * 4)) == pytest.approx(25.2)


def test_zero_sideslip_takes_no_locking_wheel_for_a_speed(speed_after, radius):
    # From 25 m/s, with an accelerometer that feels nothing, speed falls by the margin of 0.3 m/s2 for 10 ms.
    slow = speed_after(reading_of([5.0, 18.0, 6.0, 12.0], radius, brake=[500.0] * 4))
    assert slow == pytest.approx(25.0 - 0.3 * 0.01)


def test_zero_sideslip_leaves_silent_wheels_out(speed_after, radius):
    assert speed_after(reading_of([np.nan, 21.0, np.nan, 22.0], radius)) == pytest.approx(21.5)
    assert speed_after(reading_of([np.nan] * 4, radius)) == 25.0  # what it was told at the start


def test_zero_sideslip_has_none_and_leaves_the_rest_to_the_sensors():
    for frame in frames_of("zero"):
        assert frame.estimate.vy == 0.0
        if np.isfinite(frame.reading.yaw_rate):
            assert frame.estimate.yaw_rate == frame.reading.yaw_rate
