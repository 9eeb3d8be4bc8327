"""The filter that finds cornering stiffnesses: known ones, on straights none, and the direct yaw moment."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.inference.gaussian import failed_downdates
from vse_gym.inference.identification import regress
from vse_gym.inference.model import advance, heed
from vse_gym.models import Nominal
from vse_gym.models.force_bicycle import Y_FRONT, Y_REAR, ForceBicycleTuning, smoothing
from vse_gym.physics import parameters as p
from vse_gym.physics.parameters import LinearTyre
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET, stream
from vse_gym.simulation import rollout
from vse_gym.types import U_BRAKE, U_DRIVE, Y_YAW_RATE, Reading
from vse_gym.vehicles import load

CAR = load("tian2018_electric")


def hear(estimator, nominal, log, forces=None):
    rng, estimates = stream(0, "estimator"), []
    state = estimator.init(nominal, rng)
    for k, (u, y) in enumerate(zip(log.inputs, log.readings, strict=True)):
        heard = y if forces is None else np.concatenate((y, forces[k]))
        state = estimator.update(state, Reading(float(log.time[k]), u, heard), rng)
        estimates.append(estimator.estimate(state))
    return estimates


LINEAR = CAR._replace(front_tyre=LinearTyre(90e3, 42e3), rear_tyre=LinearTyre(78e3, 51e3))


@pytest.fixture(scope="module")
def linear_log():
    """A car with linear tyres of stiffnesses that nobody is told."""
    return rollout(scenario("sine_steer", LINEAR, "gaussian", amplitude=0.5), "truth", "none", seed=0)


def axle_forces(log, car):
    """Of linear tyres, (T, 2): stiffness times the axle's slip angle [N]."""
    vx, vy, r = log.truth[:, p.VX], log.truth[:, p.VY], log.truth[:, p.YAW_RATE]
    slips = log.steer - np.arctan((vy + car.lf * r) / vx), np.arctan((car.lr * r - vy) / vx)
    return np.column_stack(slips) * (84e3, 102e3)


def test_it_finds_the_stiffnesses_of_linear_tyres(linear_log):
    last = hear(ESTIMATORS.make("sr_ukf_rls"), Nominal(CAR, QUIET, 80 / 3.6), linear_log)[-1]
    # From 14 % too much and 6 % too little; two wheels of an axle are not quite one wheel.
    assert last.stiffness_front == pytest.approx(84e3, rel=0.02)
    assert last.stiffness_rear == pytest.approx(102e3, rel=0.02)
    assert 0 < last.stiffness_front_std < 0.3 * 96e3  # less than at the start


def test_it_takes_a_force_sensor_where_there_is_one(linear_log):
    forces = axle_forces(linear_log, CAR) + 20 * np.random.default_rng(0).normal(size=(len(linear_log.time), 2))
    last = hear(ESTIMATORS.make("sr_ukf_rls"), Nominal(CAR, QUIET, 80 / 3.6), linear_log, forces)[-1]
    assert last.stiffness_front == pytest.approx(84e3, rel=0.02)
    assert last.stiffness_rear == pytest.approx(102e3, rel=0.02)


def test_on_straights_the_stiffnesses_stay():
    setting = scenario("straight_driving", "tian2018_electric", "loud", duration=2.0)
    log = rollout(setting, "truth", "none", seed=0)
    estimates = hear(ESTIMATORS.make("sr_ukf_rls"), setting.nominal, log)
    assert {(e.stiffness_front, e.stiffness_rear) for e in estimates} == {(96e3, 96e3)}


def test_on_a_slippery_road_adapting_is_worth_more_than_half_the_error():
    setting = scenario("sine_steer", "tian2018_electric", "gaussian", friction=0.4)
    log = rollout(setting, "truth", "none", seed=0)
    errors = []
    for adapts in (False, True):
        estimates = hear(ESTIMATORS.make("sr_ukf_rls", adapts=adapts), setting.nominal, log)
        found = np.array([e.sideslip for e in estimates])
        errors.append(np.degrees(np.sqrt(np.mean((found - log.sideslip) ** 2))))
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("side", [1, -1])
def test_the_direct_yaw_moment_turns_the_car(side):
    model = ForceBicycleTuning().build(Nominal(CAR, QUIET, 20.0))
    u, torque = np.zeros(9), 200.0
    right, left = (U_DRIVE + 1, U_DRIVE + 3), (U_DRIVE, U_DRIVE + 2)
    for driven, braked in zip(*((right, left) if side > 0 else (left, right)), strict=True):
        u[driven], u[braked] = torque, -torque
    after = advance(model, np.array([[20.0], [0.0], [0.0]]), heed(model, u, np.full(10, np.nan)))
    moment = side * 2 * torque / CAR.wheel_radius * (CAR.track_front + CAR.track_rear) / 2  # Mz = sum of -y F
    assert after[2, 0] == pytest.approx(0.01 * moment / CAR.yaw_inertia, rel=1e-9)
    assert after[0, 0] == pytest.approx(20.0)
    brakes = np.zeros(9)
    brakes[[channel - U_DRIVE + U_BRAKE for channel in (left if side > 0 else right)]] = torque
    after = advance(model, np.array([[20.0], [0.0], [0.0]]), heed(model, brakes, np.full(10, np.nan)))
    assert after[2, 0] == pytest.approx(0.5 * 0.01 * moment / CAR.yaw_inertia, rel=1e-9)


def test_a_turning_that_the_torques_explain_is_no_lateral_force():
    model = ForceBicycleTuning().build(Nominal(CAR, QUIET, 20.0))
    u, y, memory, torque = np.zeros(9), np.zeros(10), model.memory, 100.0
    u[[U_DRIVE + 1, U_DRIVE + 3]], u[[U_DRIVE, U_DRIVE + 2]] = torque, -torque
    moment = torque / CAR.wheel_radius * (CAR.track_front + CAR.track_rear)
    for k in range(60):
        y[Y_YAW_RATE] = moment / CAR.yaw_inertia * 0.01 * k
        *_, heard, memory = regress(model, np.array([20.0, 0.0, 0.0]), memory, heed(model, u, y), y)
    # The low-passes' slope is the yaw acceleration once they have settled, here for twelve times as long as needed.
    np.testing.assert_allclose(heard[[Y_FRONT, Y_REAR]], 0.0, atol=1e-6 * moment)
    for _ in range(20):  # torques that come and go at once are heard as late as the turning that they cause
        y[Y_YAW_RATE] = moment / CAR.yaw_inertia * 0.01 * 59
        *_, heard, memory = regress(model, np.array([20.0, 0.0, 0.0]), memory, heed(model, np.zeros(9), y), y)
        np.testing.assert_allclose(heard[[Y_FRONT, Y_REAR]], 0.0, atol=1e-6 * moment)


def test_the_low_passes_leave_the_noise_that_is_said():
    rng, keep, dt = np.random.default_rng(0), 0.5, 0.01
    once = twice = 0.0
    values = []
    for noise in rng.normal(size=40_000):
        once += (1 - keep) * (noise - once)
        twice += (1 - keep) * (once - twice)
        values.append(twice)
    smooth, slope = smoothing(keep, dt)
    assert np.var(values) == pytest.approx(smooth, rel=0.05)
    assert np.var(np.diff(values) / dt) == pytest.approx(slope, rel=0.05)


def test_while_locked_wheels_slide_it_neither_loses_the_speed_nor_drives_backwards():
    log = rollout(scenario("friction_jump", "tian2018_electric"), "sr_ukf_rls", "esc", seed=0)
    assert log.estimate[:, 0].min() > -0.2  # at rest, the wheels' noise
    assert np.abs(log.estimate[:, 0] - log.truth[:, p.VX]).max() < 1


def test_the_covariances_stay_positive_definite(nominal, readings):
    estimator, rng = ESTIMATORS.make("sr_ukf_rls"), stream(0, "estimator")
    state = estimator.init(nominal, rng)
    low, high = 0.1 * state.parameters, 5.0 * state.parameters
    for reading in readings:
        state = estimator.update(state, reading, rng)
        assert np.linalg.eigvalsh(state.cov)[0] > 0
        assert np.linalg.eigvalsh(state.parameter_cov)[0] > 0
        assert np.all((state.parameters >= low) & (state.parameters <= high))
    assert failed_downdates(state.kept) == 0


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"stiffness_bounds": (1.5, 2.0)}, "hold 1"),
        ({"forgetting": 0.0}, "forgetting"),
        ({"forgetting": 1.1}, "forgetting"),
        ({"stiffness_prior": 0.0}, "prior"),
        ({"stiffness_bounds": (0.1, np.inf)}, "finite"),
        ({"alpha": 0.0}, "alpha must be positive"),
        ({"beta": -1.0}, "beta not negative"),
        ({"kappa": -3.0}, "kappa larger than -3"),
    ],
)
def test_what_cannot_be_is_refused(settings, told):
    with pytest.raises(ValueError, match=told):
        ESTIMATORS.make("sr_ukf_rls", **settings)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"lag": 0.0}, "lag must be positive and finite, not 0.0"),
        ({"force_error": 0.0}, "force_error must be positive"),
        ({"vx_noise": -0.1}, "vx_noise must not be negative, not -0.1"),
        ({"least_speed": np.nan}, "least_speed must be a number, not nan"),
        ({"least_slip": 0.2}, "least_slip must be less than most_slip, 0.15, not 0.2"),
    ],
)
def test_a_model_that_cannot_be_is_refused(settings, told):
    with pytest.raises(ValueError, match=told):
        ForceBicycleTuning(**settings)
