"""What every tuning of a model offers to the filters, and how a tuning says where to look for better numbers."""

import math
from collections.abc import Iterable
from dataclasses import Field, field, fields
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Protocol, get_args, runtime_checkable

from vse_gym.models.nominal import Nominal
from vse_gym.types import CHANNELS


@runtime_checkable
class ModelTuning(Protocol):
    """How far a filter trusts a model of the car."""

    def build(self, nominal: Nominal) -> Any:
        """The model of a nominal car: a NamedTuple as :mod:`vse_gym.inference.model` describes it."""


def tunable(default: float, low: float, high: float) -> Any:
    """A field of a frozen dataclass that `vse-gym tune` may change.

    Args:
        default: As without a search.
        low, high: Where to search, both included: on a logarithmic scale, or on a linear one if ``low`` is zero.

    Raises:
        ValueError: If the default does not lie in the range, or the range is none.
    """
    if not (0 <= low < high and low <= default <= high):
        raise ValueError(f"a range must not be negative and hold the default, not [{low}, {high}] and {default}")
    return field(default=default, metadata={"tune": (low, high)})


class Settings:
    """Base of the frozen dataclasses that hold tunings: each field refuses what its annotation says that it is not."""

    def __post_init__(self) -> None:
        """Look at every field; who has a ``__post_init__`` of its own calls this one first.

        Raises:
            ValueError: If a number is NaN, a whole number is none or below 1, or what ``tunable`` declares negative.
            TypeError: If a part is of another kind, as a name in the place of an estimator is.
        """
        for each in fields(self):  # type: ignore[arg-type]
            _check_setting(each, getattr(self, each.name))


def _check_setting(declared: Field[Any], value: Any) -> None:
    if declared.type is int:
        if not (isinstance(value, Integral) and int(value) >= 1):
            raise ValueError(f"{declared.name} must be a whole number, at least 1, not {value!r}")
    elif declared.type is float:
        if not isinstance(value, Real) or math.isnan(value):
            raise ValueError(f"{declared.name} must be a number, not {value!r}")
        if "tune" in declared.metadata and value < 0:
            raise ValueError(f"{declared.name} must not be negative, not {value!r}")
    else:
        kinds = get_args(declared.type) if isinstance(declared.type, UnionType) else (declared.type,)
        if all(map(_is_part, kinds)) and not isinstance(value, kinds):
            told = " or ".join(kind.__name__ for kind in kinds)
            raise TypeError(f"{declared.name} must be of kind {told}, not {value!r}")


def _is_part(kind: Any) -> bool:
    """Whether a setting annotated so is a word or holds settings of its own; of others nothing is known."""
    return kind is ModelTuning or (isinstance(kind, type) and issubclass(kind, (str, NoneType, Settings)))


def check_positive(**settings: float) -> None:
    """Refuse settings that are not positive and finite.

    Raises:
        ValueError: If one is not.
    """
    for name, value in settings.items():
        if not 0 < value < math.inf:
            raise ValueError(f"{name} must be positive and finite, not {value}")


def check_not_negative(**settings: float) -> None:
    """Refuse settings that are negative or not finite.

    Raises:
        ValueError: If one is.
    """
    for name, value in settings.items():
        if not 0 <= value < math.inf:
            raise ValueError(f"{name} must be finite and not negative, not {value}")


def check_range(low: float, high: float, **settings: float) -> None:
    """Refuse settings outside a range, both ends of which are allowed.

    Raises:
        ValueError: If one is.
    """
    for name, value in settings.items():
        if not low <= value <= high:
            raise ValueError(f"{name} must lie in [{low}, {high}], not {value}")


def check_channels(setting: str, named: Iterable[str], known: Iterable[str] = CHANNELS) -> None:
    """Refuse a setting that names channels that there are not.

    Raises:
        ValueError: If there is one; the message lists those that there are.
    """
    known = tuple(known)
    if wrong := set(named) - set(known):
        raise ValueError(f"{setting} names no such channel: {sorted(wrong)}; known: {', '.join(known)}")
