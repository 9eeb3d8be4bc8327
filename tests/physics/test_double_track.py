"""The plant against linear theory, conservation of energy, symmetry, and what a standing car does."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    CONTACT,
    COS,
    FX,
    FY,
    LOAD,
    MZ,
    SIN,
    SPEED_FLOOR,
    advance,
    advance_reference,
    contact,
    road_friction,
    rolling_start,
    wheel_load,
    wheel_position,
    wheel_velocity,
)
from vse_gym.physics.tyres import PLATEAU
from vse_gym.vehicles import load, names

CARS = names()
INTEGRATORS = [advance, advance_reference]
NOTHING = np.zeros(4)
MIRRORED = [1, 0, 3, 2]  # wheel order: front left, front right, rear left, rear right
KMH = 1 / 3.6

every_car = pytest.mark.parametrize("car", CARS)
every_integrator = pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda f: f.__name__)


def with_linear_tyres(vehicle):
    front, rear = (
        p.LinearTyre(t.slip_stiffness, t.cornering_stiffness) for t in (vehicle.front_tyre, vehicle.rear_tyre)
    )
    return vehicle._replace(front_tyre=front, rear_tyre=rear)


def effective_mass(vehicle):
    """Mass and the four wheels' inertia, as rolling feels them [kg]."""
    return vehicle.mass + 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2


def evaluate(vehicle, road, state, steer=0.0):
    wheels = np.empty((4, CONTACT))
    contact(vehicle, road, state, steer, wheels)
    return wheels


def coast(vehicle, road, state, seconds, steer=0.0, drive=NOTHING, brake=NOTHING):
    return advance(vehicle, road, state, p.Inputs(steer, drive, brake), round(1000 * seconds), 1e-3)


def watch(vehicle, road, state, inputs, steps):
    """The states of a drive under constant inputs, one a millisecond, (steps + 1, STATE_SIZE)."""
    states = [state]
    for _ in range(steps):
        states.append(advance(vehicle, road, states[-1], inputs, 1, 1e-3))
    return np.array(states)


def fast_but_stable(vehicle):
    """80 km/h, or half the speed at which the car becomes unstable [m/s]."""
    return min(80 * KMH, 0.5 * vehicle.critical_speed)


def yaw_gain_error(vehicle, speed):
    """Yaw rate in a steady turn of 0.2 m/s2, relative to the linear single track r = v steer/(l + K v^2), less one."""

    def gain(v):
        return v / (vehicle.wheelbase + vehicle.understeer_gradient * v**2)

    steer = 0.2 / speed / gain(speed)
    state = coast(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, speed), 8.0, steer)
    return state[p.YAW_RATE] / (steer * gain(state[p.VX])) - 1  # at the speed that is left: cornering drags a little


@pytest.mark.parametrize(("car", "speed"), [("qin2014_understeer", 80), ("qin2014", 30)])
def test_turns_as_the_linear_single_track_does(car, speed):
    # The tyre softens by 0.0668 of the normalised slip, 0.2/(0.9 g) = 0.023 here: by 0.15 %. What of it does not
    # cancel between the axles is 0.035 % of the gain at the first, 0.016 % at the second.
    assert abs(yaw_gain_error(load(car), speed * KMH)) < 5e-4


@every_car
def test_turns_as_the_linear_single_track_does_with_linear_tyres(car):
    # Left are cosines of angles below 0.02 rad, the car's width, and a speed that falls while the car settles.
    vehicle = with_linear_tyres(load(car))
    assert abs(yaw_gain_error(vehicle, fast_but_stable(vehicle))) < 5e-5


@every_car
def test_answers_a_small_step_of_steer_as_the_linear_single_track_does(car):
    vehicle = with_linear_tyres(load(car))
    v, steer, (m, inertia, a, b) = fast_but_stable(vehicle), 1e-3, vehicle[:4]
    # Turning the car also spins the outer wheels up and the inner ones down, which adds 1 % to its inertia.
    squares = 2 * (vehicle.track_front / 2) ** 2 + 2 * (vehicle.track_rear / 2) ** 2
    inertia += vehicle.wheel_inertia / vehicle.wheel_radius**2 * squares
    front, rear = 2 * vehicle.front_tyre.cornering_stiffness, 2 * vehicle.rear_tyre.cornering_stiffness
    of_vy_and_yaw_rate = np.array(
        [
            [-(front + rear) / (m * v), (b * rear - a * front) / (m * v) - v],
            [(b * rear - a * front) / (inertia * v), -(a**2 * front + b**2 * rear) / (inertia * v)],
        ]
    )
    settled = np.linalg.solve(of_vy_and_yaw_rate, [-front * steer / m, -a * front * steer / inertia])
    for seconds in (0.05, 0.1, 0.2, 0.5, 1.0):
        linear = settled - expm(of_vy_and_yaw_rate * seconds) @ settled
        state = advance_reference(
            vehicle,
            p.road((0.0, 0.9)),
            rolling_start(vehicle, v),
            p.Inputs(steer, NOTHING, NOTHING),
            int(1e4 * seconds),
            1e-4,
        )
        # Left are the cosine of 1 mrad, and wheels that follow the car some 2 ms late.
        np.testing.assert_allclose(state[[p.VY, p.YAW_RATE]], linear, rtol=0, atol=1e-4 * np.abs(settled).max())


def kinetic_energy(vehicle, x):
    translation = 0.5 * vehicle.mass * (x[p.VX] ** 2 + x[p.VY] ** 2)
    return (
        translation
        + 0.5 * vehicle.yaw_inertia * x[p.YAW_RATE] ** 2
        + 0.5 * vehicle.wheel_inertia * np.sum(x[p.WHEEL_SPEEDS] ** 2)
    )


def tyre_power(vehicle, road, x, steer):
    """What the four contacts turn into heat: force times the velocity at which the tread slides [W]."""
    wheels, power = evaluate(vehicle, road, x, steer), 0.0
    for i in range(4):
        along, across = wheel_velocity(vehicle, i, x[p.VX], x[p.VY], x[p.YAW_RATE], steer)
        slip_velocity = vehicle.wheel_radius * x[p.WHEEL + i] - along
        power += wheels[i, FX] * slip_velocity - wheels[i, FY] * across - wheels[i, MZ] * x[p.YAW_RATE]
    return power


def violent(k):
    """Inputs of the k-th 10 ms: 12 deg of steer at 0.7 Hz, a launch, one side braked, then all wheels locked."""
    time = 0.01 * k
    steer = math.radians(12) * math.sin(2 * math.pi * 0.7 * time)
    drive = np.array([400.0, 400.0, 0.0, 0.0]) if time < 1 else NOTHING
    if 1.5 < time < 2:
        return p.Inputs(steer, drive, np.array([1500.0, 0.0, 400.0, 0.0]))
    if 2.8 < time < 3.2:
        return p.Inputs(steer, drive, np.array([2500.0, 2500.0, 1200.0, 1200.0]))
    return p.Inputs(steer, drive, NOTHING)


@cache
def energy_imbalance(car, integrator, per_control_step):
    """Change of kinetic energy less what came in and went out in 4 violent seconds, over what went out [-]."""
    vehicle, road, h = load(car), p.road((0.0, 0.9)), 0.01 / per_control_step
    x = rolling_start(vehicle, 80 * KMH)
    before, driven, rubbed = kinetic_energy(vehicle, x), 0.0, 0.0
    for k in range(400):
        inputs = violent(k)
        for _ in range(per_control_step):
            y = integrator(vehicle, road, x, inputs, 1, h)
            rubbed += h / 2 * (tyre_power(vehicle, road, x, inputs.steer) + tyre_power(vehicle, road, y, inputs.steer))
            driven += h / 2 * inputs.drive @ (x[p.WHEEL_SPEEDS] + y[p.WHEEL_SPEEDS])
            x = y
    gone = rubbed + x[p.BRAKE_WORK]
    assert rubbed > 50e3  # J: it was violent
    assert x[p.BRAKE_WORK] > 20e3
    return (kinetic_energy(vehicle, x) - before - driven + gone) / gone


@every_car
def test_keeps_account_of_energy(car):
    # All is smooth but where a wheel locks or lets go: there the trapezium errs by half a step of the jump in power,
    # 0.5 ms of some 20 kW, of 200 kJ: 5e-5.
    assert abs(energy_imbalance(car, advance_reference, 10)) < 1e-4


@every_car
def test_the_semi_implicit_step_loses_energy_in_proportion_to_its_length(car):
    # First order: the force at the end of a step acts on the mean of two speeds, wrong by h dF/2 or 1e-3 at 1 ms.
    coarse, fine = energy_imbalance(car, advance, 10), energy_imbalance(car, advance, 20)
    assert abs(coarse) < 2e-3
    assert 1.7 < coarse / fine < 2.3


def mirror(state):
    """The same car in a mirror."""
    out = state.copy()
    for k in (p.Y, p.YAW, p.VY, p.YAW_RATE, p.LOAD_AY, p.AY):
        out[k] = -state[k]
    out[p.WHEEL_SPEEDS] = state[p.WHEEL_SPEEDS][MIRRORED]
    return out


@every_car
@every_integrator
def test_a_mirrored_driver_gets_the_mirrored_drive(car, integrator):
    vehicle, road = load(car), p.road((0.0, 0.9))
    left = right = rolling_start(vehicle, 80 * KMH)
    for k in range(400):
        steer, drive, brake = violent(k)
        left = integrator(vehicle, road, left, p.Inputs(steer, drive, brake), 10, 1e-3)
        right = integrator(vehicle, road, right, p.Inputs(-steer, drive[MIRRORED], brake[MIRRORED]), 10, 1e-3)
        # Sums over wheels run in another order: rounding of 1e-16 a step, carried on for 4000 steps.
        np.testing.assert_allclose(mirror(right), left, rtol=0, atol=1e-9 * max(1.0, np.abs(left).max()))


@every_car
@every_integrator
def test_a_split_road_seen_in_a_mirror_has_its_sides_exchanged(car, integrator):
    vehicle, here = load(car), p.road((0.0, 0.9))
    split = here._replace(friction_right=np.array([0.4]))
    swapped = here._replace(friction_left=np.array([0.4]))
    brake, start = np.full(4, 400.0), rolling_start(vehicle, 20.0)
    one = integrator(vehicle, split, start, p.Inputs(0.02, NOTHING, brake), 500, 1e-3)
    other = integrator(vehicle, swapped, start, p.Inputs(-0.02, NOTHING, brake), 500, 1e-3)
    np.testing.assert_allclose(mirror(other), one, rtol=0, atol=1e-9 * np.abs(one).max())


@every_car
@pytest.mark.parametrize(("integrator", "order"), [(advance, 1), (advance_reference, 4)], ids=["advance", "reference"])
def test_converges_with_its_order(car, integrator, order):
    # With linear tyres and constant inputs everything is smooth. Below 0.5 ms the reference's error is rounding.
    vehicle, road = with_linear_tyres(load(car)), p.road((0.0, 0.9))
    start, inputs = rolling_start(vehicle, 20.0), p.Inputs(0.08, np.array([100.0, 100.0, 0.0, 0.0]), NOTHING)
    exact = advance_reference(vehicle, road, start, inputs, 6400, 1e-4)
    motion = [p.VX, p.VY, p.YAW_RATE]
    errors = []
    for steps in (160, 320, 640):  # 4, 2 and 1 ms; the wheels' pole of -540 1/s makes Runge-Kutta unstable above 5 ms
        errors.append(np.abs(integrator(vehicle, road, start, inputs, steps, 0.64 / steps) - exact)[motion].max())
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(observed, order, atol=0.25)  # the next term of the error is some per cent of the first


@every_car
def test_the_default_step_follows_the_reference_at_the_limit(car):
    # 100 deg of hand wheel brings either car to its limit; above, a drive without control ends in a spin, where
    # small differences grow. 1 to 2 deg/s is what first order costs at 1 ms.
    vehicle, road = load(car), p.road((0.0, 0.9))
    coarse = fine = rolling_start(vehicle, 80 * KMH)
    largest, grip = 0.0, 0.0
    for k in range(300):
        since = 0.01 * k if 0.01 * k < 0.75 / 0.7 else max(0.75 / 0.7, 0.01 * k - 0.5)
        angle = math.radians(100) / vehicle.steering_ratio * math.sin(2 * math.pi * 0.7 * since) * (since < 1 / 0.7)
        inputs = p.Inputs(angle, NOTHING, NOTHING)
        coarse = advance(vehicle, road, coarse, inputs, 10, 1e-3)
        fine = advance_reference(vehicle, road, fine, inputs, 100, 1e-4)
        largest = max(largest, abs(coarse[p.YAW_RATE] - fine[p.YAW_RATE]))
        grip = max(grip, abs(fine[p.AY]))
    assert math.degrees(largest) < 2
    assert grip > 0.8 * 0.9 * p.GRAVITY  # it was the limit


def test_wheels_stand_front_left_front_right_rear_left_rear_right():
    vehicle = load("qin2014")
    signs = [tuple(np.sign(wheel_position(vehicle, i))) for i in range(4)]
    assert signs == [(1, 1), (1, -1), (-1, 1), (-1, -1)]


@settings(deadline=None)  # the first example may have to compile a kernel
@given(st.floats(-12, 12), st.floats(-20, 20), st.sampled_from(CARS))
def test_wheels_never_pull_on_the_road_and_carry_the_car(ax, ay, car):
    vehicle = load(car)
    loads = np.array([wheel_load(vehicle, i, ax, ay, p.GRAVITY) for i in range(4)])
    assert np.all(loads >= 0)
    if np.all(loads > 0):
        x, y = np.array([wheel_position(vehicle, i) for i in range(4)]).T
        weight = vehicle.mass * p.GRAVITY
        # Newton and Euler: the loads carry the weight and balance the moments of the forces at the road.
        assert loads.sum() == pytest.approx(weight, rel=1e-12)
        assert loads @ x == pytest.approx(-vehicle.mass * ax * vehicle.height, abs=1e-9 * weight)
        assert loads @ y == pytest.approx(-vehicle.mass * ay * vehicle.height, abs=1e-9 * weight)


@every_car
def test_the_front_axle_takes_its_share_of_the_lateral_transfer(car):
    vehicle = load(car)
    still, turning = (np.array([wheel_load(vehicle, i, 0.0, ay, p.GRAVITY) for i in range(4)]) for ay in (0.0, 2.0))
    moments = (turning - still)[1::2] * [vehicle.track_front, vehicle.track_rear]  # right wheels of each axle
    assert moments[0] / moments.sum() == pytest.approx(vehicle.front_transfer, rel=1e-9)


@settings(deadline=None)  # the first example may have to compile a kernel
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_wheels_press_with_the_weight_across_the_road(slope, bank):
    vehicle = load("qin2014")
    wheels = evaluate(vehicle, p.road((0.0, 0.9), slope=slope, bank=bank), rolling_start(vehicle, 10.0))
    weight = vehicle.mass * p.GRAVITY * math.cos(slope) * math.cos(bank)
    assert wheels[:, LOAD].sum() == pytest.approx(weight, rel=1e-12)


@every_car
def test_a_braked_car_creeps_down_a_slope_without_chatter(car):
    # At rest slip is taken relative to v0 = 0.5 m/s: four tyres of slip stiffness Cs are dampers of 4 Cs/v0, which the
    # weight along the slope pulls at m g sin. The tyre softens by 0.0668 u + 0.1032 u^2, u = sin/mu = 0.11: 0.9 %.
    vehicle, slope = load(car), math.atan(0.10)
    damping = 2 * (vehicle.front_tyre.slip_stiffness + vehicle.rear_tyre.slip_stiffness) / SPEED_FLOOR
    creep = vehicle.mass * p.GRAVITY * math.sin(slope) / damping
    for uphill in (1, -1):
        road = p.road((0.0, 0.9), slope=uphill * slope)
        inputs = p.Inputs(0.0, NOTHING, np.full(4, 1500.0))
        states = watch(vehicle, road, np.zeros(p.STATE_SIZE), inputs, 2000)
        speed = -uphill * states[:, p.VX]
        assert speed[-1] == pytest.approx(creep, rel=0.015)
        assert np.all(np.diff(speed) > -1e-8)  # the load transfer settles and moves it by some nm/s
        assert np.ptp(speed[1000:]) < 1e-9
        assert not np.any(states[:, p.WHEEL_SPEEDS])
        # An accelerometer feels the tyres that hold the car, not gravity.
        assert states[-1, p.AX] == pytest.approx(uphill * p.GRAVITY * math.sin(slope), rel=1e-6)


@every_car
@pytest.mark.parametrize("steer", [0.0, 0.1])
@pytest.mark.parametrize("torque", [200.0, 800.0, 3000.0])
def test_a_car_braked_to_standstill_stays_there(car, steer, torque):
    vehicle, road = load(car), p.road((0.0, 0.9))
    states = watch(vehicle, road, rolling_start(vehicle, 5.0), p.Inputs(steer, NOTHING, np.full(4, torque)), 4000)
    at_rest = states[np.argmax(states[:, p.VX] < 1e-3) + 200 :]
    assert len(at_rest) > 300
    assert np.all(states[:, p.VX] >= -1e-12)  # it never rolls back, but for rounding
    assert np.all(states[:, p.WHEEL_SPEEDS] >= 0)
    # What is left decays with 4 C/(v0 m), sideways at 180 1/s or more: 1e-3 m/s becomes 2e-19 in 0.2 s.
    assert np.abs(at_rest[:, [p.VX, p.VY, p.YAW_RATE]]).max() < 1e-12
    assert not np.any(at_rest[:, p.WHEEL_SPEEDS])


@every_car
@pytest.mark.parametrize("drive", [(300.0, 300.0, 0.0, 0.0), (0.0, 0.0, 300.0, 300.0), (150.0, 150.0, 150.0, 150.0)])
def test_a_launch_gains_the_speed_that_the_torque_gives(car, drive):
    # Wheels and car together are one mass while slip is small, here 0.8 %; a driven wheel turns that much faster,
    # and the four wheels are 3 % of the inertia: 0.02 %.
    vehicle = load(car)
    state = coast(vehicle, p.road((0.0, 0.9)), np.zeros(p.STATE_SIZE), 3.0, drive=np.array(drive))
    gained = 3.0 * sum(drive) / vehicle.wheel_radius / effective_mass(vehicle)
    assert state[p.VX] == pytest.approx(gained, rel=3e-4)
    assert gained > 3


@every_car
@pytest.mark.parametrize("friction", [0.9, 0.3])
def test_locked_wheels_slow_the_car_by_the_plateau(car, friction):
    vehicle, road = load(car), p.road((0.0, friction))
    brake = np.full(4, 8000.0)
    sliding = coast(vehicle, road, rolling_start(vehicle, 20.0), 0.5, brake=brake)
    later = coast(vehicle, road, sliding, 0.5, brake=brake)
    assert not np.any(sliding[p.WHEEL_SPEEDS])
    # Every wheel slides straight on: the sum of plateau mu Fz is plateau mu m g however the load is shared.
    assert sliding[p.VX] - later[p.VX] == pytest.approx(0.5 * PLATEAU * friction * p.GRAVITY, rel=1e-9)
    assert later[p.AX] == pytest.approx(-PLATEAU * friction * p.GRAVITY, rel=1e-9)


@every_car
@every_integrator
def test_a_coasting_straight_car_stays_straight_exactly(car, integrator):
    vehicle = load(car)
    inputs = p.Inputs(0.0, NOTHING, NOTHING)
    state = integrator(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, 20.0), inputs, 5000, 1e-3)
    assert not np.any(state[[p.Y, p.YAW, p.VY, p.YAW_RATE]])
    assert state[p.VX] == pytest.approx(20.0, rel=1e-12)  # nothing resists; R (v/R) is v but for rounding
    assert state[p.X] == pytest.approx(100.0, rel=1e-9)
    assert state[p.DISTANCE] == pytest.approx(state[p.X], rel=1e-9)


@every_car
def test_a_bank_pulls_to_the_lower_side(car):
    vehicle, bank = load(car), 0.05  # left side higher
    road = p.road((0.0, 0.9), bank=bank)
    first = coast(vehicle, road, rolling_start(vehicle, 20.0), 0.001)
    assert first[p.VY] == pytest.approx(-1e-3 * p.GRAVITY * math.sin(bank), rel=1e-9)
    later = coast(vehicle, road, rolling_start(vehicle, 20.0), 1.0)
    assert later[p.Y] < -0.05  # to the right


@every_car
@pytest.mark.parametrize("slope", [0.05, -0.05])
def test_a_slope_slows_a_coasting_car_and_its_wheels(car, slope):
    # The free wheels are held back through their tyres, with a slip of 1e-4: so much they differ from one mass.
    vehicle = load(car)
    state = coast(vehicle, p.road((0.0, 0.9), slope=slope), rolling_start(vehicle, 20.0), 2.0)
    fall = -p.GRAVITY * math.sin(slope) * vehicle.mass / effective_mass(vehicle)
    assert state[p.VX] - 20.0 == pytest.approx(2.0 * fall, rel=1e-4)


def friction_under(vehicle, road, distance):
    """What each locked wheel of a sliding car finds: force over load and plateau, (4,)."""
    state = rolling_start(vehicle, 20.0)
    state[p.WHEEL_SPEEDS], state[p.DISTANCE] = 0.0, distance
    wheels = evaluate(vehicle, road, state)
    return np.hypot(wheels[:, FX], wheels[:, FY]) / wheels[:, LOAD] / PLATEAU


@every_car
def test_friction_changes_at_the_front_wheels_first(car):
    vehicle, road = load(car), p.road((0.0, 0.9), (50.0, 0.3))
    for distance, front, rear in (
        (50 - vehicle.lf - 1e-6, 0.9, 0.9),
        (50 - vehicle.lf + 1e-6, 0.3, 0.9),
        (50 + vehicle.lr - 1e-6, 0.3, 0.9),
        (50 + vehicle.lr + 1e-6, 0.3, 0.3),
    ):
        np.testing.assert_allclose(friction_under(vehicle, road, distance), [front, front, rear, rear], rtol=1e-9)
        assert road_friction(vehicle, road, distance) == pytest.approx((front + rear) / 2, rel=1e-12)


@every_car
def test_each_side_has_its_own_friction(car):
    vehicle = load(car)
    road = p.road((0.0, 0.9))._replace(friction_right=np.array([0.2]))
    np.testing.assert_allclose(friction_under(vehicle, road, 0.0), [0.9, 0.2, 0.9, 0.2], rtol=1e-9)
    braked = coast(vehicle, road, rolling_start(vehicle, 20.0), 0.3, brake=np.full(4, 8000.0))
    assert braked[p.YAW_RATE] > 0  # towards the side that grips


@every_car
def test_only_the_front_wheels_steer(car):
    vehicle = load(car)
    wheels = evaluate(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, 20.0), steer=0.02)
    np.testing.assert_allclose(wheels[:, COS], [math.cos(0.02)] * 2 + [1.0] * 2, rtol=1e-15)
    np.testing.assert_allclose(wheels[:, SIN], [math.sin(0.02)] * 2 + [0.0] * 2, rtol=1e-15)
    assert np.all(wheels[:2, FY] > 0)  # steering left pushes left


@every_car
def test_locked_wheels_hold_the_car_on_stiffer_tyres_too(car):
    # Four tyres of Cs/v0 on one car: a step of 1 ms that left the car's own speed out would diverge here, because
    # 4 Cs h/(v0 m) = 2.5 > 2.
    vehicle = load(car)
    front, rear = (
        tyre._replace(slip_stiffness=0.5 * 2.5 * vehicle.mass / 4 / 1e-3)
        for tyre in (vehicle.front_tyre, vehicle.rear_tyre)
    )
    stiff = vehicle._replace(front_tyre=front, rear_tyre=rear)
    inputs = p.Inputs(0.0, NOTHING, np.full(4, 3000.0))
    speed = watch(stiff, p.road((0.0, 0.9)), rolling_start(stiff, 5.0), inputs, 1000)[:, p.VX]
    assert np.all(speed >= 0)
    assert np.all(np.diff(speed) <= 0)
    assert speed[-1] < 1e-12


@every_car
@pytest.mark.parametrize(
    ("speed", "rim"), [(0.1, 0.0), (1.0, 0.0), (2.0, 0.0), (20.0, 0.0), (0.0, 5.0), (2.0, 10.0), (20.0, 40.0)]
)
def test_wheels_that_slide_find_back_to_rolling(car, speed, rim):
    # No brake, no drive: friction stops the sliding and then there is none, while the momentum of car and wheels,
    # m v + 4 Iw w/R, is kept. At the plateau the rim gains some 0.3 m/s in a step of 1 ms, beyond the slow car's own
    # speed, so that a step that only knows the plateau turns the slip round for ever.
    vehicle = load(car)
    start = rolling_start(vehicle, speed)
    start[p.WHEEL_SPEEDS] = rim / vehicle.wheel_radius
    states = watch(vehicle, p.road((0.0, 0.9)), start, p.Inputs(0.0, NOTHING, NOTHING), 500)
    wheels = 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2
    rolls = (vehicle.mass * speed + wheels * rim) / (vehicle.mass + wheels)
    np.testing.assert_allclose(states[-1, p.WHEEL_SPEEDS] * vehicle.wheel_radius, rolls, rtol=1e-6)
    assert states[-1, p.VX] == pytest.approx(rolls, rel=1e-6)
    assert np.abs(states[-100:, p.AX]).max() < 1e-6


@every_car
@pytest.mark.parametrize("wheel", range(4))
def test_braking_a_wheel_turns_the_car_to_its_side_and_counts_the_heat(car, wheel):
    vehicle, road = load(car), p.road((0.0, 0.9))
    brake = np.zeros(4)
    brake[wheel] = 300.0
    states = watch(vehicle, road, rolling_start(vehicle, 20.0), p.Inputs(0.0, NOTHING, brake), 200)
    state = states[-1]
    assert np.sign(state[p.YAW_RATE]) == np.sign(wheel_position(vehicle, wheel)[1])
    # A wheel's speed is straight over a step, so that the trapezium is the work exactly.
    assert state[p.BRAKE_WORK] == pytest.approx(300 * np.trapezoid(states[:, p.WHEEL + wheel], dx=1e-3), rel=1e-9)
