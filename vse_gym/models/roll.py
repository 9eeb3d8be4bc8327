"""The double track with a body that rolls and tyres that lag: eight degrees of freedom, four of them given as readings.

Equations: patent application CN110532590A (2019) as :mod:`vse_gym.physics.roll` has them; unsteady tyres after Pacejka
(2012), chapter 8.
"""

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.inference.model import advance, attend, heed, observe, recall, remember, report
from vse_gym.models.channels import attend_wheels, read_extras
from vse_gym.models.double_track import (
    GAIN_X,
    GAIN_Y,
    LAG_X,
    LAG_Y,
    U_FELT,
    U_WHEEL,
    DoubleTrackTuning,
    heed_wheels,
    read_wheels,
    steady_slips,
    turning,
    tyre_forces,
    wheel_table,
)
from vse_gym.models.nominal import Nominal
from vse_gym.models.tuning import tunable
from vse_gym.physics.parameters import GRAVITY, RollingBody, Vehicle
from vse_gym.types import WHEELS, Y_AX, Y_AY, Y_ROLL_RATE, Y_WHEEL, Array

# What ``heed`` and ``recall`` put behind the double track's inputs: the slips at the begin of the step, kappa (4) and
# tan(alpha) (4), and which share of the way to the steady slips tyres have gone, on the mean over the step along and
# across and at its end along and across (4) [-]
U_LAG, U_GAIN = U_FELT + 1, U_FELT + 9
# What the memory holds behind the double track's: the slips, as above (8) [-], and the forward speed [m/s]
WHEEL_MEMORY = 5
M_LAG, M_SPEED = WHEEL_MEMORY, WHEEL_MEMORY + 8


RIGID_RATE = 40.0  # at which a rigid body forgets a roll that it never had [1/s]
RIGID_DOUBT = 0.01  # what is left of the doubts about roll if the car is said not to [-]


class Suspension(NamedTuple):
    """How a body leans. Roll acceleration: side a + turn q - righting phi - damping p, with a the tyres' force across
    over the mass and q their moment over the yaw inertia.
    """

    side: float  # [rad/m]
    turn: float  # [-]
    righting: float  # [1/s2]
    damping: float  # [1/s]
    swing: float  # acceleration across per roll acceleration [m]
    twist: float  # yaw acceleration per roll acceleration [-]
    springs: float  # lateral acceleration that moves as much load as a rad of roll does [m/s2]
    dampers: float  # the same of a rad/s of roll rate [m/s]
    centres: float  # share of the load transfer that the roll centres carry in a steady turn [-]


def suspension(car: Vehicle) -> Suspension:
    """That of a car; to a rigid body nothing happens, and what noise does to it is over after a few steps."""
    body = car.body
    if not isinstance(body, RollingBody):
        return Suspension(0.0, 0.0, RIGID_RATE**2, 2 * RIGID_RATE, 0.0, 0.0, 0.0, 0.0, 1.0)
    swing, product = body.sprung_mass * body.roll_arm, body.roll_yaw_product
    upright = body.roll_stiffness - swing * GRAVITY
    inertia = body.roll_inertia + swing * body.roll_arm - swing**2 / car.mass - product**2 / car.yaw_inertia
    tilt = car.mass * max(car.height, 1e-9)
    return Suspension(
        side=swing / inertia,
        turn=product / inertia,
        righting=upright / inertia,
        damping=body.roll_damping / inertia,
        swing=swing / car.mass,
        twist=product / car.yaw_inertia,
        springs=body.roll_stiffness / tilt,
        dampers=body.roll_damping / tilt,
        centres=1 - swing * body.roll_stiffness / upright / tilt,
    )


class RollTrack(NamedTuple):
    """Four wheels whose slips lag, under a body that rolls.

    State: vx, vy [m/s], yaw rate, roll rate [rad/s], roll angle, positive leans right [rad]. Wheel speeds are inputs;
    the lagged slips are no state but a memory that follows the corrected mean. It explains all channels.
    """

    vehicle: Vehicle
    suspension: Suspension
    friction: float  # [-]
    wheel_radius: float  # [m]
    slip: float  # standard deviation of the slip of a rolling wheel, relative [-]
    brake_slip: float  # the same of the fastest wheel while all four brake [-]
    brake_hold: float  # a wheel is no speedometer for this long after it braked [s]
    brake_margin: float  # by so much may the accelerometer miss how fast the car slows down [m/s2]
    slowest: float  # speed to which slips are taken at least [m/s]
    speedometer: float  # 1: rolling wheels are read for the speed; 0: every wheel speed is an input only
    dt: float  # [s]
    prior_mean: Array  # (5,)
    prior_cov: Array  # (5, 5)
    process_cov: Array  # (5, 5), of one step
    variances: Array  # of the channels, without wheel slip; NaN: not used; (10,)
    memory: Array  # as of the double track, the lagged slips and the forward speed; (14,)

    @property
    def found(self) -> dict[str, int]:
        """What estimators report beside the motion, and where in the state it is."""
        return {"roll_rate": 3, "roll": 4}


@dataclass(frozen=True)
class RollTrackTuning(DoubleTrackTuning):
    """How far a filter trusts the double track with roll: beside the double track's own, what concerns roll."""

    roll_rate_noise: float = tunable(0.1, 0.01, 1.0)  # process noise density [rad/s per sqrt(s)]
    roll_noise: float = tunable(0.01, 0.001, 0.1)  # small, but without it the transition has no density [rad/sqrt(s)]
    roll_rate_error: float = tunable(0.0, 0.0, 0.1)  # added to the roll gyro's noise [rad/s]
    roll_rate_prior: float = 0.05  # standard deviation at the start [rad/s]
    roll_prior: float = 0.01  # [rad]
    speedometer: bool = True  # whether rolling wheels are read for the speed; False: z = [ax, ay, p, r], as published

    def build(self, nominal: Nominal) -> RollTrack:  # type: ignore[override]
        """The model of a nominal car with this trust."""
        like = DoubleTrackTuning(**{f.name: getattr(self, f.name) for f in fields(DoubleTrackTuning)}).build(nominal)
        doubt = 1.0 if isinstance(nominal.vehicle.body, RollingBody) else RIGID_DOUBT
        noise = doubt**2 * nominal.dt * np.array([self.roll_rate_noise**2, self.roll_noise**2])
        prior = doubt**2 * np.array([self.roll_rate_prior**2, self.roll_prior**2])
        variances = like.variances.copy()
        variances[Y_ROLL_RATE] = nominal.sheet.roll_rate**2 + self.roll_rate_error**2
        if not self.speedometer:
            variances[WHEELS] = math.nan
        return RollTrack(
            vehicle=like.vehicle,
            suspension=suspension(nominal.vehicle),
            friction=like.friction,
            wheel_radius=like.wheel_radius,
            slip=like.slip,
            brake_slip=like.brake_slip,
            brake_hold=like.brake_hold,
            brake_margin=like.brake_margin,
            slowest=like.slowest,
            speedometer=float(self.speedometer),
            dt=like.dt,
            prior_mean=np.concatenate((like.prior_mean, np.zeros(2))),
            prior_cov=np.diag(np.concatenate((np.diag(like.prior_cov), prior))),
            process_cov=np.diag(np.concatenate((np.diag(like.process_cov), noise))),
            variances=variances,
            memory=np.concatenate((like.memory, np.zeros(8), [float(nominal.speed)])),
        )


@compiled
def _lagging_wheels(model, u, end):
    """The double track's table, with slips as they are on the mean over the step or at its end."""
    table, gain = wheel_table(model, u), U_GAIN + (2 if end else 0)
    for i in range(4):
        table[i, LAG_X], table[i, LAG_Y] = u[U_LAG + i], u[U_LAG + 4 + i]
        table[i, GAIN_X], table[i, GAIN_Y] = u[gain], u[gain + 1]
    return table


@compiled
def _accelerations(model, table, felt, vx, vy, yaw_rate, roll_rate, roll):
    """Specific forces ax, ay on the roll axis [m/s2], yaw and roll acceleration [rad/s2]."""
    s = model.suspension
    across = s.springs * roll + s.dampers * roll_rate + s.centres * turning(model, vx, yaw_rate)
    ax, ay, yaw = tyre_forces(model, table, felt, vx, vy, yaw_rate, across)
    lean = s.side * ay + s.turn * yaw - s.righting * roll - s.damping * roll_rate
    return ax - s.swing * yaw_rate * roll_rate, ay + s.swing * lean, yaw + s.twist * lean, lean


@advance.register(RollTrack)
@compiled
def _(model, states, u):
    # Heun's method, as for the double track
    table, h, felt = _lagging_wheels(model, u, False), model.dt, u[U_FELT]
    out = np.empty_like(states)
    for j in range(states.shape[1]):
        vx, vy, r, p, phi = states[0, j], states[1, j], states[2, j], states[3, j], states[4, j]
        ax, ay, dr, dp = _accelerations(model, table, felt, vx, vy, r, p, phi)
        dvx, dvy = ax + vy * r, ay - vx * r
        x, y, q, w = vx + h * dvx, vy + h * dvy, r + h * dr, p + h * dp
        ax, ay, dq, dw = _accelerations(model, table, felt, x, y, q, w, phi + h * p)
        out[0, j] = vx + 0.5 * h * (dvx + ax + y * q)
        out[1, j] = vy + 0.5 * h * (dvy + ay - x * q)
        out[2, j] = r + 0.5 * h * (dr + dq)
        out[3, j] = p + 0.5 * h * (dp + dw)
        out[4, j] = phi + 0.5 * h * (p + w)
    return out


@observe.register(RollTrack)
@compiled
def _(model, states, u):
    table, felt = _lagging_wheels(model, u, True), u[U_FELT]
    out = np.empty((10, states.shape[1]))
    for j in range(states.shape[1]):
        vx, vy, r, roll = states[0, j], states[1, j], states[2, j], states[4, j]
        out[Y_AX, j], ay, _, _ = _accelerations(model, table, felt, vx, vy, r, states[3, j], roll)
        out[Y_AY, j] = ay + GRAVITY * math.sin(roll)  # leaning, the accelerometer feels gravity too
        read_wheels(model.vehicle, table, u, vx, vy, r, out, j)
    read_extras(model.variances, states, out)
    for j in range(states.shape[1]):
        out[Y_ROLL_RATE, j] = states[3, j]
    return out


@heed.register(RollTrack)
@compiled
def _(model, u, y):
    heeded, out = heed_wheels(model, u, y), np.zeros(U_GAIN + 4)
    for i in range(heeded.size):
        out[i] = heeded[i]
    for i in range(4):
        out[U_GAIN + i] = 1.0  # steady tyres, unless something is remembered
        if model.speedometer == 0.0:
            out[U_WHEEL + i] = y[Y_WHEEL + i]
    return out


@compiled
def _gains(length, way):
    """Share of the way to the steady slip that a tyre of a relaxation length goes: mean over the way, and at its end.

    The lag's exact solution, for a slip velocity that stays.
    """
    if length == 0.0:
        return 1.0, 1.0
    end = 1 - math.exp(-way / length)
    return 1 - end * length / way, end


@recall.register(RollTrack)
@compiled
def _(model, memory, u):
    out, car = u.copy(), model.vehicle
    for i in range(8):
        out[U_LAG + i] = memory[M_LAG + i]
    way = model.dt * max(model.slowest, memory[M_SPEED])
    out[U_GAIN], out[U_GAIN + 2] = _gains(car.relaxation_x, way)
    out[U_GAIN + 1], out[U_GAIN + 3] = _gains(car.relaxation_y, way)
    return out


@remember.register(RollTrack)
@compiled
def _(model, memory, state, u):
    after, table = memory.copy(), _lagging_wheels(model, u, True)
    for i in range(4):
        kappa, tan_alpha = steady_slips(model, table, i, state[0], state[1], state[2])
        after[M_LAG + i] = table[i, LAG_X] + table[i, GAIN_X] * (kappa - table[i, LAG_X])
        after[M_LAG + 4 + i] = table[i, LAG_Y] + table[i, GAIN_Y] * (tan_alpha - table[i, LAG_Y])
    after[M_SPEED] = abs(state[0])
    return after


@attend.register(RollTrack)
@compiled
def _(model, memory, u, y):
    variances, wheels = attend_wheels(model, memory[:WHEEL_MEMORY], u, y)
    after = memory.copy()
    for i in range(WHEEL_MEMORY):
        after[i] = wheels[i]
    if model.speedometer == 0.0:
        for i in range(4):
            variances[Y_WHEEL + i] = np.nan
    return variances, after


@report.register(RollTrack)
@compiled
def _(model, state, u):
    ax, ay, _, _ = _accelerations(
        model, _lagging_wheels(model, u, True), u[U_FELT], state[0], state[1], state[2], state[3], state[4]
    )
    return np.array([state[0], state[1], state[2], ax, ay + GRAVITY * math.sin(state[4])])
