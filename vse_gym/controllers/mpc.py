"""Model predictive control of yaw rate and sideslip: a linear time-varying quadratic programme at every step."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from vse_gym.compiled import compiled, hold
from vse_gym.controllers.allocation import SLOWEST, allocate, largest_moment, let_go
from vse_gym.controllers.base import Controller
from vse_gym.controllers.moment import DEG, beyond
from vse_gym.controllers.prediction import UNITS, bicycle, linearise, predict
from vse_gym.controllers.reference import Reference, follow_reference
from vse_gym.models import Nominal
from vse_gym.physics.double_track import wheel_position
from vse_gym.physics.parameters import GRAVITY
from vse_gym.types import NO_BRAKE, Array, BrakeDemand, Estimate, Reading

STAGE = 5  # variables and constraints of a step of the prediction


class Aims(NamedTuple):
    """What is wanted of the car and what it can do."""

    sideslip_bound: float  # [rad]
    yaw_band: float  # [rad/s]
    mass: float  # [kg]
    height: float  # [m]
    share: float  # control step over a step of the prediction [-]


class Programme(NamedTuple):
    """min z'Pz/2 + q'z subject to low <= Az <= high, of N stages (x[k + 1], u[k], s[k + 1])."""

    entries: Array  # of A, as :func:`pattern` places them
    q: Array  # (5N,)
    low: Array  # (5N,)
    high: Array  # (5N,)
    guess: Array  # of z, (5N,)


class Shape(NamedTuple):
    """What stays of the programme: P, and where the entries of A belong, in compressed columns."""

    P: Any  # sparse, (5N, 5N)
    order: Any  # from the order of :func:`pattern` to that of the columns, (entries,)
    rows: Any  # of each entry in that order, (entries,)
    begins: Any  # of each column, (5N + 1,)


class MpcState(NamedTuple):
    """Constants, what is remembered, and the last plan."""

    constants: Any  # reference, bicycle, geometry, aims and weights, held by compiled code
    shape: Shape
    memory: Array  # reference yaw rate, envelope of |ay|, (2,)
    plan: Array  # moments, one per step of the prediction, (N,) [UNITS]
    dual: Array  # multipliers of the last solution, (5N,)
    unsolved: int  # steps so far at which the solver gave up


def pattern(steps: int) -> tuple[list[int], list[int]]:
    """Rows and columns of A's entries in the order in which :func:`programme` writes them.

    Of a stage's rows the first three are the dynamics, then come the soft bound of sideslip and the moment's.
    """
    own = [(i, i) for i in range(3)] + [(i, 3) for i in range(3)] + [(3, 0), (3, 4), (4, 3)]
    back = [(i, j - STAGE) for i in range(3) for j in range(3)]
    placed = [(STAGE * k + i, STAGE * k + j) for k in range(steps) for i, j in own + (back if k else [])]
    return [i for i, _ in placed], [j for _, j in placed]


def shape(steps: int, weights: tuple[float, float, float]) -> Shape:
    """For so many steps, with weights on the sideslip beyond its bound, on the yaw rate and on the moment, in UNITS."""
    rows, columns = pattern(steps)
    number = sparse.csc_matrix((np.arange(1.0, len(rows) + 1), (rows, columns)))  # 0 would be no entry
    stage = np.array([0.0, weights[1], 0.0, weights[2], weights[0]])
    order = number.data.astype(np.int64) - 1
    return Shape(sparse.diags(np.tile(stage, steps), format="csc"), order, number.indices, number.indptr)


@compiled
def programme(plan, x, a, b, c, wanted, yaw_weight, bound, most):
    """The quadratic programme about a trajectory, all in UNITS.

    Args:
        plan: The trajectory's moments, (N,).
        x, a, b, c: From :func:`linearise`.
        wanted: Yaw rates, (N,).
        yaw_weight: On their errors [-].
        bound: Of sideslip; s is what lies beyond, with its sign, so that left and right are the same numbers.
        most: Largest moment.
    """
    steps = wanted.size
    entries = np.empty(9 * steps + 9 * (steps - 1))
    q, guess = np.zeros(STAGE * steps), np.empty(STAGE * steps)
    low, high = np.empty(STAGE * steps), np.empty(STAGE * steps)
    n = 0
    for k in range(steps):
        base = STAGE * k
        q[base + 1] = -yaw_weight * wanted[k]
        for i in range(3):
            entries[n + i], entries[n + 3 + i] = 1.0, -b[k, i]
            given = c[k, i]
            for j in range(3):
                if k == 0:
                    given += a[0, i, j] * x[0, j]
                else:
                    entries[n + 9 + 3 * i + j] = -a[k, i, j]
            low[base + i] = high[base + i] = given
            guess[base + i] = x[k + 1, i]
        entries[n + 6], entries[n + 7], entries[n + 8] = 1.0, -1.0, 1.0
        low[base + 3], high[base + 3] = -bound, bound
        low[base + 4], high[base + 4] = -most, most
        guess[base + 3], guess[base + 4] = plan[k], beyond(x[k + 1, 0], bound)
        n += 9 if k == 0 else 18
    return Programme(entries, q, low, high, guess)


@compiled
def acting_moment(g, brake, steer):
    """The yaw moment of brake torques (4,) that the road takes up whole [N m]."""
    moment = 0.0
    for i in range(4):
        x, y = wheel_position(g, i)
        s, c = (math.sin(steer), math.cos(steer)) if i < 2 else (0.0, 1.0)
        moment += (y * c - x * s) * brake[i] / g.wheel_radius
    return moment


@compiled
def prepare(constants, memory, plan, vx, vy, yaw_rate, ay, steer, friction, brake):
    """One step up to the solver: memory, whether there is something to do, the plan moved on, and the programme.

    The brakes' dead time is one step of the prediction: what was asked for last acts until then.
    """
    reference, model, g, aims, yaw_weight = constants.value
    wanted, envelope = follow_reference(reference, memory[0], memory[1], vx, ay, steer)
    speed = max(vx, SLOWEST)
    sideslip = math.atan2(vy, speed)
    known = reference.friction if math.isnan(friction) else friction
    moved = plan.copy()
    for k in range(plan.size - 1):
        moved[k] += aims.share * (plan[k + 1] - plan[k])
    error = yaw_rate - wanted
    acts = vx >= SLOWEST and (abs(error) > aims.yaw_band or abs(sideslip) > aims.sideslip_bound)

    track = 0.5 * (g.track_front + g.track_rear)
    grip = 0.5 * known * aims.mass * (0.5 * GRAVITY * track + abs(ay) * aims.height)  # of the outer wheels, as a moment
    most = min(largest_moment(g), grip) / UNITS[2]
    now = max(-most, min(most, acting_moment(g, brake, steer) / UNITS[2]))
    start = np.array(predict(model, speed, steer, known, sideslip / UNITS[0], yaw_rate / UNITS[1], now, plan[0]))
    x, a, b, c = linearise(model, speed, steer, known, start, moved)
    let_be = max(-aims.yaw_band, min(aims.yaw_band, error))
    targets, later, held = np.empty(plan.size), wanted, envelope
    for k in range(plan.size):
        for _ in range(round(2 / aims.share) if k == 0 else round(1 / aims.share)):
            later, held = follow_reference(reference, later, held, vx, ay, steer)
        targets[k] = (later + let_be) / UNITS[1]
    qp = programme(moved, x, a, b, c, targets, yaw_weight, aims.sideslip_bound / UNITS[0], most)
    return np.array((wanted, envelope)), acts, moved, qp


def solve(shape: Shape, qp: Programme, dual: Array) -> tuple[Array, Array] | None:
    """Z and the multipliers by OSQP, started at the guess; None if it found none.

    The solver is built anew each time: what an old one remembers would be a part of the state that cannot be copied.

    Raises:
        ModuleNotFoundError: If OSQP is not installed.
    """
    osqp = _osqp()
    matrix = sparse.csc_matrix((qp.entries[shape.order], shape.rows, shape.begins), shape=shape.P.shape)
    solver = osqp.OSQP()
    solver.setup(shape.P, qp.q, matrix, qp.low, qp.high, **SETTINGS)
    solver.warm_start(x=qp.guess, y=dual)
    result = solver.solve(raise_error=False)
    if result.info.status != "solved" or not np.isfinite(result.x).all():
        return None
    return result.x, result.y


# Checked, and the step size changed, by count and not by the clock, so that a drive repeats itself bit by bit. UNITS
# scale the programme, and this step size ends it in 20 to 30 iterations.
SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-4,
    "eps_rel": 1e-4,
    "max_iter": 1000,
    "scaling": 0,
    "rho": 3.0,
    "adaptive_rho_interval": 50,
    "check_termination": 10,
}


def _osqp() -> Any:
    try:
        import osqp
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("the controller 'mpc' needs OSQP: pip install 'vse-gym[control]'") from error
    return osqp


@dataclass(frozen=True)
class ModelPredictiveControl(Controller):
    """Follows the reference yaw rate within a soft bound of sideslip, by moments that brakes and road can produce.

    A nonlinear single track of the nominal car is linearised along the last plan (the real-time iteration of Diehl,
    Bock and Schloeder, 2005); the programme is solved by OSQP (Stellato et al., 2020). Weights are one over the square
    of what is tolerated. It acts from where the yaw rate error or the sideslip leaves its band. Where the solver gives
    up the last plan goes on, and the state counts that.

    Raises:
        ValueError: If the step of the prediction is not a whole number of control steps.
    """

    steps: int = 20  # N
    step: float = 0.02  # of the prediction, and the brakes' dead time [s]
    lag: float = 0.05  # of the brakes [s]
    sideslip_bound: float = 3 * DEG  # [rad]
    yaw_band: float = 2.5 * DEG  # [rad/s]
    largest_sideslip: float = 1 * DEG  # tolerated beyond the bound [rad]
    largest_error: float = 10 * DEG  # tolerated, of the yaw rate [rad/s]
    largest_moment: float = 8e3  # tolerated [N m]
    understeer: float = 0.0020  # of the reference [rad s2/m]
    reference_lag: float = 0.06  # [s]
    envelope_release: float = 1.0  # [s]
    whole_release: float = 4e3  # moment from which the other side's driver torque is let go; infinite: never [N m]

    @property
    def weights(self) -> tuple[float, float, float]:
        """On the sideslip beyond its bound, on the yaw rate's error and on the moment, in UNITS."""
        tolerated = (self.largest_sideslip, self.largest_error, self.largest_moment)
        sideslip, yaw_rate, moment = ((unit / most) ** 2 for unit, most in zip(UNITS, tolerated, strict=True))
        return sideslip, yaw_rate, moment

    def init(self, nominal: Nominal) -> MpcState:
        _osqp()
        share = nominal.dt / self.step
        if abs(1 / share - round(1 / share)) > 1e-9:
            raise ValueError(f"step {self.step} s must be a whole number of control steps of {nominal.dt} s")
        car = nominal.vehicle
        lags = (self.understeer, nominal.friction, self.reference_lag, self.envelope_release, nominal.dt)
        reference = Reference(car.wheelbase, *map(float, lags))
        aims = Aims(*map(float, (self.sideslip_bound, self.yaw_band, car.mass, car.height, share)))
        constants = hold((reference, bicycle(nominal, self.step, self.lag), car.geometry, aims, self.weights[1]))
        plan, dual = np.zeros(self.steps), np.zeros(STAGE * self.steps)
        return MpcState(constants, shape(self.steps, self.weights), np.zeros(2), plan, dual, 0)

    def act(self, state: MpcState, estimate: Estimate, reading: Reading) -> tuple[BrakeDemand, MpcState]:
        seen = (estimate.vx, estimate.vy, estimate.yaw_rate, estimate.ay, reading.steer, estimate.friction)
        memory, acts, plan, qp = prepare(state.constants, state.memory, state.plan, *seen, reading.brake)
        if not acts:
            rest = state._replace(memory=memory, plan=np.zeros_like(plan), dual=np.zeros_like(state.dual))
            return NO_BRAKE, rest
        found = solve(state.shape, qp, state.dual)
        if found is None:
            state = state._replace(memory=memory, plan=plan, unsolved=state.unsolved + 1)
        else:
            state = state._replace(memory=memory, plan=found[0][3::STAGE], dual=found[1])
        geometry, moment = state.constants.value[2], state.plan[0] * UNITS[2]
        added = allocate(geometry, moment, estimate.vx, estimate.yaw_rate, reading.steer)
        return BrakeDemand(added, let_go(moment, estimate.vx, self.whole_release)), state
