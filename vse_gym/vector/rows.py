"""Drives side by side in one thread: what each row drives, and one step of all of them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

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
from vse_gym.scenarios import Scenario
from vse_gym.sensing import read_sensors, unread_sensors
from vse_gym.sensors import stream
from vse_gym.types import NO_TORQUE, Array
from vse_gym.vector.lanes import (
    ESTIMATE,
    READING,
    TRUTH,
    Lanes,
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
NO_BELIEF = np.empty(0)
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
    return type(controller) is NoControl or (
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


def lanes_of(episodes: Episodes, encoder: Encoder, count: int) -> Lanes:
    """Lanes that have room for whatever is drawn."""
    first = episodes.written[0]
    driver = first.manoeuvre.init(first.nominal).memory.size
    delay = max(round(s.sensors.delay / s.dt) for s in episodes.written)
    beliefs = [_belief(e, s).size for e in episodes.estimators for s in episodes.written]
    unit = released_brakes(first.brake_unit, first.dt).shape[0]
    return lanes(count, unit, delay, driver, max(beliefs), encoder.low.size)


class Rows:
    """n drives. ``start`` begins a row's drive anew, ``step`` drives rows on; ``lanes`` says where they are."""

    def __init__(self, episodes: Episodes, controller: Controller, action: str, encoder: Encoder, own: Lanes):
        self.episodes, self.controller, self.encoder, self.count = episodes, controller, encoder, own.k.size
        self._by_moment, self._layout = action == "yaw_moment", LAYOUTS[encoder.layout]
        first = episodes.written[0]
        self._substeps, self._substep = first.substeps, first.substep
        self._runge_kutta = first.integrator == "runge_kutta"
        self.lanes, self._held = own, hold(own)
        self._rows: list[Constants | None] = [None] * self.count
        self._shared: dict[tuple[int, int], Constants] = {}  # of what is written, by scenario and estimator
        self._filters: dict[Any, Any] = {}  # lists of rule and model, by kind
        self._lists: dict[str, Any] = {}  # of what every row has
        self._groups: list[tuple[Any, Index]] = []  # rows of a kind, among those last stepped
        self._grouped: Index = np.empty(0, dtype=np.int64)

    def start(self, i: int, seed: int) -> None:
        """Begin a row's drive: the same as ``Simulation.reset`` with this seed."""
        s, estimator = self.episodes.draw(seed)
        v, row = self.lanes, np.array([i])
        own = self._constants(s, estimator)
        if self._rows[i] is not own:
            self._place(i, own)
        record = s.sensors.record(s.steps + 1, s.dt, seed)
        self._put("plants", i, hold((s.brake_unit, s.nominal.vehicle.geometry, s.vehicle, own.road, record)))
        for array in (v.unit, v.driver, v.law, v.base, v.asked, v.seen, v.totals):
            array[i] = 0.0
        v.k[i], v.steps[i], v.depth[i], v.ended[i], v.steer[i], v.reward[i] = 0, s.steps, 1 + record.delay, 0, 0.0, 0.0
        v.wanted[i] = own.memory
        v.state[i] = rolling_start(s.vehicle, s.manoeuvre.speed)
        rest, memory = p.Inputs(0.0, NO_TORQUE, NO_TORQUE), unread_sensors(record.delay, v.state[i])
        v.u[i], v.y[i], v.sensed[i, : v.depth[i]] = read_sensors(record, 0, v.state[i], rest, memory)
        v.belief[i, : v.size[i]] = own.belief
        self._estimate(row)
        observe_rows(row, self._held, self._lists["views"], self._layout)
        self._grouped = self._grouped[:0]

    def step(self, index: Index, actions: Array, again: Sequence[tuple[int, int]] = ()) -> None:
        """Drive rows on to their next reading, and begin others anew.

        Args:
            index: Which rows to drive, in order.
            actions: Of all rows, (n, size).
            again: Which rows to begin anew, each with its seed.
        """
        held, lists = self._held, self._lists
        if "laws" in lists:
            decide_rows(index, held, lists["laws"])
        way = (self._runge_kutta, self._substeps, self._substep)
        drive_rows(index, held, lists["plants"], lists["tasks"], actions, self._by_moment, *way)
        self._estimate(index)
        judge_rows(index, held, lists["plants"], lists["worths"], lists["tasks"])
        observe_rows(index, held, lists["views"], self._layout)
        for i, seed in again:
            self.start(i, seed)

    def describe(self) -> None:
        """Bring the table of ``lanes.TABLE`` up to date."""
        describe_rows(self._held, self._lists["worths"])

    def _estimate(self, index: Index) -> None:
        if index is not self._grouped:
            kinds = [own.kind for own in map(self._rows.__getitem__, index) if own is not None]
            self._groups = [(kind, index[[other == kind for other in kinds]]) for kind in set(kinds)]
            self._grouped = index
        for kind, rows in self._groups:
            if kind is None:
                tell_rows(rows, self._held)
            else:
                filter_rows(rows, self._held, self._filters[kind])

    def _constants(self, s: Scenario, estimator: Estimator) -> "Constants":
        """Of a drive; what is written and drawn again and again is shared by all rows, whose caches it fits into."""
        key = (id(s), id(estimator))
        if key in self._shared:
            return self._shared[key]
        constants = _prepared(s, estimator, self.controller, self.encoder)
        if any(s is written for written in self.episodes.written):
            self._shared[key] = constants
        return constants

    def _place(self, i: int, own: "Constants") -> None:
        """Give a row its constants, but for its noise."""
        self._rows[i] = own
        self._put("tasks", i, own.task)
        self._put("views", i, own.view)
        self._put("worths", i, own.worth)
        if own.law is not None:
            self._put("laws", i, own.law)
        self.lanes.size[i], self.lanes.friction_at[i] = own.belief.size, own.friction_at
        if own.kind is not None:
            if own.kind not in self._filters:
                self._filters[own.kind] = listed(own.filter, self.count)
            put(self._filters[own.kind], i, own.filter)

    def _put(self, name: str, i: int, item: Any) -> None:
        if name not in self._lists:
            self._lists[name] = listed(item, self.count)
        put(self._lists[name], i, item)


class Constants(NamedTuple):
    """What stays the same in a drive, but for its noise; what compiled code reads is held."""

    road: p.Road
    task: Any
    view: Any
    worth: Any
    memory: Array  # of the reward, at the start
    law: Any = None  # None: nobody controls
    filter: Any = None  # rule and model; None: true states
    kind: Any = None  # numba's type of the filter
    belief: Array = NO_BELIEF  # before the first reading
    friction_at: int = -1  # place of the friction in the belief; -1: it has none


def _prepared(s: Scenario, estimator: Estimator, controller: Controller, encoder: Encoder) -> Constants:
    told, worthy = s.nominal, worth(s)
    task = s.manoeuvre.init(replace(told, vehicle=s.vehicle)).task
    law = controller.init(told).constants if isinstance(controller, MomentControl) else None
    constants = Constants(s.road, task, encoder.view(told), worthy, reward_memory(worthy.value), law)
    if not isinstance(estimator, GaussianFilter):
        return constants
    state = estimator.init(told, stream(0, "estimator"))
    place = getattr(state.model, "found", {}).get("friction", -1)
    kind = state.constants._numba_type_
    return constants._replace(filter=state.constants, kind=kind, belief=state.belief, friction_at=place)


def _belief(estimator: Estimator, scenario: Scenario) -> Array:
    """What a filter believes before its first reading; nothing where there is no filter."""
    if not isinstance(estimator, GaussianFilter):
        return NO_BELIEF
    belief: Array = estimator.init(scenario.nominal, stream(0, "estimator")).belief
    return belief
