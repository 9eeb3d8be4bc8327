"""The body that rolls, driven hard: energy, symmetry, the rigid car, steps, standstill."""

import math

import numpy as np
import pytest

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    CONTACT,
    FX,
    FY,
    MZ,
    RADIUS,
    advance,
    contact,
    rolling_start,
    wheel_velocity,
)
from vse_gym.physics.reference import advance_reference, unsteady_contact
from vse_gym.vehicles import load

CAR = load("wei2019_roll")
BODY = CAR.body
STEADY = CAR._replace(relaxation_x=0.0, relaxation_y=0.0)
NOTHING = np.zeros(4)
KMH = 1 / 3.6
ROAD = p.road((0.0, 0.9))
MIRRORED = [1, 0, 3, 2]
every_integrator = pytest.mark.parametrize("integrator", [advance, advance_reference], ids=lambda f: f.__name__)


def rolling(**changes):
    """The body with other numbers."""
    return BODY._replace(**changes)


def violent(time):
    """12 deg of steer at 0.7 Hz, a launch, one side braked, then all wheels locked."""
    steer = math.radians(12) * math.sin(2 * math.pi * 0.7 * time)
    push = np.array([400.0, 400.0, 0.0, 0.0]) if time < 1 else NOTHING
    if 1.5 < time < 2:
        return p.Inputs(steer, push, np.array([1500.0, 0.0, 400.0, 0.0]))
    if 2.8 < time < 3.2:
        return p.Inputs(steer, push, np.array([2500.0, 2500.0, 1200.0, 1200.0]))
    return p.Inputs(steer, push, NOTHING)


def energy(vehicle, x):
    """Of the car, the body's swing and its springs less its weight's fall [J]."""
    body, moved = vehicle.body, 0.5 * vehicle.mass * (x[p.VX] ** 2 + x[p.VY] ** 2)
    swing = body.sprung_mass * body.roll_arm
    moved += 0.5 * vehicle.yaw_inertia * x[p.YAW_RATE] ** 2
    moved += 0.5 * vehicle.wheel_inertia * np.sum(x[p.WHEEL_SPEEDS] ** 2)
    moved += 0.5 * (body.roll_inertia + swing * body.roll_arm) * x[p.ROLL_RATE] ** 2
    moved -= (swing * x[p.VY] + body.roll_yaw_product * x[p.YAW_RATE]) * x[p.ROLL_RATE]
    return moved + 0.5 * (body.roll_stiffness - swing * p.GRAVITY) * x[p.ROLL] ** 2


def lost_power(vehicle, x, inputs):
    """What tyres and damper take, less what the drive gives [W]."""
    wheels = np.empty((4, CONTACT))
    contact(vehicle, ROAD, x, inputs.steer, wheels)
    if vehicle.relaxation_x > 0:
        unsteady_contact(vehicle, ROAD, x, wheels, np.empty(p.STATE_SIZE))
    power = vehicle.body.roll_damping * x[p.ROLL_RATE] ** 2 - inputs.drive @ x[p.WHEEL_SPEEDS]
    for i in range(4):
        along, across = wheel_velocity(vehicle, i, x[p.VX], x[p.VY], x[p.YAW_RATE], inputs.steer)
        power += wheels[i, FX] * (wheels[i, RADIUS] * x[p.WHEEL + i] - along)
        power -= wheels[i, FY] * across + wheels[i, MZ] * x[p.YAW_RATE]
    return power


@pytest.mark.parametrize("vehicle", [CAR, STEADY], ids=["unsteady tyres", "steady tyres"])
def test_keeps_account_of_energy_in_a_violent_drive(vehicle):
    x = rolling_start(vehicle, 80 * KMH)
    before, gone, turned, damped = energy(vehicle, x), 0.0, 0.0, 0.0
    for k in range(400):
        inputs = violent(0.01 * k)
        for _ in range(10):
            y = advance_reference(vehicle, ROAD, x, inputs, 1, 1e-3)
            gone += 0.5e-3 * (lost_power(vehicle, x, inputs) + lost_power(vehicle, y, inputs))
            damped += 1e-3 * vehicle.body.roll_damping * y[p.ROLL_RATE] ** 2
            turned = max(turned, abs(y[p.ROLL]))
            x = y
    gone += x[p.BRAKE_WORK]
    assert turned > math.radians(3)
    assert damped > 300.0  # J, so that a damper that took nothing would be seen
    # The trapezium errs by half a step of 20 kW where a wheel locks or lets go, of 200 kJ: 5e-5 each.
    assert abs(energy(vehicle, x) - before + gone) < 1e-4 * gone


def mirror(state):
    """The same car in a mirror."""
    out = state.copy()
    out[[p.Y, p.YAW, p.VY, p.YAW_RATE, p.LOAD_AY, p.AY, p.ROLL, p.ROLL_RATE]] *= -1
    for first in (p.WHEEL, p.LAG_X, p.LAG_Y):
        out[first : first + 4] = state[first : first + 4][MIRRORED]
    out[p.LAG_Y : p.LAG_Y + 4] *= -1
    return out


@pytest.mark.parametrize(
    ("vehicle", "integrator"), [(STEADY, advance), (STEADY, advance_reference), (CAR, advance_reference)]
)
def test_a_mirrored_driver_gets_the_mirrored_roll(vehicle, integrator, driven):
    def other(time):
        steer, push, brake = violent(time)
        return p.Inputs(-steer, push[MIRRORED], brake[MIRRORED])

    left, right = driven(vehicle, integrator, violent, 4.0), driven(vehicle, integrator, other, 4.0)
    assert np.abs(left[:, p.ROLL]).max() > math.radians(3)
    for one, two in zip(left, right, strict=True):
        np.testing.assert_allclose(mirror(two), one, rtol=0, atol=1e-9 * max(1.0, np.abs(one).max()))


@every_integrator
def test_a_body_that_hangs_in_its_centre_of_gravity_leaves_the_car_alone(integrator, driven):
    hung = STEADY._replace(body=rolling(roll_arm=0.0, roll_yaw_product=0.0))
    states, rigid = (driven(car, integrator, violent, 3.0) for car in (hung, STEADY._replace(body=p.RigidBody())))
    assert not np.any(states[:, p.ROLL])
    np.testing.assert_allclose(states, rigid, rtol=1e-9, atol=1e-9)  # equal but for the order of factors


def test_a_rigid_body_never_rolls(driven):
    states = driven(STEADY._replace(body=p.RigidBody()), advance, violent, 2.0)
    assert not np.any(states[:, [p.ROLL, p.ROLL_RATE]])


def test_the_default_step_takes_springs_of_any_stiffness(driven):
    stone = STEADY._replace(body=rolling(roll_stiffness=1e10))
    states = driven(stone, advance, violent, 3.0)
    assert np.all(np.isfinite(states))
    assert np.abs(states[:, p.ROLL]).max() < 1e-5


def test_the_default_step_follows_the_reference_at_the_limit(driven):
    def steered(time):
        return p.Inputs(math.radians(100) / CAR.steering_ratio * math.sin(2 * math.pi * 0.7 * time), NOTHING, NOTHING)

    coarse, fine = driven(STEADY, advance, steered, 2.0), driven(STEADY, advance_reference, steered, 2.0, 1e-4)
    assert np.abs(fine[:, p.AY]).max() > 0.8 * 0.9 * p.GRAVITY
    away = np.degrees(np.abs(coarse - fine)[:, [p.YAW_RATE, p.ROLL]].max(axis=0))
    assert away[0] < 2.0  # deg/s, what first order costs a rigid car too
    assert away[1] < 0.1


@pytest.mark.parametrize(("vehicle", "integrator"), [(STEADY, advance), (CAR, advance_reference)])
def test_a_body_swings_on_when_the_car_stands_and_comes_to_rest(vehicle, integrator, driven):
    states = driven(vehicle, integrator, lambda _: p.Inputs(0.1, NOTHING, np.full(4, 800.0)), 5.0, speed=5.0)
    stood = int(np.argmax(states[:, p.VX] < 1e-3))
    assert np.abs(states[stood, p.ROLL_RATE]) > 1e-4
    # The free swing fades with 2.2/s at least: in 2 s to a hundredth.
    assert np.abs(states[stood + 200 :, p.ROLL_RATE]).max() < 0.02 * np.abs(states[stood:, p.ROLL_RATE]).max()
    assert np.abs(states[stood:, p.X] - states[stood, p.X]).max() < 0.02  # unsteady tyres rock on their deflection
