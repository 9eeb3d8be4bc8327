"""The filters of three degrees of freedom: filterpy's extended filter, and a mass that is found, or confirms itself."""

from operator import attrgetter

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from vse_gym.catalogue import ESTIMATORS
from vse_gym.evaluation.tunings import ranges
from vse_gym.inference.model import advance, heed, observe
from vse_gym.models import Nominal
from vse_gym.models.three_dof import CAR_SENSORS, U_AX, U_MASS, ThreeDofTuning
from vse_gym.sensors import QUIET, stream
from vse_gym.types import U_BRAKE, U_STEER, Y_AX, Y_AY, Y_SIDESLIP, Reading
from vse_gym.vehicles import load

TRUE_MASS = 1500.0


@pytest.fixture(scope="module")
def nominal():
    return Nominal(load("wang2017_d_class"), QUIET, speed=60 / 3.6)


@pytest.fixture(scope="module")
def model(nominal):
    return ThreeDofTuning().build(nominal)


def slalom(model, mass=TRUE_MASS, seconds=8.0):
    """A drive of the filter's own model: inputs (T, 9) and readings (T, 10) without noise."""
    times = model.car.dt * np.arange(1, round(seconds / model.car.dt) + 1)
    inputs, readings = np.zeros((times.size, 9)), np.full((times.size, 10), np.nan)
    inputs[:, U_STEER] = 0.05 * np.sin(np.pi * times)
    state = np.array([[0.0], [0.0], [60 / 3.6]])
    for k, u in enumerate(inputs):
        told = np.concatenate((u, [0.0, mass]))
        state = advance(model, state, told)
        readings[k, :7] = observe(model, state, told)[:7, 0]
        readings[k, Y_AX], readings[k, Y_SIDESLIP] = 0.0, state[1, 0]
    return inputs, readings


def hear(estimator, nominal, inputs, readings):
    rng, estimates = stream(0, "estimator"), []
    state = estimator.init(nominal, rng)
    for k, (u, y) in enumerate(zip(inputs, readings, strict=True)):
        state = estimator.update(state, Reading(nominal.dt * k, u, y), rng)
        estimates.append(estimator.estimate(state))
    return estimates


def test_a_held_steer_ends_in_the_textbooks_steady_turn(model, nominal):
    car, speed, steer = nominal.vehicle, 20.0, 0.01
    state, told = np.array([[0.0], [0.0], [speed]]), np.zeros(U_MASS + 1)
    told[U_STEER], told[U_MASS] = steer, car.mass
    for _ in range(500):
        state = advance(model, state, told)
        state[2] = speed
    r = speed * steer / (car.wheelbase + car.understeer_gradient * speed**2)
    assert state[0, 0] == pytest.approx(r, rel=1e-9)
    assert observe(model, state, told)[Y_AY, 0] == pytest.approx(speed * r, rel=1e-9)


def test_braking_one_side_turns_the_car_there(model, nominal):
    car, u = nominal.vehicle, np.zeros(9)
    u[U_BRAKE] = 330.0
    after = advance(model, np.array([[0.0], [0.0], [20.0]]), heed(model, u, np.full(10, np.nan)))
    moment = 330.0 / car.wheel_radius * car.track_front / 2
    assert after[0, 0] == pytest.approx(nominal.dt * moment / car.yaw_inertia, rel=1e-9)


def test_a_silent_accelerometer_is_what_the_torques_promise(model, nominal):
    u, y = np.zeros(9), np.full(10, np.nan)
    u[U_BRAKE : U_BRAKE + 4] = 100.0
    force = 400.0 / nominal.vehicle.wheel_radius
    assert heed(model, u, y)[U_AX] == pytest.approx(-force / nominal.vehicle.mass)
    y[Y_AX] = -1.0
    assert heed(model, u, y)[U_AX] == -1.0


class Peer(ExtendedKalmanFilter):
    """filterpy's filter on the equations as they are printed, with derivatives by hand."""

    def __init__(self, car, dt):
        super().__init__(dim_x=3, dim_z=1)
        self.car, self.dt = car, dt
        self.k1, self.k2 = -2 * car.front_tyre.cornering_stiffness, -2 * car.rear_tyre.cornering_stiffness
        self.couple, self.push = car.lf * self.k1 - car.lr * self.k2, self.k1 + self.k2
        self.twist = car.lf**2 * self.k1 + car.lr**2 * self.k2

    def predict_x(self, u):
        (r, beta, vx), (steer, ax), c = self.x, u, self.car
        dr = self.twist / (c.yaw_inertia * vx) * r + (self.couple * beta - c.lf * self.k1 * steer) / c.yaw_inertia
        across = self.couple / vx * r + self.push * beta - self.k1 * steer
        along = self.twist / (c.yaw_inertia * vx), self.couple / c.yaw_inertia
        self.F = np.eye(3) + self.dt * np.array(
            [
                [*along, -self.twist * r / (c.yaw_inertia * vx**2)],
                [
                    self.couple / (c.mass * vx**2) - 1,
                    self.push / (c.mass * vx),
                    -across / (c.mass * vx**2) - self.couple * r / (c.mass * vx**3),
                ],
                [beta * vx, r * vx, r * beta],
            ]
        )
        self.x = self.x + self.dt * np.array([dr, across / (c.mass * vx) - r, r * beta * vx + ax])

    def ay(self, x):
        return np.array([self.couple / x[2] * x[0] + self.push * x[1] - self.k1 * self.steer]) / self.car.mass

    def ay_row(self, x):
        return np.array([[self.couple / x[2], self.push, -self.couple * x[0] / x[2] ** 2]]) / self.car.mass


def test_the_plain_filter_is_filterpys_on_the_same_equations(model, nominal):
    inputs, readings = slalom(model)
    readings[:, [Y_AX, Y_AY]] += 0.1 * np.random.default_rng(1).normal(size=(len(readings), 2))
    peer = Peer(nominal.vehicle, nominal.dt)
    peer.x, peer.P = model.prior_mean.copy(), model.prior_cov.copy()
    peer.Q, peer.R = 0.1 * np.eye(3), np.array([[0.001]])
    for u, y, ours in zip(inputs, readings, hear(ESTIMATORS.make("ekf_3dof"), nominal, inputs, readings), strict=True):
        peer.steer = u[U_STEER]
        peer.predict(np.array([u[U_STEER], y[Y_AX]]))
        peer.update(np.array([y[Y_AY]]), peer.ay_row, peer.ay)
        r, beta, vx = peer.x
        # Central differences are wrong by 1e-10, which the poor observability of vx enlarges.
        np.testing.assert_allclose(ours[:3], [vx, beta * vx, r], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose([ours.cov[0, 0], ours.cov[2, 2]], [peer.P[2, 2], peer.P[0, 0]], rtol=1e-5)


IDEAL = {"mass_hears": ("yaw_rate", "sideslip"), "hears": ("yaw_rate", "wheel_speeds"), "vx_variance": 1e-3}


def test_with_the_true_sideslip_the_mass_is_right_within_its_own_standard_deviation(model, nominal):
    inputs, clean = slalom(model)
    sigma = QUIET.acceleration
    tuning = ThreeDofTuning(force_error=TRUE_MASS * sigma, **IDEAL)  # an error of ay is one of the balance, times m
    estimator = ESTIMATORS.make("rls_faekf", model=tuning, forgetting=1.0, mass_start=1000 / 1370)
    errors = []
    for seed in range(20):
        readings = clean.copy()
        readings[:, Y_AY] += sigma * np.random.default_rng(seed).normal(size=len(clean))
        last = hear(estimator, nominal, inputs, readings)[-1]
        errors.append((last.mass - TRUE_MASS) / last.mass_std)
    # Theory: the covariance of least squares. 20 draws scatter by 16 %; noise in ay itself biases by 0.4 of a sigma.
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.6


@pytest.mark.parametrize("start", [1000.0, 1900.0])
def test_a_small_process_noise_lets_the_mass_be_found_without_the_true_sideslip(model, nominal, start):
    inputs, readings = slalom(model)
    readings[:, Y_AY] += QUIET.acceleration * np.random.default_rng(5).normal(size=len(readings))
    estimator = ESTIMATORS.make("rls_faekf", model=CAR_SENSORS, mass_start=start / nominal.vehicle.mass)
    # From 33 % too little and 27 % too much. A part of what the filter believes of the mass still comes back to it.
    assert hear(estimator, nominal, inputs, readings)[-1].mass == pytest.approx(TRUE_MASS, rel=0.07)


def test_with_the_published_process_noise_the_filter_confirms_the_mass_it_started_from(model, nominal):
    inputs, readings = slalom(model)
    found = [
        hear(ESTIMATORS.make("rls_faekf", mass_start=start / nominal.vehicle.mass), nominal, inputs, readings)[-1].mass
        for start in (1000.0, 1900.0)
    ]
    assert found[1] - found[0] > 500


def test_on_straights_at_walking_pace_and_while_braking_the_mass_stays(model, nominal):
    inputs, readings = slalom(model, seconds=1.0)
    inputs[:, U_STEER] = 0.0
    readings[:, Y_AY] = 0.4
    estimator = ESTIMATORS.make("rls_faekf")
    assert {e.mass for e in hear(estimator, nominal, inputs, readings)} == {nominal.vehicle.mass}
    readings[:, Y_AY] = 3.0
    assert hear(estimator, nominal, inputs, readings)[-1].mass != nominal.vehicle.mass
    inputs[:, U_BRAKE] = 200.0
    assert {e.mass for e in hear(estimator, nominal, inputs, readings)} == {nominal.vehicle.mass}
    inputs[:, U_BRAKE] = 0.0
    slow = Nominal(nominal.vehicle, QUIET, speed=5.0)
    assert {e.mass for e in hear(estimator, slow, inputs, readings)} == {nominal.vehicle.mass}


def test_the_covariances_stay_positive_definite(nominal, readings):
    for name, settings in (("ekf_3dof", {}), ("rls_faekf", {}), ("rls_faekf", {"model": CAR_SENSORS})):
        estimator, rng = ESTIMATORS.make(name, **settings), stream(0, "estimator")
        state = estimator.init(nominal, rng)
        for reading in readings:
            state = estimator.update(state, reading, rng)
            assert np.linalg.eigvalsh(state.cov)[0] > 0
            estimate = estimator.estimate(state)
            assert np.all(np.isfinite(estimate.cov))
            assert name == "ekf_3dof" or estimate.mass_std > 0


@pytest.mark.parametrize(
    ("name", "settings", "told"),
    [
        ("rls_faekf", {"forgetting": 1.2}, "forgetting"),
        ("rls_faekf", {"mass_start": 3.0}, "mass_start"),
        ("rls_faekf", {"window": 0.0}, "window"),
        ("rls_faekf", {"window": np.inf}, "window"),
        ("rls_faekf", {"least_ay": -0.1}, "least_ay must be finite and not negative, not -0.1"),
        ("rls_faekf", {"decades": 0.0}, "decades must be positive"),
        ("rls_faekf", {"mass_bounds": (0.5, np.inf)}, "mass_bounds, positive and finite"),
        ("rls_faekf", {"adapted": ("gyro",)}, "yaw_rate"),
    ],
)
def test_what_cannot_be_is_refused(name, settings, told):
    with pytest.raises(ValueError, match=told):
        ESTIMATORS.make(name, **settings)


def test_a_sensor_that_there_is_not_is_refused_by_name():
    with pytest.raises(ValueError, match="known: ay, yaw_rate, wheel_speeds"):
        ThreeDofTuning(hears=("gyro",))


@pytest.mark.parametrize("name", ["ekf_3dof_car", "rls_faekf_car"])
def test_the_settings_for_a_car_lie_where_a_search_would_look(name):
    estimator = ESTIMATORS.make(name)
    assert estimator.model == CAR_SENSORS
    for setting, (low, high) in ranges(estimator).items():
        assert low <= attrgetter(setting)(estimator) <= high


@pytest.mark.parametrize("name", ["ay_variance", "force_error", "vx_variance", "slowest_learning"])
def test_a_negative_number_is_refused_by_name(name):
    with pytest.raises(ValueError, match=f"{name} must .*, not -1"):
        ThreeDofTuning(**{name: -1.0})
