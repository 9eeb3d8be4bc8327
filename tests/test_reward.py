"""What a step is worth, against the formula by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.env import worth
from vse_gym.physics import parameters as p
from vse_gym.reward import INTERVENTION, MOVING, PEAK, SQUARES, reward_memory, step_reward, tally
from vse_gym.scenarios import scenario

NONE, START = np.zeros(4), 20.0
SCENARIO = scenario("sine_with_dwell", speed=START)
WORTH, CAR = worth(SCENARIO), SCENARIO.vehicle


def car(vx, vy=0.0, yaw_rate=0.0):
    state = np.zeros(p.STATE_SIZE)
    state[p.VX], state[p.VY], state[p.YAW_RATE] = vx, vy, yaw_rate
    return state


def reward(state, memory=None, steer=0.0, added=NONE, brake=NONE, friction=0.9):
    return step_reward(
        WORTH, reward_memory(WORTH.value) if memory is None else memory, state, steer, added, brake, friction
    )


def test_a_car_that_goes_straight_at_its_speed_has_all_there_is():
    assert reward(car(START))[0] == 1.0


@given(st.floats(0.0, 25.0))
def test_speed_lost_costs_its_share_and_speed_won_nothing_while_the_driver_does_not_brake(speed):
    assert reward(car(speed))[0] == pytest.approx(1 - 0.8 * max(0.0, 1 - speed / START))


@given(st.floats(-math.pi, math.pi))
def test_sideslip_costs_up_to_ten_degrees(sideslip):
    state = car(START * math.cos(sideslip), START * math.sin(sideslip))
    slides = abs(math.atan2(state[p.VY], max(state[p.VX], 1.0)))
    assert reward(state)[0] == pytest.approx(1 - 0.4 * min(1.0, slides / math.radians(10)), abs=1e-9)


def test_turning_otherwise_than_wanted_and_braking_cost_what_they_should():
    assert reward(car(START, yaw_rate=math.radians(10)))[0] == pytest.approx(1 - 0.6 * 0.5)
    assert reward(car(START), added=CAR.brake_caps)[0] == pytest.approx(1 - 0.2)
    assert reward(car(START), added=np.array([CAR.brake_cap_front, 0, 0, 0]))[0] == pytest.approx(1 - 0.05)


@pytest.mark.parametrize(("friction", "had"), [(0.9, 5.0), (0.2, 0.2 * p.GRAVITY)])
def test_who_brakes_as_the_driver_does_loses_nothing_and_who_rolls_on_does(friction, had):
    """5 m/s2 of his torques, or what a slippery road lets him have."""
    brake = np.full(4, 5.0 * CAR.mass * CAR.wheel_radius / 4)
    obeys, rolls = reward_memory(WORTH.value), reward_memory(WORTH.value)
    for k in range(1, 101):
        speed = START - had * 0.01 * k
        full, obeys = reward(car(speed), obeys, brake=brake, friction=friction)
        less, rolls = reward(car(START), rolls, brake=brake, friction=friction)
        assert full == pytest.approx(1.0)
        assert less == pytest.approx(1 - 0.8 * had * 0.01 * k / START)
    assert reward(car(speed), obeys)[0] == pytest.approx(1.0)  # he has let go: the speed that he has is wanted


@given(st.lists(st.floats(-60, 60), min_size=3, max_size=3), st.floats(0, 1), st.floats(0, 3000))
def test_it_is_bounded_and_the_same_in_the_mirror(motion, share, torque):
    vx, vy, yaw_rate = motion
    added = share * CAR.brake_caps
    right = reward(car(vx, vy, yaw_rate), steer=0.05, added=added, brake=np.full(4, torque))[0]
    left = reward(car(vx, -vy, -yaw_rate), steer=-0.05, added=added[[1, 0, 3, 2]], brake=np.full(4, torque))[0]
    assert -1 <= right <= 1
    assert right == left


def test_who_does_not_turn_is_charged_for_what_the_road_would_bear():
    """Full lock: the reference goes to 0.85 friction g/v, whatever the car has done so far."""
    memory = reward_memory(WORTH.value)
    for _ in range(100):
        worth, memory = reward(car(START), memory, steer=0.3, friction=0.2)
    limit = 0.85 * 0.2 * p.GRAVITY / START
    assert memory[0] == pytest.approx(limit, rel=1e-5)
    assert worth == pytest.approx(1 - 0.6 * limit / math.radians(20), rel=1e-5)


def test_what_is_not_finite_is_worth_the_least():
    assert reward(car(math.nan))[0] == -1.0


def test_totals_are_the_largest_slip_the_error_s_squares_and_the_time_of_control():
    totals, motion = np.zeros(4), np.array([10.0, 0.0, 0.0, 0.0, 0.0])
    for vy, added in ((1.0, NONE), (-2.0, CAR.brake_caps), (0.5, NONE)):
        totals = tally(WORTH, totals, car(10.0, vy), motion, added, NONE)
    slips = np.arctan2([1.0, -2.0, 0.5], 10.0)
    assert totals[PEAK] == pytest.approx(np.abs(slips).max())
    assert totals[SQUARES] == pytest.approx(np.sum(slips**2))
    assert (totals[MOVING], totals[INTERVENTION]) == (3, pytest.approx(0.01))
    assert np.array_equal(tally(WORTH, totals, car(1.0, 1.0), motion, NONE, NONE), totals)  # too slow to have a slip
