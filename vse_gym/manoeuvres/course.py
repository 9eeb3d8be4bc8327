"""Courses of cones and gates, and whether a car's outline touched them."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.physics import parameters as p
from vse_gym.types import Array

CONE = 0.15  # radius of a cone's base (chosen) [m]
SPACING = 5.0  # largest distance between the cones along a lane (chosen) [m]
FINE = 0.01  # the outline moves no farther than this between two looks at a cone [m]


class Course(NamedTuple):
    """Where the car must go; points are (x, y) on the ground."""

    cones: Array  # centres of their bases, (N, 2) [m]
    radius: float  # of their bases [m]
    gates: Array  # ends of each, the left one first, as the car comes, (G, 2, 2) [m]
    line: Array  # that the driver follows, (K, 2) [m]


class Lane(NamedTuple):
    """A stretch between two rows of cones."""

    begin: float  # x [m]
    end: float  # x [m]
    centre: float  # y [m]
    width: float  # clear between the cones [m]


def course_of(lanes: tuple[Lane, ...], line: Array) -> Course:
    """Cones on both sides of each lane, bases touching it from outside; gates where it begins and ends."""
    cones, gates = [], []
    for lane in lanes:
        half = 0.5 * lane.width
        count = 1 + max(1, math.ceil((lane.end - lane.begin) / SPACING - 1e-9))
        for x in np.linspace(lane.begin, lane.end, count).tolist():
            cones += [(x, lane.centre + half + CONE), (x, lane.centre - half - CONE)]
        gates += [((x, lane.centre + half), (x, lane.centre - half)) for x in (lane.begin, lane.end)]
    return Course(np.array(cones), CONE, np.array(gates), line)


def outline(vehicle: p.Vehicle) -> tuple[float, float, float]:
    """Of a car's body, from the centre of gravity: nose and tail along, half of its width across [m]."""
    return vehicle.lf + vehicle.front_overhang, -vehicle.lr - vehicle.rear_overhang, 0.5 * vehicle.width


def distance_to_body(vehicle: p.Vehicle, pose: Array, points: Array) -> Array:
    """Distance from points (..., 2) to the body of a car at poses x, y, yaw (..., 3); negative inside [m]."""
    nose, tail, side = outline(vehicle)
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    dx, dy = points[..., 0] - pose[..., 0], points[..., 1] - pose[..., 1]
    along, across = cos * dx + sin * dy, cos * dy - sin * dx
    past_end, past_side = np.maximum(along - nose, tail - along), np.abs(across) - side
    outside = np.hypot(np.maximum(past_end, 0.0), np.maximum(past_side, 0.0))
    out: Array = np.where(outside > 0, outside, np.maximum(past_end, past_side))
    return out


def clearances(course: Course, vehicle: p.Vehicle, truth: Array) -> Array:
    """Least distance between each cone's base and the car's body in a drive (T, STATE_SIZE), (N,) [m].

    Not above 0: the cone was hit. Between two instants the car is taken to move evenly, which at 10 ms and 1 g is right
    within 0.1 mm, and looked at so often that a hit less than FINE^2/(8 radius) = 0.1 mm deep may be missed.
    """
    pose = truth[:, [p.X, p.Y, p.YAW]]
    pose = pose[np.all(np.isfinite(pose), axis=1)]
    if not len(pose):
        return np.full(len(course.cones), np.nan)
    distance = distance_to_body(vehicle, pose[:, None], course.cones[None])
    least = distance.min(axis=0)
    nose, tail, side = outline(vehicle)
    step = np.diff(pose, axis=0)
    moved = np.hypot(step[:, 0], step[:, 1]) + np.abs(step[:, 2]) * math.hypot(max(nose, -tail), side)
    # No point of the body moves farther than ``moved``, so that the distance cannot be less than this in between
    bound = 0.5 * (distance[:-1] + distance[1:] - moved[:, None])
    for k, cone in zip(*np.nonzero(bound < least), strict=True):
        share = np.linspace(0.0, 1.0, 1 + math.ceil(moved[k] / FINE))[:, None]
        between = distance_to_body(vehicle, pose[k] + share * step[k], course.cones[cone])
        least[cone] = min(least[cone], between.min())
    room: Array = least - course.radius
    return room


def gates_missed(course: Course, truth: Array) -> int:
    """How many gates the centre of gravity did not pass forwards between their ends, in a drive (T, STATE_SIZE)."""
    way = truth[:, [p.X, p.Y]]
    left, across = course.gates[:, 0], course.gates[:, 1] - course.gates[:, 0]
    to = way[:, None] - left[None]  # (T, G, 2)
    beyond = across[:, 0] * to[..., 1] - across[:, 1] * to[..., 0]
    share = np.sum(to * across, axis=-1) / np.sum(across**2, axis=-1)
    crossing = (beyond[:-1] < 0) & (beyond[1:] >= 0)
    part = np.divide(-beyond[:-1], beyond[1:] - beyond[:-1], where=crossing, out=np.zeros_like(beyond[1:]))
    where = share[:-1] + part * (share[1:] - share[:-1])
    passed = np.any(crossing & (where >= 0) & (where <= 1), axis=0)
    return int(np.sum(~passed))
