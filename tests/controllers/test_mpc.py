"""Model predictive control: its prediction, its programme against other ways to solve it, and what it does in need."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import minimize

from vse_gym.controllers import mpc
from vse_gym.controllers.allocation import SMALLEST, allocate, largest_moment
from vse_gym.controllers.lqr import lateral_dynamics
from vse_gym.controllers.mpc import STAGE, ModelPredictiveControl, acting_moment, programme, shape, solve
from vse_gym.controllers.prediction import UNITS, bicycle, linearise, predict
from vse_gym.models import Nominal
from vse_gym.physics.parameters import LinearTyre
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET
from vse_gym.simulation import Simulation
from vse_gym.types import Estimate, Reading
from vse_gym.vehicles import load

CAR = load("qin2014")
SPEED = 80 / 3.6
NOMINAL = Nominal(CAR, QUIET, SPEED)
LINEAR = CAR._replace(
    front_tyre=LinearTyre(CAR.front_tyre.slip_stiffness, CAR.front_tyre.cornering_stiffness),
    rear_tyre=LinearTyre(CAR.rear_tyre.slip_stiffness, CAR.rear_tyre.cornering_stiffness),
)
NO_BOUND = 1e6
CLOSE = 2e-3  # of a moment in UNITS, 16 N m: the solver ends at residuals of 1e-4


def predicted(steps=20, start=(0.6, -0.8, 0.3), car=CAR, steer=0.0, plan=0.0, step=0.02):
    model = bicycle(Nominal(car, QUIET, SPEED), step, 0.05)
    return linearise(model, SPEED, steer, 0.9, np.array(start), np.full(steps, float(plan)))


def test_the_prediction_of_a_linear_car_is_the_matrix_exponential():
    # Sideslip and yaw rate of the linear single track, and the brakes' lag of 50 ms as a third state.
    a, b = lateral_dynamics(CAR, SPEED)
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[:2, 2] = a, b[:, 0]
    whole[2, 2], whole[2, 3] = -1 / 0.05, 1 / 0.05
    scale = np.array([*UNITS, UNITS[2]])
    exact = expm(0.01 * whole) * scale / scale[:, None]
    _, got, on_input, offset = predicted(steps=1, car=LINEAR, step=0.01)
    # Heun's error of a step is (pole h)^3/6, poles up to 20 1/s.
    np.testing.assert_allclose(np.column_stack((got[0], on_input[0])), exact[:3], atol=2e-3)
    np.testing.assert_allclose(offset, 0, atol=1e-12)


def test_the_affine_model_runs_through_the_nonlinear_trajectory_and_along_its_tangent():
    model = bicycle(NOMINAL, 0.02, 0.05)
    x, a, b, c = predicted(start=(2.0, 3.0, 0.5), steer=0.05, plan=-0.4)
    for k in range(len(c)):
        np.testing.assert_allclose(a[k] @ x[k] + b[k] * -0.4 + c[k], x[k + 1], rtol=1e-12, atol=1e-12)
        aside = predict(model, SPEED, 0.05, 0.9, *(x[k] + [0.02, -0.01, 0.03]), -0.38)
        tangent = x[k + 1] + a[k] @ [0.02, -0.01, 0.03] + b[k] * 0.02
        np.testing.assert_allclose(aside, tangent, atol=2e-3)  # the tyre bends; 3 % of the way


def test_a_mirrored_car_is_predicted_as_the_mirror_image():
    here = predicted(start=(2.0, 3.0, 0.5), steer=0.05, plan=-0.4)
    there = predicted(start=(-2.0, -3.0, -0.5), steer=-0.05, plan=0.4)
    for one, other, sign in zip(here, there, (-1, 1, 1, -1), strict=True):
        np.testing.assert_array_equal(one, sign * other)


def solved(x, a, b, c, wanted, weights, bound, most):
    """Moments of the programme, (N,)."""
    qp = programme(np.zeros(len(c)), x, a, b, c, wanted, weights[1], bound, most)
    found = solve(shape(len(c), weights), qp, np.zeros(STAGE * len(c)))
    assert found is not None
    return found[0][3::STAGE]


def test_without_bounds_the_programme_is_the_finite_horizon_regulator():
    weights = (8.0, 1.3, 1.0)
    x, a, b, c = predicted(car=LINEAR)
    q = np.diag([weights[0], weights[1], 0.0])  # bound 0: all sideslip lies beyond
    p, gain = np.zeros((3, 3)), []
    for k in reversed(range(len(c))):  # Riccati's difference equation; x[k + 1] is what costs
        s = q + p
        k_gain = b[k] @ s @ a[k] / (weights[2] + b[k] @ s @ b[k])
        p = a[k].T @ s @ a[k] - np.outer(k_gain, k_gain) * (weights[2] + b[k] @ s @ b[k])
        gain.append(k_gain)
    state, expected = x[0], []
    for k, k_gain in enumerate(reversed(gain)):
        expected.append(-k_gain @ state)
        state = a[k] @ state + b[k] * expected[-1]
    got = solved(x, a, b, c, np.zeros(len(c)), weights, 0.0, NO_BOUND)
    np.testing.assert_allclose(got, expected, atol=CLOSE)


@pytest.mark.parametrize("seed", range(5))
def test_with_bounds_the_programme_has_the_minimum_that_another_method_finds(seed):
    # Condensed to the moments alone, it is a smooth function in a box: L-BFGS-B.
    rng, steps = np.random.default_rng(seed), 6
    weights = tuple(rng.uniform(0.5, 8.0, 3))
    x, a, b, c = predicted(steps, rng.normal(0, 1.5, 3), steer=rng.normal(0, 0.03))
    wanted, bound, most = rng.normal(0, 1, steps), 0.3, 0.6

    def cost(moments):
        state, total = x[0], 0.0
        for k in range(steps):
            state = a[k] @ state + b[k] * moments[k]
            state = state + c[k]
            beyond = max(0.0, abs(state[0]) - bound)
            total += weights[0] * beyond**2 + weights[1] * (state[1] - wanted[k]) ** 2 + weights[2] * moments[k] ** 2
        return 0.5 * total

    best = minimize(cost, np.zeros(steps), method="L-BFGS-B", bounds=[(-most, most)] * steps, tol=1e-14)
    got = solved(x, a, b, c, wanted, weights, bound, most)
    assert np.abs(got).max() <= most + 1e-3
    assert cost(np.clip(got, -most, most)) == pytest.approx(best.fun, rel=1e-3)
    np.testing.assert_allclose(got, best.x, atol=0.02)  # along a flat cost


@given(st.floats(-5e3, 5e3), st.floats(-1, 1), st.floats(-0.3, 0.3))
def test_the_moment_that_acts_is_read_off_the_brakes(moment, yaw_rate, steer):
    torques = allocate(CAR.geometry, moment, 20.0, yaw_rate, steer)
    caps = np.array([3000.0, 3000.0, 1500.0, 1500.0])
    if abs(moment) > SMALLEST and np.all(torques < caps):
        assert acting_moment(CAR.geometry, torques, steer) == pytest.approx(moment, rel=1e-9)


def sliding(sideslip=0.1, yaw_rate=0.6, friction=math.nan):
    """What the controller sees of a car that oversteers in a left turn."""
    inputs = np.zeros(9)
    inputs[0] = 0.02
    estimate = Estimate(SPEED, -SPEED * math.tan(sideslip), yaw_rate, 0.0, 6.0, friction=friction)
    return estimate, Reading(0.0, inputs, np.zeros(10))


def test_the_moment_stays_within_the_brakes_and_within_the_grip_of_one_side():
    controller = ModelPredictiveControl()
    for friction in (0.9, 0.2):
        _, state = controller.act(controller.init(NOMINAL), *sliding(0.3, 1.0, friction))
        outer = 0.5 * CAR.mass * 9.81 + CAR.mass * 6.0 * CAR.height / 1.557  # load, at ay 6 m/s2, mean track 1.557 m
        grip = friction * outer * 1.557 / 2
        assert np.abs(state.plan).max() * UNITS[2] == pytest.approx(min(largest_moment(CAR.geometry), grip), rel=1e-3)


def test_a_programme_that_is_not_solved_leaves_the_last_plan_in_force_and_is_counted(monkeypatch):
    controller = ModelPredictiveControl()
    _, before = controller.act(controller.init(NOMINAL), *sliding())
    assert before.unsolved == 0
    monkeypatch.setitem(mpc.SETTINGS, "max_iter", 1)
    demand, after = controller.act(before, *sliding())
    assert after.unsolved == 1
    share = NOMINAL.dt / controller.step
    moved = before.plan[:-1] + share * np.diff(before.plan)
    np.testing.assert_array_equal(after.plan[:-1], moved)
    asked = allocate(CAR.geometry, moved[0] * UNITS[2], SPEED, 0.6, 0.02)
    np.testing.assert_array_equal(demand.added, asked)
    demand, _ = controller.act(controller.init(NOMINAL), *sliding())  # there is no plan yet
    assert not demand.added.any()


@pytest.mark.parametrize("friction", [0.9, 0.2])
def test_every_programme_of_a_violent_drive_is_solved(friction):
    drive = Simulation(scenario("sine_with_dwell", "qin2014", "loud", friction=friction), "truth_velocity")
    controller, frame = ModelPredictiveControl(), drive.reset(0)
    state = controller.init(drive.scenario.nominal)
    while not drive.done:
        demand, state = controller.act(state, frame.estimate, frame.reading)
        frame = drive.step(demand)
    assert state.unsolved == 0


def test_without_osqp_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "osqp", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'vse-gym\[control\]'"):
        ModelPredictiveControl().init(NOMINAL)


def test_a_step_that_no_number_of_control_steps_fills_is_refused():
    with pytest.raises(ValueError, match="whole number of control steps"):
        ModelPredictiveControl(step=0.025).init(NOMINAL)
