"""The cars that come with the package: where their numbers come from, how they steer, drive and stop."""

import math

import numpy as np
import pytest
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

from vse_gym.manoeuvres.slowly_increasing_steer import steer_at_0_3g
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.vehicles import load, names

CARS = names()
NOTHING = np.zeros(4)
OVERSTEERING = {"qin2014"}  # as published
COMMONROAD = {"ford_escort": 1, "bmw_320i": 2, "vw_vanagon": 3}
every_car = pytest.mark.parametrize("name", CARS)


def drive(vehicle, speed, seconds, hand_wheel_deg=0.0, drive=NOTHING, brake=NOTHING, friction=0.9):
    steer = math.radians(hand_wheel_deg) / vehicle.steering_ratio
    inputs = p.Inputs(steer, drive, brake)
    start = rolling_start(vehicle, speed)
    return advance(vehicle, p.road((0.0, friction)), start, inputs, round(1000 * seconds), 1e-3)


@every_car
def test_understeers_as_its_axles_share_weight_and_stiffness(name):
    # Gillespie's form, the slip angles that the axles need per g: W/C of each axle from its share of the weight.
    vehicle = load(name)
    weight = vehicle.mass * p.GRAVITY / vehicle.wheelbase
    front = weight * vehicle.lr / (2 * vehicle.front_tyre.cornering_stiffness)
    rear = weight * vehicle.lf / (2 * vehicle.rear_tyre.cornering_stiffness)
    assert vehicle.understeer_gradient * p.GRAVITY == pytest.approx(front - rear, abs=1e-12)
    assert (vehicle.understeer_gradient < 0) == (name in OVERSTEERING)
    assert abs(math.degrees(vehicle.understeer_gradient) * p.GRAVITY) < 3  # deg/g: no road car is beyond


@every_car
def test_stiffness_in_proportion_to_load_is_that_of_the_wheel_at_rest(name):
    vehicle = load(name)
    weight = vehicle.mass * p.GRAVITY / vehicle.wheelbase
    for tyre, arm in ((vehicle.front_tyre, vehicle.lr), (vehicle.rear_tyre, vehicle.lf)):
        if tyre.reference_load:  # written to 0.1 N
            assert tyre.reference_load == pytest.approx(weight * arm / 2, abs=0.1)


# Prototype of another make, to 5 %: how the drive torque holds the speed moves them by that.
@pytest.mark.parametrize(
    ("name", "degrees"), [("chen2024_c_class", 20.4), ("qin2014", 16.3), ("qin2014_understeer", 22.4)]
)
def test_needs_so_much_hand_wheel_for_0_3_g(name, degrees):
    assert math.degrees(steer_at_0_3g(load(name))) == pytest.approx(degrees, rel=0.05)


@every_car
def test_needs_the_hand_wheel_of_a_passenger_car_for_0_3_g(name):
    assert 15 < math.degrees(steer_at_0_3g(load(name))) < 30


@every_car
def test_drives_straight_when_driven(name):
    vehicle = load(name)
    front = vehicle.front_drive
    torque = 0.5 * 600 * np.array([front, front, 1 - front, 1 - front])
    state = drive(vehicle, 20.0, 3.0, drive=torque)
    assert not np.any(state[[p.Y, p.YAW, p.VY, p.YAW_RATE]])
    assert 22 < state[p.VX] < 25


@every_car
def test_turns_left_for_a_hand_wheel_to_the_left(name):
    vehicle = load(name)
    speed = min(20.0, 0.5 * vehicle.critical_speed)
    state = drive(vehicle, speed, 2.0, hand_wheel_deg=20.0)
    single_track = speed * math.radians(20) / 16 / (vehicle.wheelbase + vehicle.understeer_gradient * speed**2)
    assert state[p.YAW_RATE] > 0 and state[p.Y] > 0 and state[p.AY] > 0
    assert state[p.YAW_RATE] == pytest.approx(single_track, rel=0.1)  # 2 to 3 m/s2 soften the tyres by some per cent


@every_car
def test_stops_within_what_friction_allows_and_stays(name):
    # From 20 m/s, 300 N m a wheel in front and 150 behind brake without locking: F = 900/R on mass and wheels.
    vehicle = load(name)
    brake = np.array([300.0, 300.0, 150.0, 150.0])
    effective = vehicle.mass + 4 * vehicle.wheel_inertia / vehicle.wheel_radius**2
    expected = 20.0 * effective * vehicle.wheel_radius / 900  # s
    before = drive(vehicle, 20.0, 0.9 * expected, brake=brake)
    after = drive(vehicle, 20.0, 1.2 * expected + 1.0, brake=brake)
    assert before[p.VX] == pytest.approx(2.0, abs=0.1)
    assert abs(after[p.VX]) < 1e-6 and not np.any(after[p.WHEEL_SPEEDS])


@pytest.mark.parametrize("name", COMMONROAD)
def test_commonroads_cars_have_its_numbers(name):
    car, theirs = load(name), setup_vehicle_parameters(COMMONROAD[name])
    ours = (car.mass, car.yaw_inertia, car.lf, car.lr, car.height, car.track_front, car.track_rear, car.width)
    published = (theirs.m, theirs.I_z, theirs.a, theirs.b, theirs.h_cg, theirs.T_f, theirs.T_r, theirs.w)
    assert ours == pytest.approx(published, rel=1e-5)
    assert (car.wheel_radius, car.wheel_inertia) == (theirs.R_w, theirs.I_y_w)
    assert car.front_drive == theirs.T_se
    assert car.front_overhang + car.wheelbase + car.rear_overhang == pytest.approx(theirs.l, abs=1e-3)
    tyre = theirs.tire
    wheelbase = theirs.a + theirs.b
    for mine, arm, unsprung in ((car.front_tyre, theirs.b, theirs.m_uf), (car.rear_tyre, theirs.a, theirs.m_ur)):
        load_there = 0.5 * p.GRAVITY * (theirs.m_s * arm / wheelbase + unsprung)
        assert mine.slip_stiffness == pytest.approx(tyre.p_kx1 * load_there, rel=1e-5)
        assert mine.cornering_stiffness == pytest.approx(-tyre.p_ky1 * load_there, rel=1e-5)
        assert (mine.shape_x, mine.curvature_x, mine.peak_x) == (tyre.p_cx1, tyre.p_ex1, tyre.p_dx1)
        assert (mine.shape_y, mine.curvature_y, mine.peak_y) == (tyre.p_cy1, tyre.p_ey1, tyre.p_dy1)


@pytest.mark.parametrize("name", COMMONROAD)
def test_commonroads_cars_share_lateral_load_transfer_as_their_springs_do(name):
    car, theirs = load(name), setup_vehicle_parameters(COMMONROAD[name])
    axles = []
    for spring, bar, track in ((theirs.K_sf, theirs.K_tsf, theirs.T_f), (theirs.K_sr, theirs.K_tsr, theirs.T_r)):
        sprung, tyres = 0.5 * spring * track**2 - bar, 0.5 * theirs.K_zt * track**2  # N m/rad, bars are negative there
        axles.append(sprung * tyres / (sprung + tyres))
    assert car.front_transfer == pytest.approx(axles[0] / sum(axles), abs=1e-3)
