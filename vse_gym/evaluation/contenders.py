"""Who is judged: estimators by the names of their rows, and what tells two of them apart."""

import pickle
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from hashlib import blake2b
from pathlib import Path
from sys import modules
from types import FunctionType

import joblib

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.anchors import Truth
from vse_gym.estimators.base import Estimator

POTENTIAL = "none"  # the row of the car without stability control: what there is to gain; never ranked
DEFAULT = "default"
# Attribution: which fields of an estimate are made true, so that the others alone can do harm
PARTS = {
    "velocity": ("yaw_rate", "ax", "ay"),
    "yaw": ("vx", "vy"),
    "acceleration": ("vx", "vy", "yaw_rate"),  # of the former, what the accelerations alone do
}

Judged = Sequence[str | Estimator] | Mapping[str, str | Estimator]


def digest(*parts: object) -> str:
    """A short fingerprint of what prints alike."""
    return blake2b("\n".join(map(str, parts)).encode(), digest_size=6).hexdigest()


def fingerprint(estimator: Estimator) -> str:
    """Of an estimator's class and settings; of its module's source too if it is not one of ours.

    What that module imports is not looked at.
    """
    inner = fingerprint(estimator.inner) if isinstance(estimator, Truth) and estimator.inner is not None else ""
    return digest(_said(estimator), _source_of(type(estimator)), inner)


def _said(thing: object) -> object:
    """What is alike for equal settings, and differs for others."""
    if isinstance(thing, bool | str | None):
        return repr(thing)
    if isinstance(thing, int | float):
        return repr(float(thing))  # 2 and 2.0 are one setting
    kind = f"{type(thing).__module__}:{type(thing).__qualname__}"
    if is_dataclass(thing) and not isinstance(thing, type):
        held = {f.name: getattr(thing, f.name) for f in fields(thing)} | getattr(thing, "__dict__", {})
        return kind, [(name, _said(value)) for name, value in sorted(held.items())]
    try:
        return kind, joblib.hash(thing)
    except (pickle.PicklingError, TypeError, AttributeError):  # it holds a function, a lock, ...
        if isinstance(thing, FunctionType):
            return kind, thing.__code__.co_code.hex(), repr(thing.__code__.co_consts)
        attributes = sorted(getattr(thing, "__dict__", {}).items())
        return kind, [(name, _said(value)) for name, value in attributes] or re.sub(r" at 0x[0-9a-f]+", "", repr(thing))


def _source_of(kind: type) -> str:
    """The whole module, since a class leans on what stands beside it; nothing of what was typed at a prompt."""
    path = None if kind.__module__.startswith("vse_gym.") else getattr(modules.get(kind.__module__), "__file__", None)
    return Path(path).read_text(encoding="utf-8", errors="replace") if path else ""


@dataclass(frozen=True)
class Contender:
    """One row's estimator."""

    name: str
    estimator: Estimator
    tuning: str = DEFAULT  # whence its settings, for the table
    parent: str = ""  # of an attribution row: the estimator whose parts it keeps
    part: str = "whole"  # or one of PARTS: what is estimated, the rest being true

    @property
    def columns(self) -> dict[str, str]:
        """What its rows say of it."""
        return {
            "estimator": self.name,
            "parent": self.parent or self.name,
            "part": self.part,
            "tuning": self.tuning,
            "tuning_digest": fingerprint(self.estimator),
        }


def contenders(
    estimators: Judged, tunings: Mapping[str, tuple[Estimator, str]] | None = None, attribution: bool = False
) -> tuple[Contender, ...]:
    """Estimators by the name of their row: a name of the catalogue, or of the class of an instance.

    Args:
        estimators: Names or instances, or a mapping from row names to either.
        tunings: For some names of the catalogue, the estimator to take and what to call its tuning.
        attribution: Add rows in which a part alone is estimated and the rest is true.

    Raises:
        UnknownNameError: If a name is not known.
        ValueError: If two rows would have the same name, or one that of the car without control.
    """
    pairs = list(estimators.items()) if isinstance(estimators, Mapping) else [(_name(e), e) for e in estimators]
    rows: list[Contender] = []
    for name, thing in pairs:
        tuned = (tunings or {}).get(thing) if isinstance(thing, str) else None
        made, label = tuned if tuned is not None else (ESTIMATORS.make(thing), DEFAULT)
        rows.append(Contender(name, made, label))
        if attribution:
            rows.extend(_parts_of(rows[-1]))
    names = [row.name for row in rows]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"two estimators named {twice[0]!r}: hand in a mapping from names to estimators")
    if POTENTIAL in names:
        raise ValueError(f"{POTENTIAL!r} is the row of the car without stability control: name the estimator otherwise")
    return tuple(rows)


def _name(thing: str | Estimator) -> str:
    return thing if isinstance(thing, str) else type(thing).__name__


def _parts_of(whole: Contender) -> Iterator[Contender]:
    if isinstance(whole.estimator, Truth):  # a marker is true in part already
        return
    for part, true in PARTS.items():
        inner = Truth(true, inner=whole.estimator)
        yield Contender(f"{whole.name}: {part}", inner, whole.tuning, whole.name, part)
