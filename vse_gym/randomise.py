"""A scenario drawn anew: speed, steering, side, friction, load, tyres and the rest of what nobody is told."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from vse_gym.manoeuvres.base import si
from vse_gym.physics.parameters import PerWheel, RollingBody, Vehicle
from vse_gym.scenarios import Scenario
from vse_gym.schema import check, kinds_of


@dataclass(frozen=True)
class Randomise:
    """How a scenario is drawn; nothing of it is told to estimators.

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


def drawn(scenario: Scenario, randomise: Randomise, draw: np.random.Generator, side: float) -> Scenario:
    """A scenario with what was drawn about what is written in it.

    Args:
        scenario: As written; ``nominal`` stays what it is.
        randomise: The ranges.
        draw: Its generator; each range takes as many draws as ever, whatever the others are.
        side: 1, or -1 to mirror the drive if the steering is drawn.
    """
    written, car = scenario.manoeuvre, scenario.vehicle
    ranges = (randomise.speed, randomise.steer, randomise.friction)
    speed, steer, friction = (draw.uniform(-r, r) for r in ranges)
    mass, stiffness = draw.uniform(*randomise.mass), draw.uniform(*randomise.stiffness)
    if not randomise.steer:
        side = 1.0
    changes: dict[str, Any] = {"speed": written.speed + speed, "friction": _icy(written.friction + friction)}
    known = {f.name: getattr(written, f.name) for f in fields(written)}
    if "side" in known:
        changes["side"] = known["side"] * side
    if known.get("amplitude") is not None:
        changes["amplitude"] = known["amplitude"] * side * (1 + steer)
    if known.get("friction_after") is not None:
        changes["friction_after"] = _icy(known["friction_after"] + friction)
    if "jump" in known:  # where it lies does not depend on the speed that was drawn
        changes["jump"] = known["jump"] * written.speed / changes["speed"]
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
    return replace(scenario, manoeuvre=replace(written, **changes), vehicle=driven)


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
