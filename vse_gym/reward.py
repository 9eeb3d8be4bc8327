"""What a step of a drive is worth to an agent, and what the drive has cost so far: from true states."""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.controllers.reference import Reference, follow_reference
from vse_gym.physics.parameters import AY, GRAVITY, VX, VY, YAW_RATE
from vse_gym.types import SLOW, Array

# The reward's weights, and the size of each error at which its term is full
SIDESLIP, TURNING, BRAKE, SPEED = 0.2, 0.3, 0.1, 0.4
FULL_SIDESLIP, FULL_YAW_RATE = math.radians(10), math.radians(20)

PEAK, SQUARES, MOVING, INTERVENTION = range(4)  # of the totals


class Worth(NamedTuple):
    """What the reward is measured by."""

    reference: Reference  # what the driver is taken to want
    caps: Array  # largest brake torque of each wheel, (4,) [N m]
    start: float  # speed at the start [m/s]
    braking: float  # deceleration for each newton metre of the driver's brake torque, of the true car [1/(kg m)]
    dt: float  # [s]


def reward_memory(worth: Worth) -> Array:
    """What :func:`step_reward` remembers, at the start of a drive."""
    return np.array([0.0, worth.start])


@compiled
def step_reward(constants, memory, state, steer, added, brake, friction):
    """The reward of a step, in [-1, 1]; what an early end costs comes on top.

    Args:
        constants: The Worth, held.
        memory: The yaw rate that the driver wants, within what the road bears [rad/s]: an envelope of the car's own ay
            would let an agent off that does not let it turn. And the speed that he wants [m/s]: his first until he
            brakes, then what the road lets him have. (2,)
        state: Of the plant after the step, (STATE_SIZE,).
        steer: True road-wheel angle [rad].
        added: Torques that were asked for, (4,) [N m].
        brake: The driver's torques, (4,) [N m].
        friction: Of the road [-].

    Returns:
        reward, and the memory one step on.
    """
    worth = constants.value
    vx, vy = state[VX], state[VY]
    after = np.empty(2)
    slowing = min(worth.braking * (brake[0] + brake[1] + brake[2] + brake[3]), friction * GRAVITY)
    after[1] = max(0.0, memory[1] - worth.dt * slowing)
    apart = after[1] - math.hypot(vx, vy)
    if after[1] == worth.start:  # who has not braked may well drive faster
        apart = max(0.0, apart)
    r = worth.reference
    within = Reference(r.wheelbase, r.understeer, friction, r.lag, r.release, r.dt)
    after[0], _ = follow_reference(within, memory[0], np.inf, vx, state[AY], steer)
    braked = 0.0
    for i in range(4):
        braked += added[i] / worth.caps[i]
    cost = (
        SIDESLIP * min(1.0, abs(math.atan2(vy, max(vx, 1.0))) / FULL_SIDESLIP)
        + TURNING * min(1.0, abs(state[YAW_RATE] - after[0]) / FULL_YAW_RATE)
        + BRAKE * 0.25 * braked
        + SPEED * min(1.0, abs(apart) / worth.start)
    )
    return (1 - 2 * cost if math.isfinite(vx + vy + state[YAW_RATE]) else -1.0), after


@compiled
def tally(constants, totals, state, motion, added, release):
    """Totals of a drive one step on, (4,): largest sideslip [rad], squares of its error, steps that it was measured
    in, and time of intervention [s].

    Args:
        constants: The Worth, held.
        totals: Before, zeros at the start.
        state: Of the plant, (STATE_SIZE,).
        motion: Estimated vx and vy come first.
        added, release: What the stability control asked for, (4,) each.
    """
    after = totals.copy()
    vx, vy = state[VX], state[VY]
    if math.hypot(vx, vy) > SLOW:
        sideslip = math.atan2(vy, vx)
        error = math.atan2(motion[1], motion[0]) - sideslip
        error -= 2 * math.pi * np.rint(error / (2 * math.pi))
        after[MOVING] += 1
        after[PEAK] = max(after[PEAK], abs(sideslip))
        after[SQUARES] += error * error
    asked = 0.0
    for i in range(4):
        asked += abs(added[i]) + abs(release[i])
    if asked > 0.0:
        after[INTERVENTION] += constants.value.dt
    return after
