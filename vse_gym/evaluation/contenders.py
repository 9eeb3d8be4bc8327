"""Who is judged: estimators by the names of their rows, and what tells two of them apart."""

import pickle
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from hashlib import blake2b
from pathlib import Path
from types import FunctionType
from uuid import uuid4
from weakref import WeakKeyDictionary

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
    """Of an estimator's class and settings; of the code too if it is not ours, which has a digest of its own."""
    return digest(_said(estimator))


def _said(thing: object) -> object:
    """What is alike for equal settings, and differs for others."""
    if isinstance(thing, bool | str | None):
        return repr(thing)
    if isinstance(thing, int | float):
        return repr(float(thing))  # 2 and 2.0 are one setting
    kind = f"{type(thing).__module__}:{type(thing).__qualname__}"
    code = _code_of(type(thing)) if is_dataclass(thing) or isinstance(thing, Estimator) else []
    if is_dataclass(thing) and not isinstance(thing, type):
        held = {f.name: getattr(thing, f.name) for f in fields(thing)} | getattr(thing, "__dict__", {})
        return kind, code, [(name, _said(value)) for name, value in sorted(held.items())]
    try:
        return kind, code, joblib.hash(thing)
    except (pickle.PicklingError, TypeError, AttributeError):  # it holds a function, a lock, ...
        if isinstance(thing, FunctionType):
            return kind, thing.__code__.co_code.hex(), repr(thing.__code__.co_consts)
        attributes = sorted(getattr(thing, "__dict__", {}).items())
        told = [(name, _said(value)) for name, value in attributes] or re.sub(r" at 0x[0-9a-f]+", "", repr(thing))
        return kind, code, told


def _code_of(kind: type) -> list[str]:
    """Digests of the code that a class and its bases are made of, but for ours and the standard library's."""
    found = []
    for base in kind.__mro__:
        top = base.__module__.partition(".")[0]
        if top == "vse_gym" or (top in sys.stdlib_module_names and top != "__main__"):
            continue
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        found.append(_neighbours(Path(file)) if file and Path(file).is_file() else _typed(base))
    return found


def _neighbours(file: Path) -> str:
    """Of a file and of what has been imported from below its folder: helpers of the class may stand there."""
    folder = file.resolve().parent
    files = {file.resolve()}
    if folder.name != "site-packages":
        loaded = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
        there = [Path(name).resolve() for name in loaded if name and name.endswith(".py")]
        near = {path for path in there if folder in path.parents and "site-packages" not in path.parts}
        files |= {path for path in near if path.is_file()}  # some modules name a file that is none
    return digest(*(f"{path.name}\n{path.read_text(encoding='utf-8', errors='replace')}" for path in sorted(files)))


_TYPED: WeakKeyDictionary[type, str] = WeakKeyDictionary()


def _typed(kind: type) -> str:
    """Of a class typed at a prompt, whose code nobody can read again: never the same in another process."""
    return _TYPED.setdefault(kind, uuid4().hex)


@dataclass(frozen=True)
class Contender:
    """One row's estimator."""

    name: str
    estimator: Estimator
    tuning: str = DEFAULT  # whence its settings, for the table
    parent: str = ""  # of an attribution row: the estimator whose parts it keeps
    part: str = "whole"  # or one of PARTS: what is estimated, the rest being true
    digest: str = ""  # of the estimator; empty: taken now, where its code can be read, as a worker may not

    def __post_init__(self) -> None:
        object.__setattr__(self, "parent", self.parent or self.name)
        object.__setattr__(self, "digest", self.digest or fingerprint(self.estimator))

    @property
    def columns(self) -> dict[str, str]:
        """What its rows say of it."""
        names = {"estimator": self.name, "parent": self.parent, "part": self.part}
        return names | {"tuning": self.tuning, "tuning_digest": self.digest}


def contenders(
    estimators: Judged, tunings: Mapping[str, tuple[Estimator, str]] | None = None, attribution: bool = False
) -> tuple[Contender, ...]:
    """Estimators by the name of their row: a name of the catalogue, or of the class of an instance.

    Args:
        estimators: Names or instances, or a mapping from row names to either.
        tunings: For some names of the catalogue, or module:Class, the estimator to take and what to call its tuning.
        attribution: Add rows in which a part alone is estimated and the rest is true.

    Raises:
        UnknownNameError: If a name is not known.
        ValueError: If two rows would have the same name, or one that of the car without control.
    """
    pairs = list(estimators.items()) if isinstance(estimators, Mapping) else [(_name(e), e) for e in estimators]
    rows: list[Contender] = []
    for name, thing in pairs:
        kind = type(thing)
        tuned = (tunings or {}).get(thing if isinstance(thing, str) else f"{kind.__module__}:{kind.__qualname__}")
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
