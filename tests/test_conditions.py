"""How the true car and its road differ from what is told: steering offset, radius errors, slope and bank."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vse_gym.manoeuvres.straight_driving import StraightDriving
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.physics.reference import advance_reference
from vse_gym.scenarios import scenario
from vse_gym.sensors import QUIET, Sensors
from vse_gym.simulation import Simulation, rollout
from vse_gym.types import U_STEER, Y_WHEEL
from vse_gym.vehicles import load

NOTHING = np.zeros(4)
ERRORS = p.PerWheel(0.03, -0.02, 0.0, 0.01)
every_integrator = pytest.mark.parametrize("integrator", [advance, advance_reference], ids=lambda f: f.__name__)


def straight(vehicle, **settings):
    return scenario(StraightDriving(speed=20.0, half_lane=100.0, **settings), vehicle, "clean")


@pytest.mark.parametrize("offset_deg", [0.1, -0.1])
def test_a_steering_offset_turns_the_car_and_no_reading_shows_it(offset_deg):
    vehicle = load("qin2014_understeer")
    drive = straight(vehicle._replace(steering_offset=math.radians(offset_deg)))
    log = rollout(drive, "truth", "none", 0)
    # r = v steer/(l + K v^2); 0.26 m/s2 soften the tyre by 0.2 %, and the car loses a little speed.
    v = log.truth[-1, p.VX]
    theory = v * math.radians(offset_deg) / (vehicle.wheelbase + vehicle.understeer_gradient * v**2)
    assert log.truth[-1, p.YAW_RATE] == pytest.approx(theory, rel=0.005)
    assert not np.any(log.hand_wheel) and not np.any(log.steer) and not np.any(log.inputs[:, U_STEER])


def test_a_steering_offset_adds_to_what_the_driver_steers():
    vehicle = load("qin2014_understeer")
    settings = {"amplitude": math.radians(32), "begin": 0.0, "speed": 20.0}
    steered = scenario("held_steer", vehicle, "clean", **settings)
    crooked = scenario("held_steer", vehicle._replace(steering_offset=math.radians(-2)), "clean", **settings)
    assert abs(rollout(crooked, "truth", "none", 0).truth[-1, p.YAW_RATE]) < 1e-4  # 32 deg over 16 less 2 deg
    assert rollout(steered, "truth", "none", 0).truth[-1, p.YAW_RATE] > 0.1


def test_a_wheel_of_another_radius_turns_at_another_speed_and_no_other_wheel_does():
    vehicle, true = load("qin2014"), load("qin2014")._replace(radius_error=ERRORS)
    log = rollout(straight(true), "truth", "none", 0)
    rolling = log.truth[:, [p.VX]] / vehicle.wheel_radius
    np.testing.assert_allclose(log.truth[:, p.WHEEL_SPEEDS], rolling / (1 + np.array(ERRORS)), rtol=1e-12)
    assert not np.any(log.truth[:, p.YAW_RATE])  # rolling freely, it does not pull to a side


def test_the_wheel_speed_sensors_read_the_wheels_as_they_turn():
    true = load("qin2014")._replace(radius_error=ERRORS)
    simulation = Simulation(scenario("straight_driving", true, Sensors(QUIET)), "truth")
    simulation.reset(0)
    readings = np.array([simulation.step().reading.y[Y_WHEEL : Y_WHEEL + 4] for _ in range(300)])
    ratios = np.nanmean(readings, axis=0) * load("qin2014").wheel_radius / simulation.state[p.VX]
    # 300 readings of the quiet sensors' noise, below 0.5 rad/s of 67, average to 0.05 %.
    np.testing.assert_allclose(ratios, 1 / (1 + np.array(ERRORS)), rtol=1.5e-3)


@every_integrator
def test_momentum_is_kept_on_unlike_wheels(integrator):
    # No brake, no drive: wheels 5 % too fast slow down and push the car; m v + sum of Iw w/R stays, because each wheel
    # and the car feel the same force. In the end all roll.
    vehicle = load("qin2014")._replace(radius_error=ERRORS, lf=1.28, lr=1.28)
    road, radii = p.road((0.0, 0.9)), 0.33 * (1 + np.array(ERRORS))
    start = rolling_start(vehicle, 20.0)
    start[p.WHEEL_SPEEDS] *= 1.05
    inputs = p.Inputs(0.0, NOTHING, NOTHING)

    def momentum(x):
        return vehicle.mass * x[p.VX] + vehicle.wheel_inertia * np.sum(x[p.WHEEL_SPEEDS] / radii)

    state = integrator(vehicle, road, start, inputs, 20, 1e-3)
    # The unlike wheels' pushes differ, and turn the car a little: vx is then not along the path any more.
    assert momentum(state) == pytest.approx(momentum(start), rel=1e-6)
    later = integrator(vehicle, road, start, inputs, 2000, 1e-3)
    np.testing.assert_allclose(later[p.WHEEL_SPEEDS] * radii, later[p.VX], rtol=2e-3)


@pytest.mark.parametrize(
    ("field", "wrong"),
    [
        ("steering_offset", 0.5),
        ("steering_offset", math.nan),
        ("radius_error.rear_left", p.PerWheel(rear_left=-0.5)),
        ("radius_error.front_right", p.PerWheel(front_right=math.inf)),
    ],
)
def test_a_condition_that_cannot_be_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=field.replace(".", r"\.")):
        load(load("qin2014")._replace(**{field.partition(".")[0]: wrong}))


@pytest.mark.parametrize("field", ["slope", "bank"])
@pytest.mark.parametrize("wrong", [0.5, -0.6, math.nan])
def test_a_road_too_steep_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=field):
        StraightDriving(**{field: wrong})


def test_a_manoeuvre_s_slope_slows_the_car():
    log = rollout(straight("qin2014", slope=0.05, duration=2.0), "truth", "none", 0)
    vehicle = load("qin2014")
    effective = vehicle.mass + 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2
    gone = 2.0 * p.GRAVITY * math.sin(0.05) * vehicle.mass / effective
    assert 20.0 - log.truth[-1, p.VX] == pytest.approx(gone, rel=2e-4)


def test_a_manoeuvre_s_bank_pulls_the_car_to_the_lower_side():
    log = rollout(straight("qin2014", bank=0.05, duration=0.1), "truth", "none", 0)
    # The tyres let it go slowly: d vy/dt = -g sin(bank) at first.
    assert log.truth[1, p.VY] == pytest.approx(-0.01 * p.GRAVITY * math.sin(0.05), rel=0.1)


def test_a_tilt_adds_to_the_road_s_own():
    drive = scenario("held_steer", "qin2014", friction_after=0.5)
    tilted = replace(drive, manoeuvre=replace(drive.manoeuvre, slope=0.02, bank=-0.03))
    assert tilted.road.friction_left.tolist() == drive.road.friction_left.tolist()
    assert tilted.road.slope.tolist() == [0.02] * 2 and tilted.road.bank.tolist() == [-0.03] * 2
    hilly = p.road((0.0, 0.9), slope=0.01, bank=0.02)
    both = p.tilted(hilly, 0.02, -0.02)
    assert both.slope.tolist() == [0.03] and both.bank.tolist() == [0.0]
