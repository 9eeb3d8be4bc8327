"""A drive's script, and the driver who acts it out step by step, in compiled code."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.manoeuvres.path import Guide, look
from vse_gym.physics.parameters import AY, VX, VY, YAW, YAW_RATE, X, Y
from vse_gym.types import Array

HOLD, FOLLOW, TURN_TO, TURN_ON = 0, 1, 2, 3  # what hands do
SLOWEST, FASTEST = 3, 60  # speeds that the driver has practised, every metre per second between them [m/s]
FASTEST_TURN = 10.0  # a car that turns faster is felt as if it turned so fast [rad/s]
# How the driver holds a speed (chosen). He reads a needle: a drive torque that followed the speed exactly would tell
# estimators, who know the torque, what no sensor does.
NEEDLE = 2 / 3.6  # speed to which the speedometer can be read [m/s]
STRONGEST = 2.5  # acceleration for which he presses at most [m/s2]
EAGER = 2.0  # acceleration that he wants for each metre per second too slow [1/s]
ANGLE, PRESSED, PENDING = 0, 1, 2  # places in the driver's memory; what is pending goes on to its end


class Script(NamedTuple):
    """What the driver does in each control step, (steps,) each, and two cues that he takes from the car."""

    hands: NDArray[np.int64]  # HOLD the hand wheel, FOLLOW the line, TURN_TO an angle, or TURN_ON at a rate
    hand_wheel: Array  # that angle, positive to the left [rad], or that rate [rad/s]
    speed: Array  # held with the accelerator; NaN: none is held [m/s]
    acceleration: Array  # for which the accelerator stands where no speed is held; 0: the foot is off [m/s2]
    deceleration: Array  # for which the brakes are pressed [m/s2]
    lifts: float = math.inf  # the foot leaves the accelerator beyond this x [m]
    stops: float = math.inf  # hands no longer turn on where the lateral acceleration is as large as this [m/s2]


def script_of(
    times: Array,
    hands: int | NDArray[np.int64] = HOLD,
    hand_wheel: float | Array = 0.0,
    speed: float | Array = math.nan,
    acceleration: float | Array = 0.0,
    deceleration: float | Array = 0.0,
    lifts: float = math.inf,
    stops: float = math.inf,
) -> Script:
    """A script from columns, or from numbers that hold all the time.

    Raises:
        ValueError: If a column has not one entry for each of the times.
    """
    column = partial(np.full, times.shape, dtype=np.float64)
    return Script(
        np.full(times.shape, hands, np.int64),
        column(hand_wheel),
        column(speed),
        column(acceleration),
        column(deceleration),
        float(lifts),
        float(stops),
    )


def ramp(times: Array, angle: float, rate: float, begin: float) -> Array:
    """A hand wheel that turns at a rate from a time on, until it has got to an angle, (steps,) [rad]."""
    return np.copysign(np.minimum(abs(angle), rate * np.maximum(0.0, times - begin)), angle)


def sine(angles: Array) -> Array:
    """Of each angle [rad], by the C library: NumPy's own may differ in its last bit from machine to machine."""
    return np.array([math.sin(angle) for angle in angles.tolist()])


class Arms(NamedTuple):
    """How the driver steers along a line, all angles those of the hand wheel."""

    gains: Array  # (speeds, preview points + 3 + angles pending), see vse_gym.manoeuvres.driver.practised
    reach: Array  # times of the preview points, (points,) [s]
    follow: float  # share of the way to the wanted angle that the arms make in a step [-]
    most: float  # change of the angle that they can make in a step [rad]
    limit: float  # of the angle [rad]


class Pedals(NamedTuple):
    """Torque at each wheel for an acceleration, and for a deceleration, of 1 m/s2 on a level road, (4,) [N m s2/m].

    The brakes are balanced as the wheels' loads are at 0.8 g (chosen), so that the front ones lock first below it.
    """

    drive: Array
    brake: Array
    follow: float  # share of the way to what he wants that the driver's foot makes in a step [-]


class Task(NamedTuple):
    """All that stays the same in a drive of one car: what its driver has to do, and with what."""

    script: Script
    guide: Guide  # that hands follow
    arms: Arms
    pedals: Pedals
    bounds: Guide  # the drive is over
    room: float  # farther from it than this [m]
    dt: float  # of a control step [s]


def first_memory(task: Task) -> Array:
    """The driver's memory at the start: hands at rest on a straight hand wheel, the foot off the accelerator."""
    return np.zeros(PENDING + max(0, task.arms.gains.shape[1] - task.arms.reach.size - 3))


@compiled
def steer(arms, guide, memory, state, after):
    """One step of optimal preview steering with a reaction delay, a lag, and arms of finite speed and reach.

    What he sees and feels is decided on now, and put into ``after`` as the last of the pending angles; the hands go
    towards the oldest of them. The weights are interpolated between the two practised speeds.

    Args:
        arms: The driver's.
        guide: The line.
        memory: Hand-wheel angle [rad], place of the accelerator, pending angles, the oldest first [rad].
        state: Of the plant, (STATE_SIZE,).
        after: The memory one step on, which is written.
    """
    points, waiting = arms.reach.size, memory.size - PENDING
    speed = min(max(state[VX], float(SLOWEST)), float(FASTEST))
    low = min(int(speed) - SLOWEST, FASTEST - SLOWEST - 1)
    between = speed - SLOWEST - low
    seen = look(guide, state[X], state[Y], state[YAW], speed * arms.reach)
    wanted = 0.0
    for share, row in ((1 - between, arms.gains[low]), (between, arms.gains[low + 1])):
        angle = row[points] * min(max(state[VY], -speed), speed)
        angle += row[points + 1] * min(max(state[YAW_RATE], -FASTEST_TURN), FASTEST_TURN)
        angle += row[points + 2] * memory[ANGLE]
        for i in range(points):
            angle += row[i] * seen[i]
        for i in range(waiting):
            angle += row[points + 3 + i] * memory[PENDING + i]
        wanted += share * angle
    change = arms.follow * (memory[PENDING] - memory[ANGLE])
    after[ANGLE] = memory[ANGLE] + min(max(change, -arms.most), arms.most)
    after[PENDING:-1] = memory[PENDING + 1 :]
    after[-1] = min(max(wanted, -arms.limit), arms.limit)


@compiled
def press(pedals, pressed, speed, state):
    """Where the accelerator stands one step on, of a foot that brings the car back to a speed from below [m/s2].

    From above it lifts.
    """
    seen = NEEDLE * np.rint(math.hypot(state[VX], state[VY]) / NEEDLE)
    wanted = min(max(EAGER * (speed - seen), 0.0), STRONGEST)
    return pressed + pedals.follow * (wanted - pressed)


@compiled
def _cues(script, k):
    """Row k of a script; beyond its end the last one holds."""
    k = min(max(k, 0), script.hands.size - 1)
    return script.hands[k], script.hand_wheel[k], script.speed[k], script.acceleration[k], script.deceleration[k]


@compiled
def drive_car(held, memory, k, state):
    """What the driver does from step k until the next.

    Args:
        held: A Task, held: handed over by value, its arrays' references would be counted at every use, for 0.1 us.
        memory: See :func:`first_memory`; it stays as it is.
        k: Control step.
        state: Of the plant, (STATE_SIZE,).

    Returns:
        hand_wheel [rad], drive and brake torques, (4,) each [N m], memory after.
    """
    after = memory.copy()
    hands, hand_wheel, speed, acceleration, deceleration = _cues(held.value.script, k)
    if hands == FOLLOW:
        steer(held.value.arms, held.value.guide, memory, state, after)
    elif hands == TURN_TO:
        after[ANGLE] = hand_wheel
    elif hands == TURN_ON and abs(state[AY]) < held.value.script.stops:
        after[ANGLE] += hand_wheel * held.value.dt
    if state[X] > held.value.script.lifts:
        after[PRESSED] = 0.0
    elif math.isnan(speed):
        after[PRESSED] = acceleration
    else:
        after[PRESSED] = press(held.value.pedals, memory[PRESSED], speed, state)
    pedals = held.value.pedals
    return after[ANGLE], after[PRESSED] * pedals.drive, deceleration * pedals.brake, after


@compiled
def drive_at(held, memory, time, state):
    """As :func:`drive_car` at a time [s]."""
    return drive_car(held, memory, int(np.rint(time / held.value.dt)), state)
