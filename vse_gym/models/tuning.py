"""What every tuning of a model offers to the filters."""

from typing import Any, Protocol

from vse_gym.models.nominal import Nominal


class ModelTuning(Protocol):
    """How far a filter trusts a model of the car."""

    def build(self, nominal: Nominal) -> Any:
        """The model of a nominal car: a NamedTuple as :mod:`vse_gym.inference.model` describes it."""
