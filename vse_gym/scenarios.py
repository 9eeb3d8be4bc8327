"""What a drive is made of, but for the estimator, the controller and the seed."""

from dataclasses import dataclass, field
from typing import Any

from vse_gym.catalogue import MANOEUVRES
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.models import Nominal
from vse_gym.multibody import MultiBody
from vse_gym.physics import parameters as p
from vse_gym.physics.brakes import BrakeUnit
from vse_gym.registry import UnknownNameError
from vse_gym.sensors import Sensors, suite
from vse_gym.vehicles import load

PLANTS = ("double_track", "commonroad_mb")
INTEGRATORS = ("semi_implicit", "runge_kutta")


@dataclass(frozen=True)
class Scenario:
    """All that a drive needs but the estimator, the controller and the seed.

    Raises:
        UnknownNameError: If there is no such plant.
        ValueError: If the vehicle cannot be, the plant cannot take it or the road, or the steps do not fit each other.
        ModuleNotFoundError: If the plant needs a library that is not installed.
    """

    manoeuvre: Manoeuvre
    vehicle: p.Vehicle  # the true one
    sensors: Sensors
    nominal: Nominal  # what estimators and controllers are told of it
    substep: float = 1e-3  # of the plant [s]
    integrator: str = "semi_implicit"  # or "runge_kutta": steady tyres above 5 m/s, relaxing ones always
    brake_unit: BrakeUnit = field(default_factory=BrakeUnit)
    plant: str = "double_track"  # or "commonroad_mb": CommonRoad's multi-body car, an independent truth

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle", p.check_vehicle(self.vehicle))
        if self.plant not in PLANTS:
            raise UnknownNameError(f"no plant named {self.plant!r}; known: {', '.join(PLANTS)}")
        self.multibody()
        if self.steps < 1:
            raise ValueError(f"a drive of {self.manoeuvre.duration} s is shorter than one step of {self.dt} s")
        if self.integrator not in INTEGRATORS:
            raise ValueError(f"integrator must be one of {', '.join(INTEGRATORS)}, not {self.integrator!r}")
        if self.vehicle.relaxation_x > 0 and self.integrator != "runge_kutta":
            raise ValueError(f"a car with relaxation lengths needs integrator 'runge_kutta', not {self.integrator!r}")
        if abs(self.substeps * self.substep - self.dt) > 1e-9:
            raise ValueError(f"dt {self.dt} s must be a whole number of substeps of {self.substep} s")

    @property
    def road(self) -> p.Road:
        """The manoeuvre's road with its slope and bank."""
        return p.tilted(self.manoeuvre.road(), self.manoeuvre.slope, self.manoeuvre.bank)

    @property
    def dt(self) -> float:
        """Time between readings [s]."""
        return self.nominal.dt

    @property
    def substeps(self) -> int:
        """Steps of the plant between two readings."""
        return max(1, round(self.dt / self.substep))

    @property
    def steps(self) -> int:
        """Control steps of a whole drive."""
        return round(self.manoeuvre.duration / self.dt)

    def multibody(self) -> MultiBody | None:
        """The library's car on the manoeuvre's road, if it is the plant."""
        return MultiBody(self.vehicle, self.road) if self.plant == "commonroad_mb" else None


def fitting_integrator(vehicle: p.Vehicle) -> str:
    """The default integrator, or the one that knows unsteady tyres if the car has them."""
    return "runge_kutta" if vehicle.relaxation_x > 0 else "semi_implicit"


def scenario(
    manoeuvre: str | Manoeuvre,
    vehicle: str | p.Vehicle = "qin2014_understeer",
    sensors: str | Sensors = "gaussian",
    nominal: Nominal | None = None,
    plant: str = "double_track",
    **settings: Any,
) -> Scenario:
    """A scenario from names: the estimator is told this very car, the manoeuvre's speed and a friction of 0.9.

    The integrator is the one that fits the car's tyres.

    Args:
        manoeuvre: A name from the catalogue, which ``settings`` go to, or an instance.
        vehicle: A name, the path of a TOML file, or a Vehicle: the true car.
        sensors: The name of a suite, with extra sensors after a plus ("loud+optical"), or Sensors.
        nominal: What estimators and controllers are told, if it shall differ.
        plant: What moves the car: "double_track", or "commonroad_mb" for one of CommonRoad's cars.
        settings: Of the manoeuvre, in SI units: speed, friction, amplitude, ...

    Raises:
        UnknownNameError: If a name is not known.
        TypeError: If the manoeuvre has no such setting.
    """
    car, noise = load(vehicle), suite(sensors)
    test = MANOEUVRES.make(manoeuvre, **settings)
    told = nominal or Nominal(car, noise.sheet, test.speed)
    return Scenario(test, car, noise, told, integrator=fitting_integrator(car), plant=plant)
