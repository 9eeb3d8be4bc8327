"""One drive of a study, and how it is drawn anew for every seed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from vse_gym.catalogue import CONTROLLERS, MANOEUVRES
from vse_gym.evaluation.schema import check, kinds_of
from vse_gym.manoeuvres.base import si
from vse_gym.models import Nominal
from vse_gym.physics.parameters import PerWheel, RollingBody, Vehicle
from vse_gym.registry import UnknownNameError
from vse_gym.sensors import stream, suite
from vse_gym.simulation import PLANTS, Scenario, fitting_integrator
from vse_gym.vehicles import load


@dataclass(frozen=True)
class Randomise:
    """How a cell is drawn for each seed; nothing of it is told to estimators.

    Raises:
        ValueError: If a range is negative or reversed.
    """

    speed: float = 0.0  # +/- [m/s]
    steer: float = 0.0  # +/- of the hand wheel's amplitude, relative; if not zero the sides take turns [-]
    friction: float = 0.0  # +/- [-]
    mass: tuple[float, float] = (1.0, 1.0)  # times
    stiffness: tuple[float, float] = (1.0, 1.0)  # times, cornering stiffness of every tyre
    steering_offset: float = 0.0  # +/- of the road wheels with the hand wheel straight [rad]
    radius_error: float = 0.0  # +/- of each wheel by itself, relative [-]
    slope: float = 0.0  # +/- [rad]
    bank: float = 0.0  # +/- [rad]
    gravity_shift: float = 0.0  # +/- of the centre of gravity, positive rearwards, the axles where they are [m]

    def __post_init__(self) -> None:
        for name, value in ((f.name, getattr(self, f.name)) for f in fields(self)):
            if isinstance(value, tuple) and not 0 < value[0] <= value[1]:
                raise ValueError(f"{name} must be two positive numbers, the lower first, not {list(value)}")
            if not isinstance(value, tuple) and not value >= 0:
                raise ValueError(f"{name} is drawn to both sides and must not be negative, not {value}")

    def with_changes(self, table: Mapping[str, Any]) -> "Randomise":
        """These ranges but for those that a table of a study's file names, SI or with a unit's suffix.

        Raises:
            TypeError: If there is no such range, or it is of another kind; the message says what there is.
            ValueError: If a range is negative or reversed.
        """
        check(table, kinds_of(Randomise), refusal="cannot randomise", units=True)
        changes: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in si(table).items()}
        return replace(self, **changes)


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
        randomise = randomise.with_changes(self.randomise)
        draw = stream(seed, f"cell/{self.name}")
        ranges = (randomise.speed, randomise.steer, randomise.friction)
        speed, steer, friction = (draw.uniform(-r, r) for r in ranges)
        mass, stiffness = draw.uniform(*randomise.mass), draw.uniform(*randomise.stiffness)
        side = _side(self.name, seed) if randomise.steer else 1.0
        changes: dict[str, Any] = {"speed": written.speed + speed, "friction": _icy(written.friction + friction)}
        known = {f.name for f in fields(written)}
        if "side" in known:
            changes["side"] = written.side * side
        if "amplitude" in known and written.amplitude is not None:
            changes["amplitude"] = written.amplitude * side * (1 + steer)
        if "friction_after" in known and written.friction_after is not None:
            changes["friction_after"] = _icy(written.friction_after + friction)
        if "jump" in known:  # where it lies does not depend on the speed that was drawn
            changes["jump"] = written.jump * written.speed / changes["speed"]
        told = Nominal(car, noise.sheet, written.speed)
        # Drawn last, so that what was drawn before these conditions existed stays as it was.
        conditions = [randomise.steering_offset, *4 * [randomise.radius_error], randomise.slope, randomise.bank]
        offset, *radius_errors, slope, bank = (draw.uniform(-r, r) for r in conditions)
        changes |= {"slope": written.slope + slope, "bank": written.bank + bank}
        shift = draw.uniform(-randomise.gravity_shift, randomise.gravity_shift)
        driven = _changed(car, mass, stiffness)._replace(
            steering_offset=offset,
            radius_error=PerWheel(*radius_errors),
            lf=car.lf + shift,
            lr=car.lr - shift,
        )
        way: dict[str, Any] = {"integrator": fitting_integrator(driven), "plant": self.plant}
        return Scenario(replace(written, **changes), driven, noise, told, **way)


def _side(cell: str, seed: int) -> float:
    """To which side a seed's drive goes: in turn, so that no table leans; which goes first differs between cells."""
    first = stream(0, f"side/{cell}").integers(2)
    return 1.0 if (seed + first) % 2 == 0 else -1.0


def _icy(friction: float) -> float:
    """No road is smoother than wet ice, whatever was drawn."""
    return max(0.05, friction)


def _changed(car: Vehicle, mass: float, stiffness: float) -> Vehicle:
    tyres = {
        axle: tyre._replace(cornering_stiffness=tyre.cornering_stiffness * stiffness)
        for axle, tyre in (("front_tyre", car.front_tyre), ("rear_tyre", car.rear_tyre))
    }
    body = car.body
    if isinstance(body, RollingBody):  # what is loaded rides on the springs
        body = body._replace(sprung_mass=body.sprung_mass + car.mass * (mass - 1))
    return car._replace(mass=car.mass * mass, body=body, **tyres)
