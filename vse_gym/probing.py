"""Looking into an estimator, a controller or a manoeuvre while it works: the tools of :mod:`vse_gym.testing`."""

import copy
import random
from collections.abc import Sequence
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

import numpy as np

from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.types import (
    U_STEER,
    WHEELS,
    Y_AY,
    Y_ROLL_RATE,
    Y_SIDESLIP,
    Y_YAW_RATE,
    Array,
    BrakeDemand,
    Car,
    Driver,
    Estimate,
    Reading,
)

Owner = Estimator | Controller | Manoeuvre
MIRRORED = [1, 0, 3, 2]  # the wheels, left and right exchanged


class Block:
    """An estimator, a controller or a manoeuvre, and what it hears or sees, seen alike."""

    def __init__(self, owner: Owner, nominal: Nominal, heard: Sequence[Sequence[Any]]):
        self.owner: Any = owner
        self.nominal, self.estimates = nominal, isinstance(owner, Estimator)
        self.answer = "drive" if isinstance(owner, Manoeuvre) else "act"
        self.items = copy.deepcopy(list(zip(*heard, strict=True)))  # who edits them shall spoil no other check

    def init(self, rng: np.random.Generator) -> Any:
        """The state at the start."""
        return self.owner.init(self.nominal, rng) if self.estimates else self.owner.init(self.nominal)

    def step(self, state: Any, item: tuple[Any, ...], rng: np.random.Generator) -> tuple[Any, Any]:
        """State and output after one more item."""
        if not self.estimates:
            output, state = getattr(self.owner, self.answer)(state, *item)
            return state, output
        if self.owner.told_friction:
            state = self.owner.tell_friction(state, self.nominal.friction)
        state = self.owner.update(state, *item, rng)
        return state, self.owner.estimate(state)

    def go_on(self, state: Any, items: Sequence[Any], rng: np.random.Generator) -> list[Any]:
        """Outputs of a drive that goes on from a state."""
        outputs = []
        for item in items:
            state, output = self.step(state, item, rng)
            outputs.append(output)
        return outputs

    def drive(self, items: Sequence[Any] | None = None, rng: np.random.Generator | None = None) -> list[Any]:
        """Outputs of a whole drive."""
        rng = rng or np.random.default_rng(0)
        return self.go_on(self.init(rng), self.items if items is None else items, rng)


def require(kept: bool, broken: str) -> None:
    """Raise an AssertionError with a sentence, also where Python runs without asserts."""
    if not kept:
        raise AssertionError(broken)


def who(owner: Owner) -> str:
    """The name of its class."""
    return type(owner).__name__


def contents(thing: Any, where: str = "it", found: dict[str, Any] | None = None) -> dict[str, Any]:
    """Everything that an object holds, bit by bit, each with its path; walks what pickle would store."""
    facts: dict[str, Any] = {} if found is None else found
    parts: Any = ()
    if thing is None or isinstance(thing, type | FunctionType | BuiltinFunctionType | ModuleType):
        facts[where] = thing
    elif isinstance(thing, bool | int | float | complex | str | bytes | np.generic):
        facts[where] = repr(thing)
    elif isinstance(thing, np.ndarray) and thing.dtype != object:
        facts[where] = thing.dtype.str, thing.shape, thing.tobytes()
    elif isinstance(thing, dict):
        facts[where], parts = len(thing), ((f"[{key!r}]", value) for key, value in thing.items())
    elif isinstance(thing, tuple | list):
        names = getattr(thing, "_fields", range(len(thing)))
        facts[where], parts = len(thing), ((f".{name}", value) for name, value in zip(names, thing, strict=True))
    else:
        try:
            stored = thing.__reduce_ex__(4)
        except Exception as error:
            raise AssertionError(f"{where}, a {type(thing).__name__}, cannot be pickled: keep plain data") from error
        how = (
            [stored]
            if isinstance(stored, str)
            else [p if k < 3 or p is None else list(p) for k, p in enumerate(stored)]
        )
        facts[where], parts = type(thing), (("" if k == 2 else f"~{k}", part) for k, part in enumerate(how))
    for name, part in parts:
        contents(part, where + name, facts)
    return facts


def global_generators() -> dict[str, Any]:
    """Contents of the generators that everybody shares and nobody should use."""
    return contents([random.getstate(), np.random.get_state(legacy=False)])  # noqa: NPY002 - to see that nobody used it


def differences(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Paths of what differs; empty if nothing does."""
    return ", ".join(sorted(path for path in before.keys() | after.keys() if before.get(path) != after.get(path))[:5])


def mirror(thing: Any) -> Any:
    """Left and right exchanged: in a reading, an estimate, a demand, a car, a driver, or a tuple of them."""
    if isinstance(thing, Reading):
        u, y = thing.inputs.copy(), thing.y.copy()
        u[U_STEER] *= -1
        u[1:] = u[1:].reshape(2, 4)[:, MIRRORED].ravel()  # brake and drive torques
        y[[Y_AY, Y_YAW_RATE, Y_SIDESLIP, Y_ROLL_RATE]] *= -1
        y[WHEELS] = y[WHEELS][MIRRORED]
        return Reading(thing.time, u, y)
    if isinstance(thing, Estimate):
        signs = np.array([1.0, -1.0, -1.0])
        odd = {name: -getattr(thing, name) for name in ("vy", "yaw_rate", "ay", "roll", "roll_rate")}
        return thing._replace(cov=thing.cov * np.outer(signs, signs), **odd)
    if isinstance(thing, BrakeDemand):
        return BrakeDemand(thing.added[MIRRORED], thing.release[MIRRORED])
    if isinstance(thing, Driver):
        return Driver(-thing.hand_wheel, thing.drive[MIRRORED], thing.brake[MIRRORED])
    if isinstance(thing, Car):
        return Car(_mirrored_state(thing.state))
    return tuple(map(mirror, thing)) if isinstance(thing, tuple) else thing


def _mirrored_state(state: Array) -> Array:
    out = state.copy()
    out[[p.Y, p.YAW, p.VY, p.YAW_RATE, p.LOAD_AY, p.AY, p.ROLL, p.ROLL_RATE]] *= -1
    for first, sign in ((p.WHEEL, 1.0), (p.LAG_X, 1.0), (p.LAG_Y, -1.0)):
        out[first : first + 4] = sign * out[first : first + 4][MIRRORED]
    return out
