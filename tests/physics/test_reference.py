"""The unsteady tyre: its length constant, its steady state, a car that truly stands, and where its energy goes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vse_gym.manoeuvres.slowly_increasing_steer import steer_at_0_3g
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import CONTACT, FX, FY, MZ, RADIUS, contact, rolling_start, wheel_velocity
from vse_gym.physics.reference import DERIVATIVES, LOW_SPEED, advance_reference, unsteady_contact
from vse_gym.physics.tyres import PLATEAU, tyre_force
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.vehicles import load, names

CARS = names()
RIGID = [car for car in CARS if isinstance(load(car).body, p.RigidBody)]  # the others' energy: test_roll.py
NOTHING = np.zeros(4)
SIGMA_X, SIGMA_Y = 0.15, 0.45  # m, of a passenger car's tyre
SLIPS_X, SLIPS_Y = slice(p.LAG_X, p.LAG_X + 4), slice(p.LAG_Y, p.LAG_Y + 4)
# One car of each kind of tyre.
TYRES = {(type(load(car).front_tyre), getattr(load(car).front_tyre, "reference_load", 0.0) > 0): car for car in RIGID}
every_tyre = pytest.mark.parametrize("car", TYRES.values())


def unsteady(car):
    return load(car)._replace(relaxation_x=SIGMA_X, relaxation_y=SIGMA_Y)


ICE = p.road((0.0, 1e-8))  # where nothing changes a car's motion, or its wheels', and slips build up as anywhere


def watch(vehicle, road, state, inputs, steps, h=1e-3):
    states = [state]
    for _ in range(steps):
        states.append(advance_reference(vehicle, road, states[-1], inputs, 1, h))
    return np.array(states)


def evaluate(vehicle, road, state, steer):
    wheels = np.empty((4, CONTACT))
    contact(vehicle, road, state, steer, wheels)
    unsteady_contact(vehicle, road, state, wheels, np.empty(DERIVATIVES))
    return wheels


@every_tyre
@pytest.mark.parametrize("speed", [5.0, 20.0])
def test_slip_builds_up_over_the_relaxation_length(car, speed):
    # First order in the distance d: slip (1 - exp(-d/sigma)). The step is of the front wheels' angle, and of their
    # speed, 1 % above rolling.
    vehicle, steer = unsteady(car), 0.01
    state = rolling_start(vehicle, speed)
    state[p.WHEEL_SPEEDS] *= 1.01
    for distance in (0.1, 0.3, 1.0, 3.0):
        steps = round(distance / speed / 1e-4)
        after = advance_reference(vehicle, ICE, state, p.Inputs(steer, NOTHING, NOTHING), steps, 1e-4)
        gone = 1e-4 * steps * speed
        along = 1.01 / math.cos(steer) - 1  # of the wheel's own speed, v cos(steer)
        kappa = along * (1 - math.exp(-gone * math.cos(steer) / SIGMA_X))
        tan_alpha = math.tan(steer) * (1 - math.exp(-gone * math.cos(steer) / SIGMA_Y))
        # The ice changes the wheels' speed, and with it the slip of 1 %, by up to 5e-5 of it.
        assert after[p.LAG_X] == pytest.approx(kappa, rel=1e-4)
        assert after[p.LAG_Y] == pytest.approx(tan_alpha, rel=1e-4)
        assert after[p.LAG_Y + 2] == pytest.approx(0.0, abs=1e-6)  # the rear wheels do not steer


@every_tyre
@pytest.mark.parametrize("kappa", [-1.0, -0.3, 0.0, 0.05, 0.5])
@pytest.mark.parametrize("steer", [-0.5, 0.0, 0.02])
def test_the_steady_state_is_that_of_the_steady_tyre(car, kappa, steer):
    vehicle, road, speed = unsteady(car), p.road((0.0, 0.9)), 4.0
    assert speed * math.cos(steer) > LOW_SPEED
    state = rolling_start(vehicle, speed)
    state[p.WHEEL_SPEEDS] *= 1 + kappa
    settled = advance_reference(vehicle, ICE, state, p.Inputs(steer, NOTHING, NOTHING), 5000, 1e-3)
    fast = np.empty((4, CONTACT))
    contact(vehicle, road, settled, steer, fast)
    slow = evaluate(vehicle, road, settled, steer)
    # After 40 lengths, e^-40 is left; the ice changes wheel speeds by some 1e-5.
    forces = [FX, FY, MZ]
    np.testing.assert_allclose(slow[:, forces], fast[:, forces], rtol=1e-3, atol=1e-3 * np.abs(fast[:, forces]).max())


@every_tyre
@pytest.mark.parametrize("uphill", [1, -1])
def test_a_braked_car_truly_stands_on_a_slope(car, uphill):
    vehicle, slope = unsteady(car), math.atan(0.10)
    road = p.road((0.0, 0.9), slope=uphill * slope)
    states = watch(vehicle, road, np.zeros(p.STATE_SIZE), p.Inputs(0.0, NOTHING, np.full(4, 1500.0)), 3000)
    assert np.abs(states[-1000:, p.VX]).max() < 1e-9  # m/s: a millionth of a millimetre per second
    assert np.ptp(states[-1000:, p.X]) < 1e-9
    assert not np.any(states[:, p.WHEEL_SPEEDS])
    assert states[-1, p.AX] == pytest.approx(uphill * p.GRAVITY * math.sin(slope), rel=1e-9)
    # It hangs on four springs of Cs/sigma. They give way a little as they are loaded, by u/2 at the normalised slip u,
    # which reaches 0.2 while the car swings in.
    spring = 2 * (vehicle.front_tyre.slip_stiffness + vehicle.rear_tyre.slip_stiffness) / SIGMA_X
    sag = vehicle.mass * p.GRAVITY * math.sin(slope) / spring
    assert -uphill * states[-1, p.X] == pytest.approx(1.08 * sag, rel=0.08)


@every_tyre
@pytest.mark.parametrize("steer", [0.0, 0.1])
@pytest.mark.parametrize("torque", [200.0, 3000.0])
def test_a_car_braked_to_standstill_swings_back_once_and_stays_there(car, steer, torque):
    vehicle, road = unsteady(car), p.road((0.0, 0.9))
    inputs = p.Inputs(steer, NOTHING, np.full(4, torque))
    states = watch(vehicle, road, rolling_start(vehicle, 5.0), inputs, 5000)
    assert np.abs(states[-500:, [p.VX, p.VY, p.YAW_RATE]]).max() < 1e-6
    assert np.ptp(states[-500:, p.X]) < 1e-8
    assert not np.any(states[-500:, p.WHEEL_SPEEDS])
    # What the springs have stored throws the car back: m v^2 = F^2 sigma/C at most, F all the friction.
    most = max(getattr(vehicle.front_tyre, "peak_x", PLATEAU), PLATEAU) * 0.9 * vehicle.mass * p.GRAVITY
    spring = 2 * (vehicle.front_tyre.slip_stiffness + vehicle.rear_tyre.slip_stiffness) / SIGMA_X
    # Above the linear law's by the softening of the tyre, with which the energy stored grows to 1.5 times at most.
    assert -math.sqrt(1.5 * most**2 / spring / vehicle.mass) < states[:, p.VX].min() <= 0


@every_tyre
def test_a_car_that_slides_sideways_is_stopped_by_all_its_friction(car):
    vehicle, road = unsteady(car)._replace(height=0.0, lf=1.3, lr=1.3), p.road((0.0, 0.5))
    vehicle = vehicle._replace(rear_tyre=vehicle.front_tyre)
    start = np.zeros(p.STATE_SIZE)
    start[p.VY] = 6.0
    states = watch(vehicle, road, start, p.Inputs(0.0, NOTHING, np.full(4, 3000.0)), 4000)
    # The deflection stays at twice the friction over stiffness, where the polynomial is at its plateau.
    grip = tyre_force(vehicle.front_tyre, 0.0, -2 * 0.5 * 4000 / vehicle.front_tyre.cornering_stiffness, 4000.0, 0.5)[1]
    if isinstance(vehicle.front_tyre, p.PolynomialTyre):
        assert states[600, p.AY] == pytest.approx(-PLATEAU * 0.5 * p.GRAVITY, rel=1e-6)
    assert states[600, p.AY] == pytest.approx(grip / 4000 * p.GRAVITY, rel=0.1)
    assert np.abs(states[-100:, [p.VX, p.VY, p.YAW_RATE]]).max() < 1e-6


def kinetic_energy(vehicle, x):
    return (
        0.5 * vehicle.mass * (x[p.VX] ** 2 + x[p.VY] ** 2)
        + 0.5 * vehicle.yaw_inertia * x[p.YAW_RATE] ** 2
        + 0.5 * vehicle.wheel_inertia * np.sum(x[p.WHEEL_SPEEDS] ** 2)
    )


def tyre_power(vehicle, road, x, steer):
    """Power that the four tyres take, to rub or to keep [W]."""
    wheels, power = evaluate(vehicle, road, x, steer), 0.0
    for i in range(4):
        along, across = wheel_velocity(vehicle, i, x[p.VX], x[p.VY], x[p.YAW_RATE], steer)
        slip_velocity = wheels[i, RADIUS] * x[p.WHEEL + i] - along
        power += wheels[i, FX] * slip_velocity - wheels[i, FY] * across - wheels[i, MZ] * x[p.YAW_RATE]
    return power


@every_tyre
def test_gives_back_no_more_energy_than_its_springs_hold(car):
    # 12 deg of steer at 0.7 Hz from 80 km/h, a launch, one side braked, then all wheels locked until the car stands.
    vehicle, road, h = unsteady(car), p.road((0.0, 0.9)), 1e-3
    x = rolling_start(vehicle, 80 / 3.6)
    before, driven, taken = kinetic_energy(vehicle, x), 0.0, [0.0]
    for k in range(5000):
        time = k * h
        steer = math.radians(12) * math.sin(2 * math.pi * 0.7 * time)
        drive = np.array([400.0, 400.0, 0.0, 0.0]) if time < 1 else NOTHING
        brake = np.array([1500.0, 0.0, 400.0, 0.0]) if 1.5 < time < 2 else np.full(4, 2500.0 if time > 2.8 else 0.0)
        y = advance_reference(vehicle, road, x, p.Inputs(steer, drive, brake), 1, h)
        taken.append(taken[-1] + h / 2 * (tyre_power(vehicle, road, x, steer) + tyre_power(vehicle, road, y, steer)))
        driven += h / 2 * drive @ (x[p.WHEEL_SPEEDS] + y[p.WHEEL_SPEEDS])
        x = y
    taken = np.array(taken)
    gone = taken[-1] + x[p.BRAKE_WORK]
    assert gone > 300e3  # J: it was violent
    # The trapezium misses what is not smooth: wheels that lock, and their speed set to zero.
    assert abs(kinetic_energy(vehicle, x) - before - driven + gone) / gone < 1e-3
    most = [tyre.cornering_stiffness for tyre in (vehicle.front_tyre, vehicle.rear_tyre)]
    held = sum((1.2 * 0.9 * 0.5 * vehicle.mass * p.GRAVITY) ** 2 * SIGMA_Y / (2 * c) for c in most)
    assert np.max(np.maximum.accumulate(taken) - taken) < held


def mirror(state):
    out = state.copy()
    for k in (p.Y, p.YAW, p.VY, p.YAW_RATE, p.LOAD_AY, p.AY, p.ROLL, p.ROLL_RATE):
        out[k] = -state[k]
    others = [1, 0, 3, 2]
    out[p.WHEEL_SPEEDS], out[SLIPS_X] = state[p.WHEEL_SPEEDS][others], state[SLIPS_X][others]
    out[SLIPS_Y] = -state[SLIPS_Y][others]
    return out


@every_tyre
def test_a_mirrored_driver_gets_the_mirrored_drive(car):
    vehicle, road = unsteady(car), p.road((0.0, 0.9))
    brake = np.array([300.0, 0.0, 100.0, 50.0])
    start = rolling_start(vehicle, 20.0)
    left = advance_reference(vehicle, road, start, p.Inputs(0.05, NOTHING, brake), 1000, 1e-3)
    right = advance_reference(vehicle, road, start, p.Inputs(-0.05, NOTHING, brake[[1, 0, 3, 2]]), 1000, 1e-3)
    np.testing.assert_allclose(mirror(right), left, rtol=0, atol=1e-9 * np.abs(left).max())


def test_converges_with_order_four():
    vehicle, road = unsteady("qin2014_understeer"), p.road((0.0, 0.9))
    tyres = {axle: p.LinearTyre(*getattr(vehicle, axle)[:2]) for axle in ("front_tyre", "rear_tyre")}
    vehicle, inputs = vehicle._replace(**tyres), p.Inputs(0.05, np.array([100.0, 100.0, 0.0, 0.0]), NOTHING)
    start = rolling_start(vehicle, 20.0)
    exact = advance_reference(vehicle, road, start, inputs, 6400, 1e-4)
    errors = [
        np.abs(advance_reference(vehicle, road, start, inputs, n, 0.64 / n) - exact)[:DERIVATIVES].max()
        for n in (160, 320, 640)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4, atol=0.25)


def test_steady_tyres_leave_the_slips_of_the_state_alone():
    vehicle = load("qin2014")
    inputs = p.Inputs(0.05, NOTHING, np.full(4, 200.0))
    state = advance_reference(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, 20.0), inputs, 500, 1e-3)
    assert not np.any(state[SLIPS_X]) and not np.any(state[SLIPS_Y])


def test_a_sine_with_dwell_moves_the_car_later_by_the_relaxation_length():
    # 0.45 m at 80 km/h are 20 ms, in which the car, at the end going sideways at some 4 m/s, misses 8 cm.
    shifts = []
    for car in (load("qin2014"), unsteady("qin2014")):
        drive = scenario("sine_with_dwell", car, "clean", amplitude=5 * steer_at_0_3g(car))
        log = rollout(drive, "truth", "none", 0)
        when = np.searchsorted(log.time, drive.manoeuvre.begin + 1.07)
        shifts.append(log.truth[when, p.Y])
        sideways = (log.truth[when, p.Y] - log.truth[when - 1, p.Y]) / drive.dt
    assert shifts[0] - shifts[1] == pytest.approx(sideways * SIGMA_Y / drive.manoeuvre.speed, rel=0.5)


def test_an_unsteady_car_is_driven_by_the_integrator_that_knows_it():
    drive = scenario("straight_driving", unsteady("qin2014"))
    assert drive.integrator == "runge_kutta"
    with pytest.raises(ValueError, match=r"relaxation.*'runge_kutta', not 'semi_implicit'"):
        replace(drive, integrator="semi_implicit")
    assert scenario("straight_driving", "qin2014").integrator == "semi_implicit"
