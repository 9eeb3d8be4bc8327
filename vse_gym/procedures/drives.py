"""What procedures share: the scenario of one drive, and many drives at work."""

from collections.abc import Callable, Iterable
from typing import Any

from joblib import Parallel

from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.models import Nominal
from vse_gym.physics.parameters import Vehicle
from vse_gym.scenarios import Scenario, fitting_integrator
from vse_gym.sensors import Sensors

Progress = Callable[[int, int], None]  # told how many drives are done, of how many


def silent(done: int, total: int) -> None:
    """Progress for who wants none."""


def of_this_car(manoeuvre: Manoeuvre, car: Vehicle, noise: Sensors) -> Scenario:
    """A drive in which estimator and controller are told this very car, this speed and a friction of 0.9."""
    told = Nominal(car, noise.sheet, manoeuvre.speed)
    return Scenario(manoeuvre, car, noise, told, integrator=fitting_integrator(car))


def at_work(drives: Iterable[Any], jobs: int, progress: Progress, total: int, before: int = 0) -> list[Any]:
    """Results of delayed calls in their order; ``progress`` is told after each, ``before`` having been done already."""
    results = []
    for result in Parallel(n_jobs=jobs, return_as="generator")(drives):
        results.append(result)
        progress(before + len(results), total)
    return results
