"""Tables of a TOML file, held against the fields of the dataclass that they become."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from numbers import Real
from typing import Any

from vse_gym.manoeuvres.base import si


def _number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _list_of(kind: Callable[[Any], bool], value: Any) -> bool:
    return isinstance(value, list | tuple) and all(map(kind, value))


# What is written for a field, by its annotation: how it is said, and whether a value is one.
KINDS: dict[Any, tuple[str, Callable[[Any], bool]]] = {
    bool: ("true or false", lambda v: isinstance(v, bool)),
    str: ("a word in quotes", lambda v: isinstance(v, str)),
    int: ("a whole number", lambda v: isinstance(v, int) and not isinstance(v, bool)),
    float: ("a number", _number),
    tuple[float, float]: ("two numbers, as [1.0, 1.25]", lambda v: _list_of(_number, v) and len(v) == 2),
    tuple[str, ...]: ('a list of words, as ["ekf", "ukf"]', lambda v: _list_of(lambda w: isinstance(w, str), v)),
    tuple[Mapping[str, Any], ...]: (
        "tables, each under a line [[cell]]",
        lambda v: _list_of(lambda table: isinstance(table, Mapping), v),
    ),
    Mapping[str, Any]: ("a table, as { speed_kmh = 80 }", lambda v: isinstance(v, Mapping)),
}


def kinds_of(kind: type) -> dict[str, Any]:
    """Annotations of a dataclass by the names of its fields."""
    return {f.name: f.type for f in fields(kind)}


def needed_of(kind: type) -> list[str]:
    """Fields of a dataclass that have no default."""
    return [f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]


def check(
    table: Mapping[str, Any],
    kinds: Mapping[str, Any],
    needed: Iterable[str] = (),
    refusal: str = "there is no",
    units: bool = False,
) -> None:
    """Hold a table against annotations by name; those that :data:`KINDS` lacks are not looked at.

    Args:
        table: As it is written.
        kinds: Annotations of what may be written.
        needed: What must be written.
        refusal: Begins the sentence about a name that does not exist.
        units: Whether a number may be in the unit of its name's suffix, as ``speed_kmh``.

    Raises:
        TypeError: If a name does not exist or lacks, or a value is of another kind; the message says what may be.
    """
    bare = {name: next(iter(si({name: 0}))) if units and name not in kinds else name for name in table}
    many = {name for name, kind in kinds.items() if kind == tuple[float, float]}  # these have no unit
    if wrong := [name for name, n in bare.items() if n not in kinds or (n != name and n in many)]:
        raise TypeError(f"{refusal} {', '.join(wrong)}; known: {', '.join(kinds)}")
    if lacking := [f"{name}, {KINDS[kinds[name]][0]}" for name in needed if name not in table]:
        raise TypeError(f"it lacks {' and '.join(lacking)}")
    for name, value in table.items():
        said, fits = KINDS.get(float if name != bare[name] else kinds[name], ("", lambda _: True))
        if not fits(value):
            raise TypeError(f"{name} must be {said}, not {value!r}")
    if twice := sorted({n for n in bare.values() if list(bare.values()).count(n) > 1}):
        raise TypeError(f"{twice[0]} is given twice: {', '.join(name for name, n in bare.items() if n == twice[0])}")
