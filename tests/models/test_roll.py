"""The double track with roll: its body against closed forms, the whole beside the plant, and who has no roll."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.inference.model import advance, attend, heed, observe, recall, remember, report
from vse_gym.models import DoubleTrackTuning, Nominal, RollTrackTuning
from vse_gym.models.roll import M_LAG
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import rolling_start
from vse_gym.physics.reference import advance_reference
from vse_gym.sensors import LOUD, Sensors, with_extras
from vse_gym.types import CHANNELS, U_BRAKE, U_STEER, Y_AX, Y_AY, Y_ROLL_RATE, Y_WHEEL, Y_YAW_RATE
from vse_gym.vehicles import load

CAR, RIGID = load("wei2019_roll"), load("qin2014_understeer")
BODY = CAR.body
SWING = BODY.sprung_mass * BODY.roll_arm
RIGHTING = BODY.roll_stiffness - SWING * p.GRAVITY
# Without grip the car yields sideways and turns under its swinging body: m A = ms e dp/dt, Iz dr/dt = Ixz dp/dt
INERTIA = BODY.roll_inertia + SWING * BODY.roll_arm - SWING**2 / CAR.mass - BODY.roll_yaw_product**2 / CAR.yaw_inertia
SHEET = with_extras(Sensors(LOUD), "roll_rate").sheet
SILENT = np.full(len(CHANNELS), np.nan)
MIRROR = np.array([1.0, -1.0, -1.0, -1.0, -1.0])
ROAD = p.road((0.0, 0.9))


def model_of(car=CAR, sheet=SHEET, speed=20.0, **tuning):
    return RollTrackTuning(**tuning).build(Nominal(car, sheet, speed=speed, friction=0.9))


def steered(angle):
    u = np.zeros(9)
    u[U_STEER] = angle
    return u


def driven(model, state, u, steps):
    """States (n, steps + 1) of the model on its own, its lagged slips along with it."""
    memory, states = model.memory, [state]
    for _ in range(steps):
        held = recall(model, memory, heed(model, u, SILENT))
        states.append(advance(model, states[-1][:, None].copy(), held)[:, 0])
        memory = remember(model, memory, states[-1], held)
    return np.array(states).T


# -- the body ---------------------------------------------------------------------------------------------------------


def test_a_steady_turn_leans_it_as_springs_and_gravity_balance():
    model = model_of()
    states = driven(model, np.array([20.0, 0, 0, 0, 0]), steered(0.01), 600)
    vx, _, r, roll_rate, roll = states[:, -1]
    assert abs(roll_rate) < 1e-4  # it is steady but for the speed that the turn costs
    assert roll == pytest.approx(SWING * vx * r / RIGHTING, rel=1e-3)
    assert roll > 0.01  # a left turn leans it right


def test_left_alone_on_ice_it_sways_as_one_degree_of_freedom():
    car = CAR._replace(front_tyre=p.LinearTyre(1e-6, 1e-6), rear_tyre=p.LinearTyre(1e-6, 1e-6))
    model, h = model_of(car), 0.01
    damping = 0.5 * BODY.roll_damping / INERTIA
    frequency = np.sqrt(RIGHTING / INERTIA - damping**2)
    states = driven(model, np.array([20.0, 0, 0, 0, 0.05]), np.zeros(9), 100)
    t = h * np.arange(101)
    exact = 0.05 * np.exp(-damping * t) * (np.cos(frequency * t) + damping / frequency * np.sin(frequency * t))
    # Heun's method errs by (w h)^3/6 a step: 0.02 % of the amplitude, some 1 % after the hundred that last as long as
    # there is anything left.
    np.testing.assert_allclose(states[4], exact, rtol=0, atol=0.01 * 0.05)
    # What the swing takes, it gives back: momentum across and about the upright axis, car and body together.
    vy, r, roll_rate = states[1], states[2], states[3]
    np.testing.assert_allclose(CAR.yaw_inertia * r, BODY.roll_yaw_product * roll_rate, rtol=0, atol=1e-9)
    assert np.abs(vy).max() > 0.01


def test_the_accelerometer_feels_gravity_where_the_body_leans():
    car = CAR._replace(front_tyre=p.LinearTyre(1e-6, 1e-6), rear_tyre=p.LinearTyre(1e-6, 1e-6))
    model = model_of(car)
    state = np.array([[20.0], [0.0], [0.0], [0.0], [0.1]])
    y = observe(model, state, heed(model, np.zeros(9), SILENT))[:, 0]
    sideways = -SWING / CAR.mass * RIGHTING * 0.1 / INERTIA
    assert y[Y_AY] == pytest.approx(sideways + p.GRAVITY * np.sin(0.1), rel=1e-6)


# -- the plant --------------------------------------------------------------------------------------------------------


def plant_drive(amplitude, seconds=3.0, speed=22.0):
    """The plant's states every 10 ms, and the steer that led to each."""
    steps = round(100 * seconds)
    steer = amplitude * np.sin(2 * np.pi * 0.7 * 0.01 * np.arange(steps))
    states = [rolling_start(CAR, speed)]
    for angle in steer:
        states.append(advance_reference(CAR, ROAD, states[-1], p.Inputs(angle, np.zeros(4), np.zeros(4)), 10, 1e-3))
    return np.array(states), steer


def of_plant(x):
    return np.array([x[p.VX], x[p.VY], x[p.YAW_RATE], x[p.ROLL_RATE], x[p.ROLL]])


def remembered(model, x):
    memory = model.memory.copy()
    memory[M_LAG : M_LAG + 8] = x[p.LAG_X : p.LAG_X + 8]
    memory[-1] = x[p.VX]
    return memory


@pytest.mark.parametrize(("amplitude", "share"), [(0.01, 0.03), (0.05, 0.1)], ids=["gentle", "at the limit"])
def test_a_step_of_it_is_a_step_of_the_plant(amplitude, share):
    # From the plant's own state and slips: what is left is one step of 10 ms against ten of 1 ms, and the load that
    # follows the acceleration late in the plant and v r at once here.
    model = model_of()
    states, steer = plant_drive(amplitude)
    error, change = [], []
    for k, angle in enumerate(steer):
        u = recall(model, remembered(model, states[k]), heed(model, steered(angle), SILENT))
        before, after = of_plant(states[k]), of_plant(states[k + 1])
        error.append(advance(model, before[:, None].copy(), u)[:, 0] - after)
        change.append(after - before)
    error, change = np.sqrt(np.mean(np.square(error), axis=0)), np.sqrt(np.mean(np.square(change), axis=0))
    assert np.all(error[1:] < share * change[1:]), error / change


def test_its_slips_lag_as_the_plants_do():
    model = model_of()
    states, steer = plant_drive(0.02)
    memory, steady, errors = remembered(model, states[0]), [], []
    for k, angle in enumerate(steer):
        u = recall(model, memory, heed(model, steered(angle), SILENT))
        memory = remember(model, memory, of_plant(states[k + 1]), u)
        prompt = remember(model, memory, of_plant(states[k + 1]), heed(model, steered(angle), SILENT))
        errors.append(memory[M_LAG + 4 : M_LAG + 8] - states[k + 1][p.LAG_Y : p.LAG_Y + 4])
        steady.append(prompt[M_LAG + 4 : M_LAG + 8] - states[k + 1][p.LAG_Y : p.LAG_Y + 4])
    # Steer that moves within the step counts from its begin in the plant too: the rest is the slip's own change.
    assert np.sqrt(np.mean(np.square(errors))) < 0.3 * np.sqrt(np.mean(np.square(steady)))


def test_readings_are_the_plants():
    model = model_of()
    states, steer = plant_drive(0.02)
    told, true = [], []
    for k in range(50, 300):
        x = states[k]
        u = recall(model, remembered(model, states[k - 1]), heed(model, steered(steer[k - 1]), SILENT))
        y = observe(model, of_plant(x)[:, None].copy(), u)[:, 0]
        told.append([y[Y_AY], y[Y_YAW_RATE], y[Y_ROLL_RATE], *y[Y_WHEEL : Y_WHEEL + 4]])
        true.append([x[p.AY], x[p.YAW_RATE], x[p.ROLL_RATE], *x[p.WHEEL_SPEEDS]])
    told, true = np.array(told), np.array(true)
    assert np.sqrt(np.mean((told - true)[:, 0] ** 2)) < 0.03 * np.sqrt(np.mean(true[:, 0] ** 2))
    np.testing.assert_array_equal(told[:, 1:3], true[:, 1:3])
    np.testing.assert_allclose(told[:, 3:], true[:, 3:], rtol=2e-3)  # wheels roll but for the turn's little slip


# -- who does not roll ------------------------------------------------------------------------------------------------


@given(st.floats(5, 40), st.floats(-3, 3), st.floats(-1, 1), st.floats(-0.2, 0.2), st.booleans())
def test_a_rigid_car_is_the_double_track(vx, vy, r, steer, braked):
    nominal = Nominal(RIGID, SHEET, speed=20.0, friction=0.9)
    model, flat = RollTrackTuning().build(nominal), DoubleTrackTuning().build(nominal)
    u, y = steered(steer), SILENT.copy()
    if braked:
        u[U_BRAKE + 1], y[Y_WHEEL + 1] = 800.0, 0.9 * vx / RIGID.wheel_radius
    state = np.array([vx, vy, r])
    mine, theirs = np.concatenate((state, [0.0, 0.0]))[:, None], state[:, None]
    remembers = recall(model, model.memory, heed(model, u, y))
    after = advance(model, mine, remembers)
    plain = advance(flat, theirs, heed(flat, u, y))
    np.testing.assert_allclose(after[:3], plain, rtol=1e-12, atol=1e-12)  # the compiler's order of sums
    np.testing.assert_array_equal(after[3:], 0.0)
    one, two = observe(model, mine, remembers)[:Y_ROLL_RATE], observe(flat, theirs, heed(flat, u, y))[:Y_ROLL_RATE]
    np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12)


def test_a_rigid_car_forgets_a_roll_that_noise_gave_it():
    states = driven(model_of(RIGID), np.array([20.0, 0, 0, 0.01, 0.001]), np.zeros(9), 50)
    assert np.abs(states[3:, -1]).max() < 1e-8


# -- either side, silence, standstill ---------------------------------------------------------------------------------


@given(
    st.floats(0, 40), st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.1, 0.1), st.floats(-0.2, 0.2),
    st.lists(st.floats(-0.1, 0.1), min_size=8, max_size=8),
)  # fmt: skip
def test_it_is_the_same_to_either_side(vx, vy, r, roll_rate, roll, steer, slips):
    model = model_of()
    memory, other = model.memory.copy(), model.memory.copy()
    memory[M_LAG : M_LAG + 8] = slips
    swapped = np.array(slips)[[1, 0, 3, 2, 5, 4, 7, 6]]
    other[M_LAG : M_LAG + 8] = swapped * np.repeat([1.0, -1.0], 4)
    state = np.array([vx, vy, r, roll_rate, roll])
    left = recall(model, memory, heed(model, steered(steer), SILENT))
    right = recall(model, other, heed(model, steered(-steer), SILENT))
    one = advance(model, state[:, None].copy(), left)[:, 0]
    two = advance(model, (MIRROR * state)[:, None].copy(), right)[:, 0]
    np.testing.assert_allclose(two, MIRROR * one, rtol=1e-12, atol=1e-12)
    mine = report(model, state, left)
    np.testing.assert_allclose(report(model, MIRROR * state, right), mine * [1, -1, -1, 1, -1], rtol=1e-12, atol=1e-12)


def test_roll_rate_is_believed_where_it_is_on_board():
    for sheet, aboard in ((SHEET, True), (LOUD, False)):
        model = model_of(sheet=sheet)
        variances, _ = attend(model, model.memory, np.zeros(9), np.zeros(len(CHANNELS)))
        assert np.isfinite(variances[Y_ROLL_RATE]) == aboard


def test_as_published_wheel_speeds_are_inputs_only():
    model, y = model_of(speedometer=False), np.zeros(len(CHANNELS))
    y[Y_WHEEL : Y_WHEEL + 4] = 20.4 / CAR.wheel_radius
    variances, memory = attend(model, model.memory, np.zeros(9), y)
    assert np.isnan(variances[Y_WHEEL : Y_WHEEL + 4]).all() and np.isfinite(variances[[Y_AX, Y_AY]]).all()
    u = recall(model, memory, heed(model, np.zeros(9), y))
    assert report(model, np.array([20.0, 0, 0, 0, 0]), u)[3] > 1  # wheels that turn faster pull


@pytest.mark.parametrize("speed", [0.0, 0.5, 3.0])
def test_a_braked_car_comes_to_rest_with_its_wheels(speed):
    model, y, u = model_of(speed=speed), np.zeros(len(CHANNELS)), np.zeros(9)
    u[U_BRAKE : U_BRAKE + 4], y[Y_AX] = 1000.0, np.nan
    memory, state = model.memory, np.array([speed, 0.1 * speed, 0.0, 0.0, 0.0])
    for _ in range(300):
        held = recall(model, memory, heed(model, u, y))
        state = advance(model, state[:, None].copy(), held)[:, 0]
        memory = remember(model, memory, state, held)
    np.testing.assert_allclose(state, 0.0, rtol=0, atol=0.02)
