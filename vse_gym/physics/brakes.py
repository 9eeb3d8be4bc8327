"""The brake unit: what the driver and the stability control ask for, limited by an ABS, delayed by the hydraulics.

The unit sees the *estimated* speeds, and the last readings of the wheels and of the accelerometer along the car. It
works without any stability control.

The ABS holds each wheel at a target slip. What the road gives a wheel is observed from its acceleration and the torque
that acted, as a disturbance observer does (Ohnishi, 1987); what is already on its way through the dead time is taken
into account as in Smith's predictor (1957), and the hydraulic lag is inverted.
"""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.physics.double_track import wheel_velocity
from vse_gym.physics.parameters import GRAVITY


class BrakeUnit(NamedTuple):
    """Tunings of the ABS and the actuator."""

    slip: float = 0.12  # braking slip at which the ABS holds a wheel that the driver brakes, per g of deceleration [-]
    slip_added: float = 0.30  # the same where the stability control brakes: a moment needs more than a short stop [-]
    slip_speed: float = 0.4  # but at least so much slip velocity, because slip is too quick at low speed [m/s]
    enter: float = 25.0  # deceleration of a slipping wheel from which the ABS takes it over [m/s2]
    settle: float = 0.06  # time in which a wheel is led to the target [s]
    heed: float = 0.6  # share of the newest road torque in its average [-]
    least: float = 30.0  # torque that the ABS leaves a wheel: one that brakes is not taken to roll freely [N m]
    yaw_build_up_front: float = 1e3  # rise of what a wheel gets beyond its slipping neighbour [N m/s]
    yaw_build_up_rear: float = -50.0  # the same behind: it falls, so that grip is left to hold the tail [N m/s]
    slowest: float = 2.0  # estimated speed below which the ABS is off [m/s]
    dead_time: float = 0.020  # [s]
    lag: float = 0.050  # [s]
    rise: float = 12e3  # fastest build-up [N m/s]
    fall: float = 30e3  # fastest release [N m/s]


BELIEFS = 4  # rows of the memory behind the demands on their way
LAST, TURNS, ROAD, ACTIVE = -4, -3, -2, -1
HARDEST = -12.0  # no road slows a car faster, whatever the accelerometer says [m/s2]


def released_brakes(unit: BrakeUnit, dt: float):
    """Memory of an idle unit, (5 + delay steps, 4).

    The torque now and the demands on their way [N m]; then of each wheel the speed last heard and the speed believed
    [rad/s], the torque that the road gives it [N m], and 1 while the ABS has it.
    """
    return np.zeros((5 + round(unit.dead_time / dt), 4))


@compiled
def _hydraulics(unit, torque, demand, dt):
    """Torque after a step towards a demand: lag, within the rates."""
    change = (1 - math.exp(-dt / unit.lag)) * (demand - torque)
    return torque + min(unit.rise * dt, max(-unit.fall * dt, change))


@compiled
def _believed(unit, memory, i, heard, slowing, inertia, dt):
    """Speed of wheel i and what the road gives it: observed, or predicted while its sensor is silent.

    Args:
        unit: Tunings.
        memory: From the last step.
        i: Wheel.
        heard: Its speed as last heard [rad/s].
        slowing: Rate of a wheel that keeps its slip, which a silent one is taken for unless the ABS has it [rad/s2].
        inertia: Of the wheel [kg m2].
        dt: [s].

    Returns:
        speed [rad/s], its rate [rad/s2], road torque [N m].
    """
    before, road = memory[TURNS, i], memory[ROAD, i]
    if heard > 0 and heard == memory[LAST, i] and memory[0, i] > 0:  # a braking wheel never keeps its speed
        rate = (road - memory[0, i]) / inertia if memory[ACTIVE, i] > 0 else slowing
        return before + dt * rate, rate, road
    rate = (heard - before) / dt
    if heard > 0 and before > 0:  # a locked wheel says nothing of the road, nor does one heard for the first time
        road += unit.heed * (max(0.0, memory[0, i] + inertia * rate) - road)
    return heard, rate, road


@compiled
def _held(unit, memory, i, along, slip, ax, radius, inertia, dt):
    """The torque to ask for, that leads wheel i to a slip at once after the dead time [N m].

    Args:
        unit: Tunings.
        memory: Its beliefs are those of now; its torques are what is on its way.
        i: Wheel.
        along: Speed of the wheel's centre [m/s].
        slip: Target [-].
        ax: Acceleration of the car [m/s2].
        radius: [m].
        inertia: Of the wheel [kg m2].
        dt: [s].
    """
    torque, speed, road = memory[0, i], memory[TURNS, i], memory[ROAD, i]
    depth = memory.shape[0] - BELIEFS
    for k in range(1, depth):
        torque = _hydraulics(unit, torque, memory[k, i], dt)
        speed += dt * (road - torque) / inertia
    along += (depth - 1) * dt * ax
    target = (along - max(slip * along, unit.slip_speed)) / radius
    wanted = road + inertia * ((max(0.0, speed) - target) / unit.settle - ax / radius)
    return torque + (wanted - torque) / (1 - math.exp(-dt / unit.lag))


@compiled
def _delay_yaw(unit, memory, driver, held):
    """Limits the driver's torques (4,) so that on split friction the yaw moment builds up slowly: edits them.

    Beside a wheel that the ABS has, its neighbour on the axle gets what that one could take, or what it has had, which
    rises slowly in front, so that the driver has time to steer against it, and wears off behind.
    """
    for i in range(4):
        other = i + 1 if i % 2 == 0 else i - 1
        rate = unit.yaw_build_up_front if i < 2 else unit.yaw_build_up_rear
        driver[i] = min(driver[i], max(held[other], memory[0, i] + rate * (unit.lag + unit.dead_time)))


@compiled
def drive_torques(driver, added):
    """The drive torques that act, (4,) [N m]: none where the driver accelerates while the stability control brakes.

    A control that brakes against the engine would spin the wheels it has unloaded; FMVSS 126 asks for a means to cut
    the engine's torque. Torques that slow a wheel stay.
    """
    out = driver.copy()
    if added.max() > 0:
        for i in range(4):
            out[i] = min(0.0, out[i])
    return out


@compiled
def brake_torques(unit, geometry, memory, driver, added, release, heard, velocity, steer, dt):
    """The brakes' torques during the next dt: the unit's memory one step on; its first row is the torques.

    Args:
        unit: Tunings.
        geometry: Of the car as the unit knows it.
        memory: From :func:`released_brakes` or the last step.
        driver: Brake torques that the driver asks for, (4,) [N m].
        added: What the stability control adds, (4,) [N m]; taken between 0 and the caps.
        release: Share of the driver's torque to let go, (4,), taken between 0 and 1.
        heard: Readings as last heard, (10,); the first is the longitudinal acceleration [m/s2], from the fourth on
            the wheel speeds [rad/s].
        velocity: Estimated vx, vy, yaw rate [m/s, m/s, rad/s].
        steer: Road-wheel angle [rad].
        dt: Control step [s].
    """
    after = memory.copy()
    depth = memory.shape[0] - BELIEFS
    vx, vy, yaw_rate = velocity
    radius, inertia = geometry.wheel_radius, geometry.wheel_inertia
    ax = min(0.0, max(HARDEST, heard[0]))
    asked, extra, held = np.empty(4), np.empty(4), np.full(4, np.inf)
    for i in range(4):
        cap = geometry.brake_cap_front if i < 2 else geometry.brake_cap_rear
        asked[i] = (1 - min(1.0, max(0.0, release[i]))) * driver[i]
        extra[i] = min(cap, max(0.0, added[i]))
        after[LAST, i] = heard[3 + i]
        after[TURNS, i], rate, after[ROAD, i] = _believed(unit, memory, i, heard[3 + i], ax / radius, inertia, dt)
        after[ACTIVE, i] = 0.0
        demand = asked[i] + extra[i]
        along, _ = wheel_velocity(geometry, i, vx, vy, yaw_rate, steer)
        if demand <= 0 or min(vx, along) <= unit.slowest:
            continue
        slip = 1 - radius * after[TURNS, i] / along
        slip_driver = unit.slip * -ax / GRAVITY
        target = slip_driver + (unit.slip_added - slip_driver) * extra[i] / demand
        target = max(target, unit.slip_speed / along)
        quick = slip > 0.25 * target and radius * rate < -unit.enter
        if slip > target or quick or memory[ACTIVE, i] > 0:
            torque = max(unit.least, _held(unit, after, i, along, target, ax, radius, inertia, dt))
            if torque < demand:
                held[i], after[ACTIVE, i] = torque, 1.0
    _delay_yaw(unit, memory, asked, held)
    for i in range(4):
        demand = min(asked[i] + extra[i], held[i])
        for k in range(1, depth - 1):
            after[k, i] = memory[k + 1, i]
        if depth > 1:
            after[depth - 1, i] = demand
            demand = memory[1, i]
        after[0, i] = _hydraulics(unit, memory[0, i], demand, dt)
    return after
