"""Drives side by side in one thread: what each row drives, and one step of all of them."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import hold
from vse_gym.controllers.base import Controller, NoControl
from vse_gym.controllers.moment import MomentControl
from vse_gym.controllers.observation import Encoder
from vse_gym.env import worth
from vse_gym.episodes import Episodes
from vse_gym.estimators.anchors import Truth
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import GaussianFilter
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.manoeuvres.scripted import is_scripted
from vse_gym.physics import parameters as p
from vse_gym.physics.brakes import released_brakes
from vse_gym.physics.double_track import rolling_start
from vse_gym.reward import reward_memory
from vse_gym.sensing import read_sensors, unread_sensors
from vse_gym.sensors import stream
from vse_gym.simulation import Scenario
from vse_gym.types import NO_TORQUE, Array
from vse_gym.vector.lanes import (
    ESTIMATE,
    READING,
    TRUTH,
    complete_rows,
    decide_rows,
    describe_rows,
    drive_rows,
    filter_rows,
    judge_rows,
    lanes,
    listed,
    observe_rows,
    put,
    tell_rows,
)

LAYOUTS = {"estimate": ESTIMATE, "truth": TRUTH, "reading": READING}
Index = NDArray[np.int64]
SINGLE = 'vectorization_mode="sync" or "async" runs any'


def estimates_in_rows(estimator: Estimator) -> bool:
    """Whether compiled code can run an estimator: true states, or the recursion that Gaussian filters share."""
    kind = type(estimator)
    if kind is Truth:
        return estimator == Truth()
    if not isinstance(estimator, GaussianFilter) or estimator.told_friction:
        return False
    return all(getattr(kind, name) is getattr(GaussianFilter, name) for name in ("update", "estimate"))


def controls_in_rows(controller: Controller) -> bool:
    """The same of a controller: none, or a law from errors to a yaw moment."""
    return isinstance(controller, NoControl) or (
        isinstance(controller, MomentControl) and type(controller).act is MomentControl.act
    )


def check_in_rows(episodes: Episodes, controller: Controller) -> None:
    """Refuse what compiled code cannot drive.

    Raises:
        ValueError: If a block is not made for it; the message says which and what to do.
    """
    for scenario in episodes.written:
        if scenario.plant != "double_track":
            raise ValueError(f"the native vector environment drives no {scenario.plant}; {SINGLE} plant")
        _check_scripted(scenario.manoeuvre)
    for estimator in episodes.estimators:
        if not estimates_in_rows(estimator):
            name = type(estimator).__name__
            raise ValueError(f"{name} is neither truth nor of the Gaussian family; {SINGLE} estimator")
    if not controls_in_rows(controller):
        raise ValueError(f"{type(controller).__name__} is no law of yaw moments; {SINGLE} controller")


def _check_scripted(manoeuvre: Manoeuvre) -> None:
    if not is_scripted(manoeuvre):
        raise ValueError(f"{type(manoeuvre).__name__} has a driver of its own; {SINGLE} manoeuvre")


class Rows:
    """n drives. ``start`` begins a row's drive anew, ``step`` drives rows on; ``lanes`` says where they are."""

    def __init__(self, episodes: Episodes, controller: Controller, action: str, encoder: Encoder, count: int):
        self.episodes, self.controller, self.encoder, self.count = episodes, controller, encoder, count
        self._by_moment, self._layout = action == "yaw_moment", LAYOUTS[encoder.layout]
        first = episodes.written[0]
        self._substeps, self._substep = first.substeps, first.substep
        self._runge_kutta = first.integrator == "runge_kutta"
        driver = first.manoeuvre.init(first.nominal).memory.size
        delay = max(round(s.sensors.delay / s.dt) for s in episodes.written)
        beliefs = [_belief(e, s).size for e in episodes.estimators for s in episodes.written]
        unit = released_brakes(first.brake_unit, first.dt).shape[0]
        self.lanes = lanes(count, unit, delay, driver, max(beliefs), encoder.low.size)
        self._held = hold(self.lanes)
        self._drawn: list[tuple[Scenario, Estimator] | None] = [None] * count
        self._beliefs: list[Array] = [np.empty(0)] * count  # of each row, before its first reading
        self._memories: list[Array] = [np.empty(0)] * count  # of each row's reward, at the start
        self._kinds: list[Any] = [None] * count  # of each row's filter; None: true states
        self._filters: dict[Any, Any] = {}  # lists of rule and model, by kind
        self._lists: dict[str, Any] = {}  # of what every row has
        self._groups: list[tuple[Any, Index]] = []  # rows of a kind, among those last stepped
        self._grouped: Index = np.empty(0, dtype=np.int64)

    def start(self, i: int, seed: int) -> None:
        """Begin a row's drive: the same as ``Simulation.reset`` with this seed."""
        scenario, estimator = self.episodes.draw(seed)
        v, last = self.lanes, self._drawn[i]
        if last is None or last[0] is not scenario or last[1] is not estimator:
            self._prepare(i, scenario, estimator)
        s, row = scenario, np.array([i])
        record = s.sensors.record(s.steps + 1, s.dt, seed)
        self._put("plants", i, hold((s.brake_unit, s.nominal.vehicle.geometry, s.vehicle, s.road, record)))
        for array in (v.unit, v.driver, v.law, v.base, v.asked, v.seen, v.totals):
            array[i] = 0.0
        v.k[i], v.steps[i], v.depth[i], v.ended[i], v.steer[i], v.reward[i] = 0, s.steps, 1 + record.delay, 0, 0.0, 0.0
        v.wanted[i] = self._memories[i]
        v.state[i] = rolling_start(s.vehicle, s.manoeuvre.speed)
        rest, memory = p.Inputs(0.0, NO_TORQUE, NO_TORQUE), unread_sensors(record.delay, v.state[i])
        v.u[i], v.y[i], v.sensed[i, : v.depth[i]] = read_sensors(record, 0, v.state[i], rest, memory)
        if self._kinds[i] is not None:
            v.belief[i, : v.size[i]] = self._beliefs[i]
        self._estimate(row)
        observe_rows(row, self._held, self._lists["views"], self._layout)
        self._grouped = self._grouped[:0]

    def step(self, index: Index, actions: Array) -> None:
        """Drive rows on to their next reading.

        Args:
            index: Which rows, in order.
            actions: Of all rows, (n, size).
        """
        held, lists = self._held, self._lists
        if "laws" in lists:
            decide_rows(index, held, lists["laws"])
        way = (self._runge_kutta, self._substeps, self._substep)
        drive_rows(index, held, lists["plants"], lists["tasks"], actions, self._by_moment, *way)
        self._estimate(index)
        judge_rows(index, held, lists["plants"], lists["worths"], lists["tasks"])
        observe_rows(index, held, lists["views"], self._layout)

    def describe(self) -> Array:
        """The table of ``lanes.TABLE``, as it is now, (n, columns)."""
        describe_rows(self._held, self._lists["worths"])
        return self.lanes.table.copy()

    def _estimate(self, index: Index) -> None:
        if index is not self._grouped:
            kinds = {self._kinds[i] for i in index}
            self._groups = [(kind, index[[self._kinds[i] == kind for i in index]]) for kind in kinds]
            self._grouped = index
        for kind, rows in self._groups:
            if kind is None:
                tell_rows(rows, self._held)
            else:
                filter_rows(rows, self._held, self._filters[kind])
        complete_rows(index, self._held)

    def _prepare(self, i: int, s: Scenario, estimator: Estimator) -> None:
        """A row's constants, but for its noise."""
        told = s.nominal
        self._drawn[i] = (s, estimator)
        self._put("tasks", i, s.manoeuvre.init(replace(told, vehicle=s.vehicle)).task)
        self._put("views", i, self.encoder.view(told))
        worthy = worth(s)
        self._put("worths", i, worthy)
        self._memories[i] = reward_memory(worthy.value)
        if isinstance(self.controller, MomentControl):
            self._put("laws", i, self.controller.init(told).constants)
        self._kinds[i] = None
        self.lanes.friction_at[i] = -1
        if isinstance(estimator, GaussianFilter):
            state = estimator.init(told, stream(0, "estimator"))
            kind = self._kinds[i] = state.constants._numba_type_
            if kind not in self._filters:
                self._filters[kind] = listed(state.constants, self.count)
            put(self._filters[kind], i, state.constants)
            self._beliefs[i] = state.belief
            self.lanes.size[i] = state.belief.size
            self.lanes.friction_at[i] = getattr(state.model, "found", {}).get("friction", -1)

    def _put(self, name: str, i: int, item: Any) -> None:
        if name not in self._lists:
            self._lists[name] = listed(item, self.count)
        put(self._lists[name], i, item)


def _belief(estimator: Estimator, scenario: Scenario) -> Array:
    """What a filter believes before its first reading; nothing where there is no filter."""
    if not isinstance(estimator, GaussianFilter):
        return np.empty(0)
    belief: Array = estimator.init(scenario.nominal, stream(0, "estimator")).belief
    return belief
