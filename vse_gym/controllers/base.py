"""What every controller is."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from vse_gym.models import Nominal
from vse_gym.types import NO_BRAKE, BrakeDemand, Estimate, Reading


class Controller(ABC):
    """A frozen set of tunings; what it remembers travels in a state that it is handed and hands back.

    A controller knows ``Nominal``, estimates and readings, nothing else.
    """

    @abstractmethod
    def init(self, nominal: Nominal) -> Any:
        """The state before the first estimate."""

    @abstractmethod
    def act(self, state: Any, estimate: Estimate, reading: Reading) -> tuple[BrakeDemand, Any]:
        """What to ask of the brake unit until the next reading, and the state after."""


@dataclass(frozen=True)
class NoControl(Controller):
    """Leaves the car to the driver (and to the ABS of the brake unit)."""

    def init(self, nominal: Nominal) -> None:
        return None

    def act(self, state: None, estimate: Estimate, reading: Reading) -> tuple[BrakeDemand, None]:
        return NO_BRAKE, None
