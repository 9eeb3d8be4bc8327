"""What an environment drives: a scenario and an estimator, drawn anew at every reset."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.models import Nominal
from vse_gym.physics.parameters import Vehicle
from vse_gym.randomise import Randomise, drawn
from vse_gym.scenarios import Scenario, scenario
from vse_gym.sensors import Sensors, stream

AS_WRITTEN = Randomise()


@dataclass(frozen=True)
class Episodes:
    """The scenarios as written, one for each set of sensors; the estimators; and what is drawn about them."""

    written: tuple[Scenario, ...]
    estimators: tuple[Estimator, ...]
    randomise: Randomise

    def draw(self, seed: int) -> tuple[Scenario, Estimator]:
        """The drive of a seed; with nothing to draw from, the one that is written."""
        if len(self.written) == len(self.estimators) == 1 and self.randomise == AS_WRITTEN:
            return self.written[0], self.estimators[0]
        draw = stream(seed, "episode")
        which, who = (int(draw.integers(len(choices))) for choices in (self.written, self.estimators))
        side = float(draw.choice([-1.0, 1.0]))
        base = self.written[which]
        if self.randomise != AS_WRITTEN:
            base = drawn(base, self.randomise, draw, side)
        return base, self.estimators[who]


def episodes(
    manoeuvre: str | Manoeuvre,
    estimator: str | Estimator | Sequence[str | Estimator],
    vehicle: str | Vehicle,
    sensors: str | Sensors | Sequence[str | Sensors],
    nominal: Nominal | None,
    plant: str,
    randomise: Randomise,
    **settings: Any,
) -> Episodes:
    """Episodes from names; where one of several names is drawn, a sequence of them is given.

    Raises:
        UnknownNameError, ValueError, TypeError: If a name, a number or a setting cannot be; the message says what can.
    """
    suites, members = _choices("sensors", sensors), _choices("estimator", estimator)
    written = tuple(scenario(manoeuvre, vehicle, suite, nominal, plant, **settings) for suite in suites)
    return Episodes(written, tuple(ESTIMATORS.make(member) for member in members), randomise)


def _choices(name: str, given: Any) -> tuple[Any, ...]:
    choices = tuple(given) if isinstance(given, list | tuple) else (given,)
    if not choices:
        raise ValueError(f"{name} must be one name or several to draw from, not an empty list")
    return choices
