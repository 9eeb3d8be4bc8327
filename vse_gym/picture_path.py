"""The picture of where a car went: its outline, the course with its cones and gates, and what the road was like."""

import math
from typing import Any

import numpy as np

from vse_gym.manoeuvres.course import Course, clearances, outline
from vse_gym.physics import parameters as p
from vse_gym.scenarios import Scenario
from vse_gym.types import Array, Log

BRAKES_ON = 50.0  # torque from which an outline is drawn as braking [N m]
EVERY = 0.5  # between two outlines [s]
APART = 1.0  # at least between them [m]
LEAST_HEIGHT = 7.0  # that a straight drive is given, so that the car can be seen [m]
STRETCH = 4.0  # at most so much wider than true is a long way drawn [-]
PAGE = 6.7  # width of the panel over its height


def draw_path(axes: Any, log: Log, scenario: Scenario) -> None:
    """The way of the centre of gravity, and the car's outline every half second, on the course and the road."""
    x, y, yaw = (log.truth[:, k] for k in (p.X, p.Y, p.YAW))
    axes.plot(x, y, color="black", lw=1, label="path, the car every 0.5 s", zorder=3)
    nose, tail, side = outline(scenario.vehicle)
    body = np.array([[nose, side], [nose, -side], [tail, -side], [tail, side]])
    braked, last = False, -math.inf
    for k in range(0, len(x), max(1, round(EVERY / scenario.dt))):
        if log.truth[k, p.DISTANCE] - last < APART:
            continue
        last = log.truth[k, p.DISTANCE]
        c, s = math.cos(yaw[k]), math.sin(yaw[k])
        turned = body @ np.array([[c, s], [-s, c]])
        braking = bool(log.brake[k].max() > BRAKES_ON)
        braked |= braking
        axes.fill(x[k] + turned[:, 0], y[k] + turned[:, 1], color="C3" if braking else "0.5", alpha=0.5, lw=0, zorder=2)
    if braked:
        axes.fill([], [], color="C3", alpha=0.5, lw=0, label="with brakes on")
    course = scenario.manoeuvre.course(scenario.vehicle)
    if course is not None:
        _cones(axes, course, clearances(course, scenario.vehicle, log.truth))
    _road(axes, log, scenario.manoeuvre.road())
    low, high = _frame(axes, x, y, course)
    _scale(axes, low, high)
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("y [m]")


def _cones(axes: Any, course: Course, room: Array) -> None:
    axes.plot(*course.line.T, ":", color="C0", lw=1, label="line to follow")
    for k, gate in enumerate(course.gates):
        axes.plot(*gate.T, color="C2", lw=0.8, alpha=0.7, label="gate" if k == 0 else None)
    for cones, colour, label in (
        (course.cones[room > 0], "C1", "cone"),
        (course.cones[~(room > 0)], "C3", "cone, hit"),
    ):
        if len(cones):
            axes.plot(*cones.T, "^", color=colour, markersize=5, mec="black", mew=0.4, label=label, zorder=4, lw=0)


def _road(axes: Any, log: Log, road: p.Road) -> None:
    """Where friction is less than the most at the start, left and right of the path: shaded, and named."""
    way = log.truth[:, p.DISTANCE]
    ends = np.append(road.start[1:], np.inf)
    most = max(road.friction_left[0], road.friction_right[0])
    x, y, yaw = (log.truth[:, k] for k in (p.X, p.Y, p.YAW))
    for begin, end, *sides in zip(road.start, ends, road.friction_left, road.friction_right, strict=True):
        here = (way >= begin) & (way <= end)
        if not here.any():
            continue
        alike = sides[0] == sides[1]
        for friction, sign in ((sides[0], 1.0), (sides[1], -1.0)):
            if friction >= most:
                continue
            far = sign * 3.5
            edge_x = np.concatenate((x[here], (x - far * np.sin(yaw))[here][::-1]))
            edge_y = np.concatenate((y[here], (y + far * np.cos(yaw))[here][::-1]))
            named = f"friction {friction:g}" + ("" if alike else (" to the left" if sign > 0 else " to the right"))
            label = None if alike and sign < 0 else named
            axes.fill(edge_x, edge_y, color="C9", alpha=0.25, lw=0, zorder=1, label=label)


def _frame(axes: Any, x: Array, y: Array, course: Course | None) -> tuple[Array, Array]:
    """Corners of what must be seen, with some air around it."""
    points = [np.column_stack((x, y))]
    if course is not None:
        points += [course.cones, course.gates.reshape(-1, 2)]
    seen = np.concatenate(points)
    seen = seen[np.all(np.isfinite(seen), axis=1)]
    low, high = seen.min(axis=0) - [4.0, 2.0], seen.max(axis=0) + [4.0, 2.0]
    short = max(0.0, LEAST_HEIGHT - (high[1] - low[1])) / 2
    return low - [0.0, short], high + [0.0, short]


def _scale(axes: Any, low: Array, high: Array) -> None:
    """True to scale where that fills the panel; a long, narrow way is drawn wider than true, and the title says so."""
    width, height = high - low
    stretch = min(STRETCH, max(1.0, width / (height * PAGE)))
    more = np.array([max(0.0, stretch * height * PAGE - width), max(0.0, width / (stretch * PAGE) - height)]) / 2
    axes.set_xlim(low[0] - more[0], high[0] + more[0])
    axes.set_ylim(low[1] - more[1], high[1] + more[1])
    axes.set_aspect(stretch, adjustable="box")
    if stretch > 1.05:
        axes.set_title(f"across {stretch:.1f} times as large as along", fontsize=8, loc="left")
