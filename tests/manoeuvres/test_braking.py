"""Braking on split friction, over a jump and in a turn; and cars that need no help."""

import math

import numpy as np
import pytest

from vse_gym.manoeuvres.base import lateral_acceleration
from vse_gym.manoeuvres.brake_in_turn import BrakeInTurn
from vse_gym.manoeuvres.followed import stopping_distance
from vse_gym.manoeuvres.friction_jump import FrictionJump
from vse_gym.manoeuvres.gentle_curve import GentleCurve
from vse_gym.manoeuvres.split_friction_braking import SplitFrictionBraking
from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.vehicles import names

DEG = math.pi / 180
every_car = pytest.mark.parametrize("car", names())
EITHER_WAY = pytest.mark.parametrize("side", [1.0, -1.0])


def drive(manoeuvre, car="qin2014_understeer", controller="none", sensors="clean"):
    cell = scenario(manoeuvre, car, sensors)
    log = rollout(cell, "truth", controller, 0)
    verdict = cell.manoeuvre.judge(log, cell.nominal)
    return {c.name: c.figure for c in verdict.criteria}, verdict.passed, log


@EITHER_WAY
def test_the_split_begins_before_the_brakes_and_lies_on_its_side(side):
    test = SplitFrictionBraking(side=side, friction=0.8, friction_low=0.3, begin=1.0, speed=20.0)
    road = test.road()
    assert road.start.tolist() == [0.0, 15.0]
    low, high = (road.friction_left, road.friction_right) if side > 0 else (road.friction_right, road.friction_left)
    assert low.tolist() == [0.8, 0.3] and high.tolist() == [0.8, 0.8]


@every_car
@EITHER_WAY
def test_the_driver_keeps_his_lane_on_split_friction(car, side):
    figures, passed, log = drive(SplitFrictionBraking(side=side), car, "esc")
    assert passed and log.ended == ""
    # Both sides give at most (0.8 + 0.3)/2 g = 5.4 m/s2, and the slippery one alone 0.3 g on all wheels at least.
    speed = SplitFrictionBraking().speed
    assert speed**2 / (2 * 5.4) < figures["stopping distance"] < speed**2 / (2 * 0.3 * p.GRAVITY)
    assert np.sign(log.hand_wheel[170]) == side  # he steers to the slippery side, away from where the brakes pull


@every_car
def test_control_costs_way_on_split_friction_and_keeps_the_car_nearer_to_its_line(car):
    alone, controlled = (drive(SplitFrictionBraking(), car, law)[0] for law in ("none", "esc"))
    reach, way = "reach of the body from the lane's middle", "stopping distance"
    assert controlled[reach] < alone[reach]
    assert controlled[way] > alone[way]


def test_the_harder_he_brakes_on_split_friction_the_further_he_strays():
    reach = [
        drive(SplitFrictionBraking(deceleration=a))[0]["reach of the body from the lane's middle"]
        for a in (4.0, 6.0, 9.8)
    ]
    assert reach == sorted(reach)


@pytest.mark.parametrize("deceleration", [2.0, 5.0])
def test_stopping_on_a_good_road_takes_what_the_deceleration_says(deceleration):
    # From v by a, after the brakes' dead time of 20 ms and lag of 50 ms; ISO's v^2/(2 a) and v times that delay. The
    # rotating wheels share the torque: 4 I/(m R^2) = 2.9 %.
    test = FrictionJump(friction_after=0.9, lateral=0.0, deceleration=deceleration, duration=15.0)
    figures, passed, log = drive(test)
    share = 1 + 4 * 1.2 / (1528 * 0.33**2)
    expected = test.speed**2 / (2 * deceleration) * share + 0.07 * test.speed
    assert figures["stopping distance"] == pytest.approx(expected, rel=0.01)
    assert passed
    assert math.isnan(stopping_distance(log, 20.0))


@every_car
@EITHER_WAY
def test_the_driver_keeps_his_line_over_the_jump(car, side):
    figures, passed, log = drive(FrictionJump(side=side), car)
    assert passed and log.ended == ""
    assert figures["largest distance from the line"] < 0.6


def test_the_jump_lies_where_a_car_at_the_start_speed_is_then():
    road = FrictionJump(speed=20.0, jump=2.0, friction=0.9, friction_after=0.35).road()
    assert road.start.tolist() == [0.0, 40.0]
    assert road.friction_left.tolist() == road.friction_right.tolist() == [0.9, 0.35]


@EITHER_WAY
def test_the_turn_is_steady_before_the_brakes_and_the_hand_wheel_is_held_after(side):
    test = BrakeInTurn(side=side)
    _, _, log = drive(test)
    before = (log.time > 3.0) & (log.time < test.brake)
    curvature = log.truth[before, p.YAW_RATE] / np.hypot(log.truth[before, p.VX], log.truth[before, p.VY])
    np.testing.assert_allclose(curvature, side / test.radius, rtol=0.02)  # 3 s after turning in
    after = log.hand_wheel[log.time > test.brake + 0.02]
    assert np.ptp(after) == 0 and side * after[0] > 0
    assert not log.inputs[before, 1:5].any()  # brakes


@EITHER_WAY
def test_with_an_amplitude_the_hand_wheel_is_held_from_the_start(side):
    test = BrakeInTurn(amplitude=side * 30 * DEG, duration=3.0)
    _, _, log = drive(test)
    np.testing.assert_allclose(log.hand_wheel[log.time > 0.7], side * 30 * DEG)


def test_braking_in_a_turn_separates_control_from_none():
    # Measured with the C class: 36 deg of sideslip without, 2 deg with production control and true states.
    without, passed, _ = drive(BrakeInTurn(), "chen2024_c_class")
    controlled, held, _ = drive(BrakeInTurn(), "chen2024_c_class", "esc")
    assert held and not passed
    assert without["largest sideslip"] > 5 * controlled["largest sideslip"]


@every_car
@EITHER_WAY
def test_a_gentle_curve_needs_no_help(car, side):
    figures, passed, log = drive(GentleCurve(side=side), car)
    assert passed and figures["needless brake energy"] == 0
    assert figures["time of false interventions"] == figures["number of false interventions"] == 0
    ay = np.abs(lateral_acceleration(log)[log.time > 5.0])
    np.testing.assert_allclose(ay, 2.0, rtol=0.03)  # 90 km/h held to 0.1 m/s, squared


def test_what_production_control_brakes_in_a_gentle_curve_is_counted():
    # The oversteering car turns more than the mildly understeering one that the control takes as its reference.
    figures, passed, log = drive(GentleCurve(), "qin2014", "esc")
    asks = (log.added > 0).any(axis=1)
    assert not passed and asks.any()
    assert figures["time of false interventions"] == pytest.approx(0.01 * asks[:-1].sum())
    assert figures["number of false interventions"] == np.sum(np.diff(asks.astype(int)) == 1)
    assert figures["needless brake energy"] == pytest.approx(log.truth[-1, p.BRAKE_WORK] / 1e3)


@pytest.mark.parametrize("settings", [{"friction_low": 0.0}, {"side": 2.0}, {"deceleration": 0.0}, {"begin": 0.0}])
def test_split_friction_that_cannot_be_is_refused(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        SplitFrictionBraking(**settings)
