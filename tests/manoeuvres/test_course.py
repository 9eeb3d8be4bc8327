"""Cones and gates against plane geometry, brute force and symmetry."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.manoeuvres.course import CONE, Course, Lane, clearances, course_of, distance_to_body, gates_missed, outline
from vse_gym.physics import parameters as p
from vse_gym.vehicles import load

CAR = load("qin2014")
NOSE, TAIL, SIDE = outline(CAR)
NO_GATE = np.zeros((0, 2, 2))
NO_LINE = np.zeros((0, 2))


def drive(x, y, yaw=0.0):
    """A log's truth of which only the position matters."""
    truth = np.zeros((len(np.atleast_1d(x)), p.STATE_SIZE))
    truth[:, p.X], truth[:, p.Y], truth[:, p.YAW] = x, y, yaw
    return truth


def cones(*points, radius=CONE):
    return Course(np.array(points, dtype=float), radius, NO_GATE, NO_LINE)


def test_the_outline_is_the_body_over_its_overhangs():
    assert pytest.approx(CAR.wheelbase + CAR.front_overhang + CAR.rear_overhang) == NOSE - TAIL
    assert CAR.lf + CAR.front_overhang == NOSE and CAR.width == 2 * SIDE


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((NOSE + 1, 0), 1.0),
        ((TAIL - 1, 0.3), 1.0),
        ((0, SIDE + 0.5), 0.5),
        ((0.2, -SIDE - 0.5), 0.5),
        ((NOSE + 3, SIDE + 4), 5.0),  # 3, 4, 5 from the corner
        ((NOSE, 0), 0.0),
        ((0, SIDE - 0.2), -0.2),
        ((NOSE - 0.1, 0), -0.1),
    ],
)
@pytest.mark.parametrize("turn", [0.0, 0.7, -2.5])
def test_distance_to_the_body_by_plane_geometry(point, expected, turn):
    c, s = math.cos(turn), math.sin(turn)
    moved = np.array([7 + c * point[0] - s * point[1], -3 + s * point[0] + c * point[1]])
    pose = np.array([7.0, -3.0, turn])
    assert distance_to_body(CAR, pose, moved) == pytest.approx(expected, abs=1e-12)


def test_a_cone_beside_the_way_is_hit_when_its_base_reaches_the_side():
    x = np.linspace(0, 40, 201)
    for beside, hit in ((SIDE + CONE + 1e-6, False), (SIDE + CONE - 1e-3, True), (-SIDE - CONE + 1e-3, True)):
        (room,) = clearances(cones((20.0, beside)), CAR, drive(x, 0.0))
        assert room == pytest.approx(abs(beside) - SIDE - CONE, abs=1e-9)
        assert (room <= 0) == hit


def test_a_corner_that_sweeps_a_cone_between_two_instants_hits_it():
    # The car turns about its centre by 90 deg between two instants; the nose's corner passes by a cone that it touches
    # at neither.
    reach = math.hypot(NOSE, SIDE)
    at = math.atan2(SIDE, NOSE) + 0.6
    spin = drive([0.0, 0.0], [0.0, 0.0], [0.0, 1.2])
    for far, hit in ((reach + CONE - 0.01, True), (reach + CONE + 0.01, False)):
        (room,) = clearances(cones((far * math.cos(at), far * math.sin(at))), CAR, spin)
        assert (room <= 0) == hit


@given(
    st.lists(st.tuples(st.floats(-8, 8), st.floats(-8, 8)), min_size=1, max_size=6),
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-1, 1)), min_size=1, max_size=4),
)
def test_clearances_are_what_brute_force_finds(points, poses):
    # A thousand looks between two instants, against the bound's choice of where to look: the steps are at most 11 mm.
    truth = drive(*np.array(poses).T)
    pose = truth[:, [p.X, p.Y, p.YAW]]
    fine = [pose[0]] + [a + s * (b - a) for a, b in pairwise(pose) for s in np.linspace(0, 1, 1001)]
    brute = np.array([distance_to_body(CAR, np.array(fine), np.array(c)).min() for c in points]) - CONE
    # Distances change by no more than the outline moves between two looks, 10 mm at most in either.
    np.testing.assert_allclose(clearances(cones(*points), CAR, truth), brute, atol=0.011)


@given(st.lists(st.tuples(st.floats(-5, 60), st.floats(-4, 4), st.floats(-1, 1)), min_size=2, max_size=5))
def test_a_mirrored_drive_past_mirrored_cones_keeps_its_distances(poses):
    course = course_of((Lane(10.0, 20.0, 0.5, 2.4), Lane(35.0, 50.0, -1.0, 3.0)), NO_LINE)
    flip = course._replace(cones=course.cones * [1, -1], gates=(course.gates * [1, -1])[:, ::-1])
    x, y, yaw = np.array(poses).T
    np.testing.assert_array_equal(clearances(course, CAR, drive(x, y, yaw)), clearances(flip, CAR, drive(x, -y, -yaw)))
    assert gates_missed(course, drive(x, y)) == gates_missed(flip, drive(x, -y))


def test_a_lane_is_clear_between_its_cones_and_has_a_gate_at_either_end():
    lane = Lane(10.0, 22.0, 1.0, 2.5)
    course = course_of((lane,), NO_LINE)
    left, right = course.cones[course.cones[:, 1] > 1], course.cones[course.cones[:, 1] < 1]
    assert left[:, 1].min() - course.radius == pytest.approx(1 + 1.25)
    assert right[:, 1].max() + course.radius == pytest.approx(1 - 1.25)
    for row in (left, right):
        assert row[0, 0] == 10 and row[-1, 0] == 22 and np.diff(row[:, 0]).max() <= 5
    assert course.gates[:, 0, 0].tolist() == course.gates[:, 1, 0].tolist() == [10, 22]


@pytest.mark.parametrize(
    ("way", "missed"),
    [
        ([(0, 0), (40, 0)], 0),
        ([(0, 0), (9, 0), (10, 3), (40, 3)], 2),  # beside both
        ([(0, 0), (15, 0), (20, 2), (40, 2)], 1),
        ([(0, 0), (15, 0)], 1),  # never there
        ([(40, 0), (0, 0)], 2),  # backwards
        ([(0, 0)], 2),
        ([(0, 1.3), (40, 1.3)], 2),
        ([(0, 1.2), (40, 1.2)], 0),
    ],
)
def test_a_gate_is_missed_by_who_goes_beside_it_backwards_or_not_at_all(way, missed):
    course = course_of((Lane(10.0, 20.0, 0.0, 2.5),), NO_LINE)
    assert gates_missed(course, drive(*np.array(way, dtype=float).T)) == missed


def test_what_is_not_finite_is_left_out_and_nothing_at_all_is_a_hit():
    truth = drive([0.0, 1.0, np.nan], [0.0, 0.0, np.nan])
    course = cones((0.5, 5.0))
    np.testing.assert_array_equal(clearances(course, CAR, truth), clearances(course, CAR, truth[:2]))
    assert np.isnan(clearances(course, CAR, truth[2:])).all()
