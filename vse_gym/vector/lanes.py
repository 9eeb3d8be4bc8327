"""One step of many drives at once: the closed loop of :mod:`vse_gym.simulation`, stage by stage, in compiled loops.

Each stage is a loop over rows of the very functions that a single drive calls, so that a row and a single drive agree
to the bit. A stage is compiled for the types that it meets: the plant's for a car's tyres, a filter's for a rule and a
model. What differs between rows of one type lies in lists of held constants.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.typed import List
from numpy.typing import NDArray

from vse_gym.compiled import compiled
from vse_gym.controllers.allocation import agent_demand
from vse_gym.controllers.moment import stability_control
from vse_gym.controllers.observation import see_motion, see_readings
from vse_gym.ending import GOES_ON, OFF_COURSE, ending
from vse_gym.inference.gaussian import covariance, filter_update
from vse_gym.manoeuvres.path import strayed_beyond
from vse_gym.manoeuvres.script import drive_car
from vse_gym.physics.double_track import road_friction
from vse_gym.physics.parameters import (
    AX,
    AY,
    BRAKE_WORK,
    DISTANCE,
    STATE_SIZE,
    VX,
    VY,
    YAW,
    YAW_RATE,
    X,
    Y,
)
from vse_gym.reward import INTERVENTION, MOVING, PEAK, SQUARES, step_reward, tally
from vse_gym.simulation import next_row
from vse_gym.types import CHANNELS, U_STEER, Y_AX, Y_AY, Y_YAW_RATE, Array

TABLE = (  # columns of what is told of each row, see describe_rows
    *(f"truth.{name}" for name in ("x", "y", "yaw", "vx", "vy", "yaw_rate", "ax", "ay", "sideslip")),
    *(f"estimate.{name}" for name in ("vx", "vy", "yaw_rate", "ax", "ay", "sideslip")),
    *(f"errors.{name}" for name in ("vx", "vy", "yaw_rate", "sideslip")),
    *(
        f"metrics.{name}"
        for name in ("peak_sideslip", "sideslip_rmse", "brake_energy", "speed_lost", "intervention_time")
    ),
)
ESTIMATE, TRUTH, READING = range(3)  # layouts of an observation


class Lanes(NamedTuple):
    """What changes in n drives, a row each; and what is said of them."""

    k: NDArray[np.int64]  # control step, (n,)
    steps: NDArray[np.int64]  # of the whole drive, (n,)
    state: Array  # of the plant, (n, STATE_SIZE)
    unit: Array  # memory of the brake unit, (n, rows, 4)
    sensed: Array  # memory of the sensors, (n, most delay steps + 1, 10)
    depth: NDArray[np.int64]  # of those, rows that are used, (n,)
    driver: Array  # memory of the driver, (n, m)
    steer: Array  # road-wheel angle, (n,) [rad]
    u: Array  # inputs of the reading, (n, 9)
    y: Array  # the reading, (n, 10)
    belief: Array  # of the estimator, (n, b)
    size: NDArray[np.int64]  # of those, numbers that are used, (n,)
    motion: Array  # estimated vx, vy, yaw rate, ax, ay, (n, 5)
    spread: Array  # variances of the first three, (n, 3)
    friction: Array  # estimated, NaN where it is not, (n,)
    friction_at: NDArray[np.int64]  # its place in the belief; -1: it has none, (n,)
    law: Array  # memory of the controller, (n, 4)
    base: Array  # what it asks for: torques and shares, (n, 2, 4)
    asked: Array  # the same with the agent's action, (n, 2, 4)
    seen: Array  # memory of the observation, (n, 2)
    wanted: Array  # memory of the reward, (n, 2)
    brake: Array  # the driver's torques, (n, 4) [N m]
    totals: Array  # see vse_gym.reward.tally, (n, 4)
    ended: NDArray[np.int64]  # why, see vse_gym.ending, (n,)
    reward: Array  # (n,)
    observation: NDArray[np.float32]  # (n, features)
    table: Array  # (n, columns of TABLE)


def lanes(rows: int, unit: int, delay: int, driver: int, belief: int, features: int) -> Lanes:
    """Lanes of n rows, all at rest."""

    def whole(*shape: int) -> NDArray[np.int64]:
        return np.zeros((rows, *shape), dtype=np.int64)

    def real(*shape: int) -> Array:
        return np.zeros((rows, *shape))

    return Lanes(
        k=whole(),
        steps=whole(),
        state=real(STATE_SIZE),
        unit=real(unit, 4),
        sensed=real(1 + delay, len(CHANNELS)),
        depth=whole(),
        driver=real(driver),
        steer=real(),
        u=real(9),
        y=real(len(CHANNELS)),
        belief=real(belief),
        size=whole(),
        motion=real(5),
        spread=real(3),
        friction=real(),
        friction_at=whole(),
        law=real(4),
        base=real(2, 4),
        asked=real(2, 4),
        seen=real(2),
        wanted=real(2),
        brake=real(4),
        totals=real(4),
        ended=whole(),
        reward=real(),
        observation=np.zeros((rows, features), dtype=np.float32),
        table=real(len(TABLE)),
    )


def some_of(every: Lanes, rows: slice) -> Lanes:
    """The lanes of some rows: views of the same arrays."""
    return Lanes._make(field[rows] for field in every)


@compiled
def listed(first, count):
    """A list of held constants, all of them the first; of a type that compiled code reads without asking."""
    out = List()
    for _ in range(count):
        out.append(first)
    return out


@compiled
def put(rows, i, item):
    """Replace a row's constants."""
    rows[i] = item


@compiled
def decide_rows(index, held, laws):
    """What the controller asks for, for each row of the index, by its estimate and reading."""
    v = held.value
    for i in index:
        m = v.motion[i]
        added, release, memory = stability_control(
            laws[i], v.law[i], m[0], m[1], m[2], m[4], v.u[i, U_STEER], v.friction[i]
        )
        for j in range(4):
            v.base[i, 0, j], v.base[i, 1, j], v.law[i, j] = added[j], release[j], memory[j]


@compiled
def drive_rows(index, held, plants, tasks, actions, by_moment, runge_kutta, substeps, h):
    """Brake demand, driver, brake unit, plant and sensors: each row's way to its next reading."""
    v, torques = held.value, np.empty((4, 4))
    for i in index:
        _, geometry, vehicle, _, _ = plants[i].value
        m = v.motion[i]
        demand = agent_demand(geometry, v.base[i, 0], v.base[i, 1], actions[i], by_moment, m[0], m[2], v.u[i, U_STEER])
        hand_wheel, drive, brake, driver = drive_car(tasks[i], v.driver[i], v.k[i], v.state[i])
        for j in range(4):
            v.asked[i, 0, j], v.asked[i, 1, j], v.brake[i, j] = demand[0][j], demand[1][j], brake[j]
            torques[0, j], torques[1, j], torques[2, j], torques[3, j] = drive[j], brake[j], demand[0][j], demand[1][j]
        for j in range(driver.size):
            v.driver[i, j] = driver[j]
        v.k[i] += 1
        v.steer[i] = hand_wheel / vehicle.steering_ratio
        depth = v.depth[i]
        unit, state, u, y, sensed = next_row(
            plants[i],
            runge_kutta,
            substeps,
            h,
            v.unit[i],
            v.state[i],
            v.sensed[i, :depth],
            v.steer[i],
            torques,
            (m[0], m[1], m[2]),
            v.k[i],
        )
        v.unit[i] = unit
        v.sensed[i, :depth] = sensed
        for j in range(state.size):
            v.state[i, j] = state[j]
        for j in range(9):
            v.u[i, j] = u[j]
        for j in range(10):
            v.y[i, j] = y[j]


@compiled
def filter_rows(index, held, filters):
    """What a Gaussian filter believes after each row's reading."""
    v = held.value
    for i in index:
        size, place = v.size[i], v.friction_at[i]
        belief = filter_update(filters[i], v.belief[i, :size], v.u[i], v.y[i])
        rule, model = filters[i].value
        n = model.prior_mean.size
        rows = (size - 7 - model.memory.size - n) // n
        cov = covariance(rule, belief[n : n + rows * n].reshape(rows, n))
        for j in range(size):
            v.belief[i, j] = belief[j]
        for j in range(5):
            v.motion[i, j] = belief[size - 7 + j]
        for j, channel in ((2, Y_YAW_RATE), (3, Y_AX), (4, Y_AY)):
            if math.isnan(v.motion[i, j]):  # of what it has no opinion, what was last heard stands
                v.motion[i, j] = v.sensed[i, 0, channel]
        for j in range(3):
            v.spread[i, j] = cov[j, j]
        v.friction[i] = belief[place] if place >= 0 else np.nan


@compiled
def tell_rows(index, held):
    """The truth in place of an estimate."""
    v = held.value
    for i in index:
        x, m = v.state[i], v.motion[i]
        m[0], m[1], m[2], m[3], m[4] = x[VX], x[VY], x[YAW_RATE], x[AX], x[AY]
        v.spread[i, :] = 0.0
        v.friction[i] = np.nan


@compiled
def judge_rows(index, held, plants, worths, tasks):
    """Whether each row's drive is over, what it has cost so far and what the step was worth."""
    v = held.value  # once: handed to a function by value, 26 arrays' references would be counted for every row
    for i in index:
        x, m, added, release = v.state[i], v.motion[i], v.asked[i, 0], v.asked[i, 1]
        v.ended[i] = ending(x, m)
        room = tasks[i].value.room
        if v.ended[i] == GOES_ON and room < math.inf and strayed_beyond(tasks[i].value.bounds, room, x[X], x[Y]):
            v.ended[i] = OFF_COURSE
        v.totals[i] = tally(worths[i], v.totals[i], x, m, added, release)
        _, _, vehicle, road, _ = plants[i].value
        friction = road_friction(vehicle, road, x[DISTANCE])
        v.reward[i], v.wanted[i] = step_reward(worths[i], v.wanted[i], x, v.steer[i], added, v.brake[i], friction)
        if v.ended[i] != GOES_ON:
            v.reward[i] -= v.steps[i] - v.k[i]


@compiled
def observe_rows(index, held, views, layout):
    """What an agent sees of each row."""
    v, zero = held.value, np.zeros(3)
    for i in index:
        x = v.state[i]
        if layout == READING:
            observation, v.seen[i] = see_readings(views[i], v.seen[i], v.sensed[i, 0], v.y[i], v.u[i, U_STEER])
        elif layout == TRUTH:
            motion = np.array([x[VX], x[VY], x[YAW_RATE], x[AX], x[AY]])
            observation, v.seen[i] = see_motion(views[i], v.seen[i], motion, zero, v.steer[i])
        else:
            observation, v.seen[i] = see_motion(views[i], v.seen[i], v.motion[i], v.spread[i], v.u[i, U_STEER])
        for j in range(observation.size):
            v.observation[i, j] = observation[j]


@compiled
def describe_rows(held, worths):
    """The table of what is told of each row; columns as TABLE names them, SI units."""
    v = held.value
    for i in range(v.k.size):
        x, m, t, out = v.state[i], v.motion[i], v.totals[i], v.table[i]
        sideslip, guess = math.atan2(x[VY], x[VX]), math.atan2(m[1], m[0])
        out[0], out[1], out[2], out[3], out[4], out[5] = x[X], x[Y], x[YAW], x[VX], x[VY], x[YAW_RATE]
        out[6], out[7], out[8] = x[AX], x[AY], sideslip
        for j in range(5):
            out[9 + j] = m[j]
        apart = guess - sideslip
        out[14], out[15], out[16], out[17] = guess, m[0] - x[VX], m[1] - x[VY], m[2] - x[YAW_RATE]
        out[18] = apart - 2 * math.pi * np.rint(apart / (2 * math.pi))
        out[19], out[20] = t[PEAK], math.sqrt(t[SQUARES] / max(1.0, t[MOVING]))
        out[21], out[22] = x[BRAKE_WORK], worths[i].value.start - math.hypot(x[VX], x[VY])
        out[23] = t[INTERVENTION]
