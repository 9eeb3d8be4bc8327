"""One drive of a study, and how it is drawn anew for every seed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass
from typing import Any

from vse_gym.catalogue import CONTROLLERS, MANOEUVRES
from vse_gym.manoeuvres.base import si
from vse_gym.models import Nominal
from vse_gym.randomise import Randomise, drawn
from vse_gym.registry import UnknownNameError
from vse_gym.scenarios import PLANTS, Scenario, fitting_integrator
from vse_gym.schema import check, kinds_of
from vse_gym.sensors import stream, suite
from vse_gym.vehicles import load


@dataclass(frozen=True)
class Cell:
    """One drive of a study, as it is written down: by names, so that a row says what was driven.

    Raises:
        UnknownNameError, TypeError, ValueError: If a name or a setting cannot be; the message says what can.
    """

    name: str
    manoeuvre: str
    vehicle: str = "qin2014_understeer"
    controller: str = "esc"
    sensors: str = "gaussian"
    plant: str = "double_track"
    benign: bool = False  # a drive that needs no help: only needless braking counts
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the manoeuvre, SI or with a unit's suffix
    randomise: Mapping[str, Any] = field(default_factory=dict)  # ranges that differ from the study's, likewise

    def __post_init__(self) -> None:
        Randomise().with_changes(self.randomise)
        CONTROLLERS[self.controller], suite(self.sensors), load(self.vehicle)
        if self.plant not in PLANTS:
            raise UnknownNameError(f"no plant named {self.plant!r}; known: {', '.join(PLANTS)}")
        kind = MANOEUVRES[self.manoeuvre]
        if is_dataclass(kind):
            check(self.settings, kinds_of(kind), refusal=f"manoeuvre {self.manoeuvre!r} has no setting", units=True)
        MANOEUVRES.make(self.manoeuvre, **si(self.settings))

    def scenario(self, randomise: Randomise, seed: int) -> Scenario:
        """The cell as one seed draws it; estimators are told what is written."""
        written = MANOEUVRES.make(self.manoeuvre, **si(self.settings))
        car, noise = load(self.vehicle), suite(self.sensors)
        told = Nominal(car, noise.sheet, written.speed)
        scenario = Scenario(written, car, noise, told, integrator=fitting_integrator(car), plant=self.plant)
        randomise = randomise.with_changes(self.randomise)
        return drawn(scenario, randomise, stream(seed, f"cell/{self.name}"), _side(self.name, seed))


def _side(cell: str, seed: int) -> float:
    """To which side a seed's drive goes: in turn, so that no table leans; which goes first differs between cells."""
    first = stream(0, f"side/{cell}").integers(2)
    return 1.0 if (seed + first) % 2 == 0 else -1.0
