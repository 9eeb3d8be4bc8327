"""The form in which an agent's net sees an observation and answers: typical sizes, one side, asleep going straight.

Three things are built in that a net need not learn, the same in training and in a trained policy:

- Every feature is centred and divided by a typical size, so that all are of order one: the limits of an observation are
  what an estimator may say at worst, and most of what a drive shows is a hundredth of them.
- Left and right: an observation in which the driver wants to turn right is mirrored, and the answer mirrored back. So
  what an agent does to one side it does to the other, and it learns from both at once.
- Where the car goes straight and shall, the answer counts for nothing, and for more as yaw rate or sideslip grow: noise
  alone brakes nobody.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled, hold
from vse_gym.controllers.observation import LAYOUTS
from vse_gym.types import Array

ACTIONS = {"brakes": 4, "yaw_moment": 1}  # kinds, and how many numbers each is
REACH = 5.0  # where a feature is cut off, in typical sizes
DEG = math.pi / 180
ASLEEP, AWAKE = 2 * DEG, 5 * DEG  # yaw rate, as it is or is wanted, below which the answer is 0, and from which whole
SLIDING, SLID = 1 * DEG, 3 * DEG  # the same of the sideslip angle

# Chosen: what a hard manoeuvre reaches, and for speeds the middle of their range and its width
SPEED = (20.0, 10.0)  # [m/s]
TYPICAL: dict[str, tuple[float, float]] = {
    "vx": SPEED,
    "vy": (0.0, 2.0),
    "yaw_rate": (0.0, 0.5),
    "ax": (0.0, 5.0),
    "ay": (0.0, 5.0),
    "sideslip": (0.0, 0.1),
    "vx_std": (0.0, 1.0),
    "vy_std": (0.0, 1.0),
    "yaw_rate_std": (0.0, 0.1),
    "steer": (0.0, 0.1),
    "reference_yaw_rate": (0.0, 0.5),
    "speed": SPEED,
    "roll_rate": (0.0, 0.3),
    **{f"wheel_{w}": (65.0, 33.0) for w in ("fl", "fr", "rl", "rr")},  # SPEED on wheels of 0.31 m [rad/s]
}
# Features that change their sign in the mirror; the first that is not 0 decides which side it is
ODD = ("reference_yaw_rate", "yaw_rate", "sideslip", "vy", "ay", "steer", "roll_rate")
ACROSS = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}


class Canonical(NamedTuple):
    """A layout of observations and a kind of action, for compiled code."""

    middle: Array  # (k,)
    size: Array  # (k,)
    sign: Array  # of a feature in the mirror, (k,)
    partner: NDArray[np.int64]  # which feature it is there, (k,)
    deciding: NDArray[np.int64]  # odd features, in the order of ODD
    turning: NDArray[np.int64]  # yaw rate and its reference, (2,)
    sideslip: int  # or -1 where the layout has none that an estimator made
    action_sign: float
    action_partner: NDArray[np.int64]  # (m,)


@compiled
def to_canonical(form, observation):
    """What the net sees, (k,) float32; the side, 1 or -1; and how much its answer counts, in [0, 1]."""
    side = 1.0
    for i in form.deciding:
        if observation[i] != 0.0:
            side = math.copysign(1.0, observation[i])
            break
    seen = np.empty(observation.size, np.float32)
    for i in range(observation.size):
        value = observation[i] if side > 0 else form.sign[i] * observation[form.partner[i]]
        seen[i] = min(REACH, max(-REACH, (value - form.middle[i]) / form.size[i]))
    turning = max(abs(observation[form.turning[0]]), abs(observation[form.turning[1]]))
    counts = (turning - ASLEEP) / (AWAKE - ASLEEP)
    if form.sideslip >= 0:
        counts = max(counts, (abs(observation[form.sideslip]) - SLIDING) / (SLID - SLIDING))
    return seen, side, min(1.0, max(0.0, counts))


@compiled
def from_canonical(form, answer, side, counts):
    """The action, (m,) float32, that a net's answer (m,) in [-1, 1] stands for."""
    action = np.empty(answer.size, np.float32)
    for i in range(answer.size):
        value = answer[i] if side > 0 else form.action_sign * answer[form.action_partner[i]]
        action[i] = counts * value
    return action


@compiled
def all_to_canonical(held, observations):
    """:func:`to_canonical` of rows: (n, k), (n,) and (n,)."""
    rows = observations.shape[0]
    seen = np.empty(observations.shape, np.float32)
    side, counts = np.empty(rows), np.empty(rows)
    for i in range(rows):
        seen[i], side[i], counts[i] = to_canonical(held.value, observations[i])
    return seen, side, counts


@compiled
def all_from_canonical(held, answers, side, counts):
    """:func:`from_canonical` of rows, (n, m)."""
    actions = np.empty(answers.shape, np.float32)
    for i in range(answers.shape[0]):
        actions[i] = from_canonical(held.value, answers[i], side[i], counts[i])
    return actions


@cache
def canonical(layout: str, action: str) -> Canonical:
    """The form of a layout of observations and a kind of action.

    Raises:
        ValueError: If there is no such layout or kind.
    """
    if layout not in LAYOUTS:
        raise ValueError(f"observation must be one of {', '.join(LAYOUTS)}, not {layout!r}")
    if action not in ACTIONS:
        raise ValueError(f"action must be one of {', '.join(ACTIONS)}, not {action!r}")
    names = [feature.name for feature in LAYOUTS[layout]]
    middle, size = (np.array(column) for column in zip(*(_typical(layout, name) for name in names), strict=True))
    return Canonical(
        middle,
        size,
        np.array([-1.0 if name in ODD else 1.0 for name in names]),
        np.array([names.index(_mirrored(name)) for name in names]),
        np.array([names.index(name) for name in ODD if name in names]),
        np.array([names.index("yaw_rate"), names.index("reference_yaw_rate")]),
        names.index("sideslip") if layout != "reading" else -1,
        -1.0 if action == "yaw_moment" else 1.0,
        np.array([0] if action == "yaw_moment" else [1, 0, 3, 2]),
    )


@cache
def held_canonical(layout: str, action: str) -> Any:
    """:func:`canonical`, held for compiled code."""
    return hold(canonical(layout, action))


def _typical(layout: str, name: str) -> tuple[float, float]:
    return (0.0, 1.0) if name.endswith("_valid") else TYPICAL[name]


def _mirrored(name: str) -> str:
    kind, _, rest = name.partition("_")
    wheel, _, valid = rest.partition("_")
    return name if kind != "wheel" else "_".join(word for word in (kind, ACROSS[wheel], valid) if word)
