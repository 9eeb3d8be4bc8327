"""From a yaw moment to wheel brakes."""

import math

import numpy as np
from numpy.typing import ArrayLike

from vse_gym.compiled import compiled
from vse_gym.types import Array

SLOWEST = 4.0  # no stability control below this speed [m/s]
SMALLEST = 50.0  # nor for a moment below this [N m]


@compiled
def largest_moment(g):
    """The yaw moment of one side's brakes at their caps, straight ahead [N m]."""
    return 0.5 * (g.track_front * g.brake_cap_front + g.track_rear * g.brake_cap_rear) / g.wheel_radius


@compiled
def allocate(g, moment, vx, yaw_rate, steer):
    """Brake torques (4,) [N m] for a yaw moment, positive left.

    The moment's side brakes. Against oversteer (moment against the yaw rate) that is the outer side: its front wheel
    first, the remainder at its rear wheel. Against understeer it is the inner rear wheel alone.
    """
    torques = np.zeros(4)
    if vx < SLOWEST or abs(moment) < SMALLEST:
        return torques
    left = moment > 0
    front, rear = (0, 2) if left else (1, 3)
    demand = abs(moment)
    rear_arm = 0.5 * g.track_rear
    if moment * yaw_rate < 0:
        lean = g.lf * math.sin(steer)
        arm = 0.5 * g.track_front * math.cos(steer) + (-lean if left else lean)
        if arm > 0.1:
            torques[front] = min(g.brake_cap_front, demand / arm * g.wheel_radius)
            if torques[front] < g.brake_cap_front:
                return torques  # nothing remains, and no rounding either
            demand -= torques[front] * arm / g.wheel_radius
    torques[rear] = min(g.brake_cap_rear, demand / rear_arm * g.wheel_radius)
    return torques


@compiled
def let_go(moment, vx, whole):
    """Shares (4,) of the driver's torque to release for a yaw moment [N m], positive left: those of the other side.

    All of it from a moment of ``whole`` on. On split friction braking more turns nothing, braking less does.
    """
    release = np.zeros(4)
    if vx >= SLOWEST and abs(moment) >= SMALLEST:
        front, rear = (1, 3) if moment > 0 else (0, 2)
        release[front] = release[rear] = min(1.0, abs(moment) / whole)
    return release


@compiled
def agent_demand(g, base_added, base_release, action, yaw_moment, vx, yaw_rate, steer):
    """A controller's demand with an agent's action on top: torques to add and shares to release, (4,) and (4,).

    Args:
        g: Geometry.
        base_added, base_release: What the controller asks for, (4,) each.
        action: In [-1, 1], clipped to it: one number for a yaw moment, else one per wheel.
        yaw_moment: Which of the two.
        vx, yaw_rate, steer: As estimated and measured, for the allocation.
    """
    added, release = np.empty(4), base_release.copy()
    if yaw_moment:
        extra = allocate(g, max(-1.0, min(1.0, action[0])) * largest_moment(g), vx, yaw_rate, steer)
    else:
        extra = np.zeros(4)
    for i in range(4):
        cap = g.brake_cap_front if i < 2 else g.brake_cap_rear
        if not yaw_moment:
            extra[i] = max(0.0, min(1.0, action[i])) * cap
            release[i] = max(release[i], min(1.0, -action[i]))
        added[i] = min(cap, max(0.0, base_added[i]) + extra[i])
    return added, release


def as_torques(added: ArrayLike, release: ArrayLike) -> tuple[Array, Array]:
    """A demand as kernels take it, (4,) and (4,) floats; whoever wrote the controller may have used lists.

    Raises:
        ValueError: If it has another shape or is not finite.
    """
    both = np.array((added, release), dtype=float)
    if both.shape != (2, 4) or not math.isfinite(sum(both.ravel().tolist())):
        raise ValueError(f"a brake demand is four finite torques and four shares, not {added!r} and {release!r}")
    return both[0], both[1]
