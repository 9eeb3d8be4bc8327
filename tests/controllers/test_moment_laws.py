"""The laws from errors to a yaw moment against the theory of each, on the linear single track."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_lyapunov

from vse_gym.controllers.lqr import SPEEDS, LinearQuadraticRegulator, lateral_dynamics, regulator
from vse_gym.controllers.moment import yaw_moment
from vse_gym.controllers.phase_plane import PhasePlaneControl
from vse_gym.controllers.sliding_mode import SlidingModeControl
from vse_gym.models import Nominal
from vse_gym.sensors import QUIET
from vse_gym.types import Estimate, Reading
from vse_gym.vehicles import load

DEG = math.pi / 180
CARS = {name: load(name) for name in ("qin2014", "qin2014_understeer")}
SPEED = 80 / 3.6

every_car = pytest.mark.parametrize("car", CARS.values(), ids=CARS)
angles = st.floats(-0.5, 0.5)
rates = st.floats(-2, 2)


def told(car, friction=0.9):
    return Nominal(car, QUIET, SPEED, friction)


def moment(law, error=0.0, sideslip=0.0, rate=0.0, speed=SPEED, friction=0.9):
    return yaw_moment(law, error, sideslip, rate, speed, friction)


# -- linear-quadratic regulator -------------------------------------------------------------------------------------


def gains(law, speed):
    """On sideslip and on the yaw rate's error, as the law has them between the grid's speeds too, (1, 2)."""
    return -np.array([[moment(law, sideslip=1.0, speed=speed), moment(law, error=1.0, speed=speed)]])


def test_the_gains_of_the_published_car_at_80_kmh():
    # An earlier implementation had M = +284e3 sideslip - 50e3 (yaw rate - reference), printed to three digits.
    controller = LinearQuadraticRegulator(sideslip_band=0.0, yaw_band=0.0)
    law = controller.law(told(CARS["qin2014"]))
    # Between two speeds of the grid the straight line is off by an eighth of the curvature: 0.1 %.
    np.testing.assert_allclose(gains(law, SPEED), [[-284e3, 50e3]], rtol=3e-3)


@every_car
@pytest.mark.parametrize("speed", [4.0, 9.1, 22.2, 35.0, 60.0])  # 97.7 km/h is critical for the first car
def test_the_linear_car_is_stable_under_the_regulator_at_every_speed(car, speed):
    law = LinearQuadraticRegulator(sideslip_band=0.0, yaw_band=0.0).law(told(car))
    a, b = lateral_dynamics(car, speed)
    assert np.linalg.eigvals(a - b @ gains(law, speed)).real.max() < 0


@every_car
@pytest.mark.parametrize("speed", [8.0, SPEED, 45.0])
def test_no_other_gain_costs_less(car, speed):
    # The cost of u = -K x from x0, averaged over x0 of unit covariance, is the trace of the Lyapunov equation's P.
    a, b = lateral_dynamics(car, speed)
    q, r = np.diag([DEG**-2, (10 * DEG) ** -2]), np.array([[8e3**-2]])
    best = regulator(a, b, q, r)

    def cost(k):
        closed = a - b @ k
        return np.trace(solve_continuous_lyapunov(closed.T, -(q + k.T @ r @ k)))

    for change in ([0.02, 0.0], [-0.02, 0.0], [0.0, 0.02], [0.0, -0.02], [0.02, -0.02]):
        assert cost(best) < cost(best * (1 + np.array([change])))


@every_car
def test_gains_are_those_of_the_grid_at_its_speeds_and_held_beyond(car):
    controller = LinearQuadraticRegulator(sideslip_band=0.0, yaw_band=0.0)
    law = controller.law(told(car))
    for k in (0, 7, len(SPEEDS) - 1):
        np.testing.assert_allclose(gains(law, SPEEDS[k])[0], law.gains[k], rtol=1e-12)
    np.testing.assert_array_equal(gains(law, 1.0), gains(law, SPEEDS[0]))
    np.testing.assert_array_equal(gains(law, 90.0), gains(law, SPEEDS[-1]))


# -- sliding mode ---------------------------------------------------------------------------------------------------


@every_car
@pytest.mark.parametrize(("side", "stable"), [(1, True), (-1, False)])
def test_on_the_surface_sideslip_decays_with_its_sign_and_grows_with_the_other(car, side, stable):
    # On s = 0 with r_ref = 0 the yaw rate is xi sideslip, which leaves one equation for sideslip.
    a, _ = lateral_dynamics(car, SPEED)
    rate = a[0, 0] + a[0, 1] * side * SlidingModeControl().slope
    assert (rate < 0) == stable


def slide(car, slope, sideslip, yaw_rate, seconds=1.5):
    """Sideslip and s of the linear car under the law, from a disturbance, r_ref = 0; Euler steps of 0.5 ms."""
    controller = SlidingModeControl(slope=slope, band=0.0)
    law, h = controller.law(told(car)), 5e-4
    a, b = lateral_dynamics(car, SPEED)
    x, out = np.array([sideslip, yaw_rate]), []
    for _ in range(round(seconds / h)):
        out.append((x[0], x[1] - slope * x[0]))
        x = x + h * (a @ x + b[:, 0] * moment(law, x[1], x[0]))
    return np.array(out)


@every_car
@pytest.mark.parametrize("start", [(0.05, 0.0), (-0.02, 0.3), (0.03, -0.4)])
def test_the_surface_is_reached_and_sideslip_dies_out(car, start):
    # s^2/2 is a Lyapunov function: outside the boundary layer, of 10 deg/s, |s| falls at every step.
    sideslip, s = slide(car, SlidingModeControl().slope, *start).T
    outside = np.abs(s[:-1]) > SlidingModeControl().width
    assert outside.any()
    assert np.all(np.diff(np.abs(s))[outside] < 0)
    assert abs(sideslip[-1]) < 0.1 * max(abs(start[0]), 0.02)


def test_with_the_other_sign_sideslip_runs_away():
    sideslip, _ = slide(CARS["qin2014"], -SlidingModeControl().slope, 0.02, 0.0, seconds=2.0).T
    assert abs(sideslip[-1]) > 3 * abs(sideslip[0])


@given(angles, rates)
def test_sliding_mode_asks_for_no_more_than_its_moment(sideslip, error):
    law = SlidingModeControl().law(told(CARS["qin2014"]))
    assert abs(moment(law, error, sideslip)) <= SlidingModeControl().moment


# -- phase plane ----------------------------------------------------------------------------------------------------


@given(angles, rates, rates, st.sampled_from([(0.1, 0), (0.2, 0), (0.5, 1), (0.9, 2), (1.2, 2)]))
def test_phase_plane_lets_the_band_be_and_turns_a_car_back_from_beyond(sideslip, rate, error, at):
    control = PhasePlaneControl()
    friction, k = at  # beyond the table its ends hold
    place = control.on_sideslip[k] * sideslip + control.on_rate[k] * rate
    got = moment(control.law(told(CARS["qin2014"])), error, sideslip, rate, friction=friction)
    if abs(place) <= control.share * (1 - 1e-12):
        assert got == 0
    else:
        assert got == pytest.approx(control.gain * (abs(place) - control.share) * np.sign(place), rel=1e-9, abs=1e-9)


def test_phase_plane_takes_the_friction_of_the_estimate_else_the_nominal_one():
    # Sideslip of 9 deg lies within the band on mu 0.9 (0.35 of 0.40) and beyond it on mu 0.2 (0.59).
    control, reading = PhasePlaneControl(), Reading(0.0, np.zeros(9), np.zeros(10))
    sliding = Estimate(20.0, 20.0 * math.tan(9 * DEG), 0.1, 0.0, 2.0)  # ay = v r: sideslip stays

    def acts(nominal_friction, friction):
        nominal = told(CARS["qin2014"], nominal_friction)
        demand, _ = control.act(control.init(nominal), sliding._replace(friction=friction), reading)
        return demand.added.any()

    assert not acts(0.9, math.nan) and acts(0.2, math.nan)
    assert acts(0.9, 0.2) and not acts(0.2, 0.9)
