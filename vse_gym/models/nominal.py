"""What estimators and controllers are told of the car, its sensors and the drive."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from vse_gym.physics.parameters import Vehicle, check_vehicle


class DataSheet(NamedTuple):
    """Standard deviation of each kind of sensor in its good days: the core of its noise, without what goes wrong."""

    acceleration: float  # [m/s2]
    yaw_rate: float  # [rad/s]
    wheel_speed: float  # [rad/s]
    steer: float  # road-wheel angle [rad]
    brake: float  # of the torque from pressure, relative [-]
    speed: float = math.nan  # optical, over ground; NaN: not on board, as for the next two [m/s]
    sideslip: float = math.nan  # optical [rad]
    roll_rate: float = math.nan  # [rad/s]


def check_sheet(sheet: DataSheet) -> DataSheet:
    """The data sheet itself, if it can be one.

    Raises:
        ValueError: If a number cannot be; the message names it.
    """
    if not isinstance(sheet, DataSheet):
        raise ValueError(f"sheet must be a DataSheet, not {sheet!r}")
    for name, sigma in sheet._asdict().items():
        if name in DataSheet._field_defaults:
            possible, expected = sigma != sigma or 0 < sigma < math.inf, "positive, or NaN: not on board"
        elif name in ("steer", "brake"):
            possible, expected = 0 <= sigma < math.inf, "finite and not negative"
        else:
            possible, expected = 0 < sigma < math.inf, "finite and positive: a filter divides by it"
        if not possible:
            raise ValueError(f"sheet.{name} must be {expected}, not {sigma}")
    return sheet


@dataclass(frozen=True)
class Nominal:
    """What estimators and controllers are told. Different from the truth on purpose.

    Raises:
        ValueError: If the vehicle, the data sheet, friction, speed or dt cannot be.
    """

    vehicle: Vehicle
    sheet: DataSheet
    speed: float  # at the start [m/s]
    friction: float = 0.9  # [-]
    dt: float = 0.01  # between readings [s]

    def __post_init__(self) -> None:
        check_vehicle(self.vehicle)
        check_sheet(self.sheet)
        if not 0 < self.friction <= 2:
            raise ValueError(f"friction must lie in (0, 2], not {self.friction}")
        if not (0 < self.dt < math.inf and 0 <= self.speed < math.inf):
            raise ValueError(f"dt must be positive and speed not negative, not {self.dt} and {self.speed}")
