"""What every manoeuvre and its verdict are; the held hand wheel and straight driving."""

import math

import numpy as np
import pytest

from vse_gym.catalogue import MANOEUVRES
from vse_gym.manoeuvres.base import Criterion, Verdict
from vse_gym.manoeuvres.held_steer import HeldSteer
from vse_gym.manoeuvres.straight_driving import StraightDriving
from vse_gym.physics import parameters as p
from vse_gym.types import Car

DEG = math.pi / 180
DT = 0.01
EITHER_WAY = pytest.mark.parametrize("side", [1, -1])


@pytest.mark.parametrize(("value", "keeps"), [(1.0, True), (0.99, True), (1.01, False), (math.nan, False)])
def test_a_criterion_is_kept_up_to_its_limit(value, keeps):
    assert Criterion("figure", value, 1.0, "m").passed == keeps
    assert Criterion("figure", -value, -1.0, "m", at_least=True).passed == keeps


def test_a_verdict_asks_for_every_judged_criterion():
    good, bad = Criterion("good", 0.0, 1.0, "m"), Criterion("bad", 2.0, 1.0, "m")
    assert Verdict((good,)).passed
    assert not Verdict((good, bad)).passed
    assert Verdict((good, bad._replace(judged=False))).passed


@pytest.mark.parametrize("name", MANOEUVRES)
def test_a_drive_begins_straight_at_its_speed_and_friction(name, nominal):
    manoeuvre = MANOEUVRES.make(name)
    state = np.zeros(p.STATE_SIZE)
    state[p.VX] = manoeuvre.speed
    driver, _ = manoeuvre.drive(manoeuvre.init(nominal), 0.0, Car(state))
    assert driver.hand_wheel == 0
    assert not driver.brake.any()
    assert manoeuvre.road().friction_left[0] == manoeuvre.friction
    assert manoeuvre.road().friction_right[0] == manoeuvre.friction


@EITHER_WAY
def test_a_held_hand_wheel_turns_at_its_rate_to_its_angle_and_stays(side):
    test = HeldSteer(amplitude=side * 1.0, rate=4.0, begin=0.5)
    angles = test.script(np.array([0.0, 0.5, 0.6, 0.75, 0.8, 5.0])).hand_wheel
    np.testing.assert_allclose(angles, side * np.array([0.0, 0.0, 0.4, 1.0, 1.0, 1.0]), atol=1e-12)


def test_a_car_at_the_start_speed_meets_the_other_friction_at_its_time():
    test = HeldSteer(speed=18.0, friction=0.9, friction_after=0.35, jump=1.8)
    road = test.road()
    assert road.start.tolist() == [0, 18.0 * 1.8]
    assert road.friction_left.tolist() == road.friction_right.tolist() == [0.9, 0.35]
    assert HeldSteer().road().start.tolist() == [0]


@pytest.mark.parametrize("setting", ["jump", "rate"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan])
def test_a_held_steer_that_cannot_be_is_refused(setting, wrong):
    with pytest.raises(ValueError, match=setting):
        HeldSteer(**{setting: wrong})


@EITHER_WAY
@pytest.mark.parametrize(("degrees", "passes"), [(14.9, True), (15.1, False)])
def test_a_held_steer_judges_the_largest_sideslip(degrees, passes, side, nominal, log_of, figure):
    time = DT * np.arange(601)
    sideslip = side * degrees * DEG * np.sin(np.pi * time / 6)
    log = log_of(time, VX=20 * np.cos(sideslip), VY=20 * np.sin(sideslip))
    verdict = HeldSteer().verdict(log, nominal)
    assert verdict.passed == passes
    assert figure(verdict, "largest sideslip").figure == pytest.approx(degrees, rel=1e-9)


@EITHER_WAY
def test_straight_driving_ends_outside_its_lane(side, nominal):
    test = StraightDriving(half_lane=1.5)
    state = np.zeros(p.STATE_SIZE)
    for y, off in ((0.0, False), (1.49, False), (1.51, True)):
        state[p.Y] = side * y
        assert test.off_course(Car(state), nominal.vehicle) == off


@pytest.mark.parametrize("criterion", ["largest lateral offset", "largest sideslip", "needless brake energy"])
@pytest.mark.parametrize(("share", "passes"), [(0.99, True), (1.01, False)])
def test_straight_driving_fails_by_each_of_its_limits(criterion, share, passes, nominal, log_of, figure):
    time = DT * np.arange(601)
    limits = {c.name: c.limit for c in StraightDriving().verdict(log_of(time), nominal).criteria}
    rise = share * limits[criterion] * time / time[-1]
    drive = {
        "largest lateral offset": {"Y": -rise},
        "largest sideslip": {"VY": -20 * np.tan(rise * DEG)},
        "needless brake energy": {"BRAKE_WORK": 5e3 + 1e3 * rise},
    }[criterion]
    verdict = StraightDriving().verdict(log_of(time, **drive), nominal)
    assert verdict.passed == passes
    assert figure(verdict, criterion).figure == pytest.approx(share * limits[criterion], rel=1e-6)
