"""Conformance checks: what every estimator, controller and manoeuvre promises, for our tests and other packages'.

    @pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=lambda check: check.__name__)
    def test_my_estimator_keeps_its_promises(check):
        drive = example_drive()
        check(MyEstimator(), drive.nominal, drive.readings)

A check returns nothing, or raises an AssertionError that says what was expected and what to do about it. Those of an
estimator take (estimator, nominal, readings), those of a controller (controller, nominal, estimates, readings), those
of a manoeuvre (manoeuvre, nominal, times, cars), and those of all of them any of these. Without pytest,
:func:`conformance` runs all that apply, and so does `vse-gym check my_package:MyEstimator`.
"""

import copy
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from vse_gym.catalogue import CONTROLLERS
from vse_gym.checks.blocks import (
    check_can_be_saved,
    check_edits_nothing,
    check_is_symmetric,
    check_keeps_itself,
    check_repeats_itself,
)
from vse_gym.checks.controllers import (
    CONTROLLER_CHECKS,
    check_answers_any_estimate,
    check_demand_is_feasible,
    check_leaves_straight_driving_alone,
)
from vse_gym.checks.estimators import (
    ESTIMATOR_CHECKS,
    check_covariance,
    check_follows_a_drive,
    check_stands_still,
    check_survives_a_dropout,
    check_survives_outliers,
    check_survives_silence,
)
from vse_gym.checks.manoeuvres import (
    MANOEUVRE_CHECKS,
    check_answers_any_car,
    check_can_be_driven,
    check_is_plain_tunings,
    check_is_the_same_to_either_side,
    check_judges_any_drive,
    check_lasts_long_enough,
    check_refuses_what_cannot_be,
    check_road,
)
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.models import Nominal
from vse_gym.scenarios import scenario
from vse_gym.sensors import Sensors
from vse_gym.simulation import Simulation
from vse_gym.types import Car, Estimate, Reading

__all__ = [
    "CONTROLLER_CHECKS",
    "ESTIMATOR_CHECKS",
    "MANOEUVRE_CHECKS",
    "Drive",
    "Finding",
    "check_answers_any_car",
    "check_answers_any_estimate",
    "check_can_be_driven",
    "check_can_be_saved",
    "check_covariance",
    "check_demand_is_feasible",
    "check_edits_nothing",
    "check_follows_a_drive",
    "check_is_plain_tunings",
    "check_is_symmetric",
    "check_is_the_same_to_either_side",
    "check_judges_any_drive",
    "check_keeps_itself",
    "check_lasts_long_enough",
    "check_leaves_straight_driving_alone",
    "check_refuses_what_cannot_be",
    "check_repeats_itself",
    "check_road",
    "check_stands_still",
    "check_survives_a_dropout",
    "check_survives_outliers",
    "check_survives_silence",
    "conformance",
    "example_drive",
]


class Drive(NamedTuple):
    """What the checks are run on."""

    nominal: Nominal
    readings: tuple[Reading, ...]
    estimates: tuple[Estimate, ...]  # of one who knows the truth, for controllers
    times: tuple[float, ...]  # of every fourth reading, which is enough for the driver of a manoeuvre [s]
    cars: tuple[Car, ...]  # as they truly were then


def example_drive(seed: int = 0, sensors: str | Sensors = "dropout") -> Drive:
    """A sine with dwell under a stability control that sees the truth: swerving, braking, silent sensors."""
    setting = scenario("sine_with_dwell", sensors=sensors)
    simulation, law = Simulation(setting, "truth"), CONTROLLERS.make("esc")
    state, frames = law.init(setting.nominal), [simulation.reset(seed)]
    while not simulation.done:
        demand, state = law.act(state, frames[-1].estimate, frames[-1].reading)
        frames.append(simulation.step(demand))
    heard, seen = tuple(f.reading for f in frames), tuple(f.estimate for f in frames)
    some = frames[::4]
    return Drive(setting.nominal, heard, seen, tuple(f.reading.time for f in some), tuple(f.truth for f in some))


class Finding(NamedTuple):
    """What one check found."""

    check: Callable[..., None]
    error: Exception | None  # an AssertionError where a promise is broken, another where something raised; None: kept


def conformance(thing: Estimator | Controller | Manoeuvre, seed: int = 0) -> Iterator[Finding]:
    """Every check that applies, one after the other, each on an example drive of its own.

    Args:
        thing: Who is checked.
        seed: Of the example drive's noise.

    Raises:
        TypeError: If it is neither an estimator nor a controller nor a manoeuvre.
    """
    drive = example_drive(seed)
    heard: tuple[Any, ...]
    if isinstance(thing, Estimator):
        checks, heard = ESTIMATOR_CHECKS, (drive.nominal, drive.readings)
    elif isinstance(thing, Controller):
        checks, heard = CONTROLLER_CHECKS, (drive.nominal, drive.estimates, drive.readings)
    elif isinstance(thing, Manoeuvre):
        checks, heard = MANOEUVRE_CHECKS, (drive.nominal, drive.times, drive.cars)
    else:
        raise TypeError(f"neither an Estimator nor a Controller nor a Manoeuvre: {thing!r:.200}")
    for check in checks:
        try:
            check(thing, *copy.deepcopy(heard))  # who edits them shall spoil no other check
        except Exception as error:
            yield Finding(check, error)
        else:
            yield Finding(check, None)
