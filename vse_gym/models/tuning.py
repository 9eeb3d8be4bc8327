"""What every tuning of a model offers to the filters, and how a tuning says where to look for better numbers."""

from collections.abc import Iterable
from dataclasses import field
from typing import Any, Protocol

from vse_gym.models.nominal import Nominal
from vse_gym.types import CHANNELS


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


def check_channels(setting: str, named: Iterable[str], known: Iterable[str] = CHANNELS) -> None:
    """Refuse a setting that names channels that there are not.

    Raises:
        ValueError: If there is one; the message lists those that there are.
    """
    known = tuple(known)
    if wrong := set(named) - set(known):
        raise ValueError(f"{setting} names no such channel: {sorted(wrong)}; known: {', '.join(known)}")
