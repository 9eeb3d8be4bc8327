"""Lines to follow against their own geometry."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.manoeuvres.path import STEP, STRAIGHT, Circle, Line, look, stray, strayed_beyond

SWINGS = ((20.0, 50.0, 3.5), (70.0, 100.0, -1.0))
AHEAD = np.linspace(2.0, 40.0, 20)


def test_a_line_is_straight_between_its_swings_and_halfway_in_their_middle():
    line = Line(SWINGS)
    x = np.array([-5.0, 20.0, 35.0, 50.0, 60.0, 70.0, 85.0, 100.0, 500.0])
    np.testing.assert_allclose(line.at(x), [0, 0, 1.75, 3.5, 3.5, 3.5, 1.25, -1, -1], atol=1e-12)


def test_a_car_on_a_straight_line_sees_it_straight_ahead():
    assert not look(STRAIGHT.guide, 50.0, 0.0, 0.0, AHEAD).any()
    np.testing.assert_allclose(look(STRAIGHT.guide, 50.0, 0.5, 0.0, AHEAD), -0.5)
    np.testing.assert_allclose(look(STRAIGHT.guide, 50.0, 0.0, 0.1, AHEAD), -AHEAD * math.sin(0.1))


@given(st.floats(-50, 150), st.floats(-5, 5), st.floats(-1, 1))
def test_a_look_turns_the_line_into_the_car_s_axes(x, y, yaw):
    line = Line(SWINGS)
    ahead = line.at(x + AHEAD)
    expected = math.cos(yaw) * (ahead - y) - math.sin(yaw) * AHEAD
    # The table's chords miss a half cosine of 4.5 m over 30 m by 2.25 (pi/30)^2 STEP^2/8.
    bound = 2.25 * (math.pi / 30) ** 2 * STEP**2 / 8
    np.testing.assert_allclose(look(line.guide, x, y, yaw, AHEAD), expected, atol=1.01 * bound)


@given(st.floats(-50, 150), st.floats(-5, 5), st.floats(-3, 3))
def test_mirrored_lines_look_mirrored(x, y, yaw):
    flipped = Line(tuple((a, b, -c) for a, b, c in SWINGS))
    np.testing.assert_array_equal(look(flipped.guide, x, -y, -yaw, AHEAD), -look(Line(SWINGS).guide, x, y, yaw, AHEAD))
    for straight in (0.0, 30.0):
        left, right = Circle(80.0, straight), Circle(-80.0, straight)
        np.testing.assert_array_equal(look(right.guide, x, -y, -yaw, AHEAD), -look(left.guide, x, y, yaw, AHEAD))


@pytest.mark.parametrize("radius", [100.0, -60.0])
@pytest.mark.parametrize("angle", [0.0, 1.0, 3.0, -2.0])
def test_a_circle_is_a_circle_wherever_one_is_on_it(radius, angle):
    circle, side = Circle(radius), math.copysign(1.0, radius)
    x, y = abs(radius) * math.sin(angle), radius * (1 - math.cos(angle))
    there, yaw = (np.array([x]), np.array([y])), side * angle
    assert circle.stray(*there) == pytest.approx(0, abs=1e-12)
    assert circle.heading(*there) == pytest.approx(yaw, abs=1e-12)
    # Along an arc s the circle lies R (1 - cos(s/R)) aside of its tangent.
    np.testing.assert_allclose(look(circle.guide, x, y, yaw, AHEAD), radius * (1 - np.cos(AHEAD / radius)), atol=1e-9)
    inward = 0.99
    inside = circle.stray(np.array([inward * x]), radius + inward * (np.array([y]) - radius))
    assert inside == pytest.approx(side * 0.01 * abs(radius))


@given(st.floats(-100, 100), st.floats(-100, 100))
def test_one_point_strays_as_it_does_among_many(x, y):
    for path in (Line(SWINGS), Circle(80.0), Circle(-80.0, 20.0), STRAIGHT):
        (many,) = path.stray(np.array([x]), np.array([y]))
        assert stray(path.guide, x, y) == pytest.approx(many, abs=1e-3)  # the table's chords
        for room in (0.5, 5.0):
            assert strayed_beyond(path.guide, room, x, y) == (abs(stray(path.guide, x, y)) > room)


def test_a_bend_begins_where_its_straight_ends():
    bend = Circle(50.0, straight=30.0)
    assert not look(bend.guide, 0.0, 0.0, 0.0, np.array([1.0, 29.9])).any()
    assert look(bend.guide, 0.0, 0.0, 0.0, np.array([40.0]))[0] == pytest.approx(50 * (1 - math.cos(10 / 50)))
    assert bend.stray(np.array([10.0]), np.array([0.4])) == pytest.approx(0.4)


@pytest.mark.parametrize("x", [1e300, -1e300])
def test_a_car_at_the_end_of_the_world_still_looks(x):
    for path in (Line(SWINGS), Circle(80.0), Circle(80.0, 20.0)):
        assert np.abs(look(path.guide, x, -x, 1.0, AHEAD)).max() < 2e6  # from 1000 km out
