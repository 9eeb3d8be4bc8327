"""Highest clean entry speed: how fast a manoeuvre may be begun."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from joblib import delayed

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import KMH, Manoeuvre
from vse_gym.physics.parameters import Vehicle
from vse_gym.procedures.drives import Progress, at_work, of_this_car, silent
from vse_gym.scenarios import Scenario
from vse_gym.sensors import Sensors, suite
from vse_gym.simulation import rollout
from vse_gym.vehicles import load


@dataclass(frozen=True)
class Attempt:
    """One drive of the search."""

    speed: float  # [m/s]
    seed: int
    failed: tuple[str, ...]  # criteria that were not kept; empty: a clean drive

    @property
    def clean(self) -> bool:
        """Whether the manoeuvre's verdict passed."""
        return not self.failed


@dataclass(frozen=True)
class SeedSearch:
    """Where one seed's drives stop being clean."""

    seed: int
    attempts: tuple[Attempt, ...]  # by speed

    @property
    def fails(self) -> float:
        """Lowest speed of a failed drive; infinite if none failed [m/s]."""
        return min((a.speed for a in self.attempts if not a.clean), default=math.inf)

    @property
    def clean(self) -> float:
        """Highest speed of a clean drive with no failed one below; NaN if the lowest failed already [m/s]."""
        return max((a.speed for a in self.attempts if a.clean and a.speed < self.fails), default=math.nan)

    @property
    def islands(self) -> tuple[float, ...]:
        """Speeds above a failed drive at which the drive is clean again [m/s]."""
        return tuple(a.speed for a in self.attempts if a.clean and a.speed > self.fails)


@dataclass(frozen=True)
class EntrySpeed:
    """What the search found."""

    searches: tuple[SeedSearch, ...]
    low: float  # [m/s]
    high: float  # [m/s]
    tolerance: float  # [m/s]
    share: float  # of the seeds that must be clean

    @property
    def speed(self) -> float:
        """Highest entry speed up to which this share of the seeds is clean; NaN if there is none [m/s]."""
        by_speed = sorted((s.clean for s in self.searches if not math.isnan(s.clean)), reverse=True)
        needed = math.ceil(self.share * len(self.searches) - 1e-9)
        return by_speed[needed - 1] if len(by_speed) >= needed else math.nan

    @property
    def spread(self) -> tuple[float, float]:
        """Lowest and highest entry speed of single seeds; NaN where even ``low`` failed [m/s]."""
        speeds = [s.clean for s in self.searches]
        return float(np.min(speeds)), float(np.max(speeds))  # unlike min and max, these hand a NaN on

    @property
    def bounded(self) -> bool:
        """Whether the limit lies below ``high``: otherwise the answer is a lower bound alone."""
        return self.speed < self.high


def entry_speed(
    manoeuvre: str | Manoeuvre,
    vehicle: str | Vehicle = "qin2014_understeer",
    estimator: str | Estimator = "ekf",
    controller: str | Controller = "esc",
    sensors: str | Sensors = "gaussian",
    low: float = 30 * KMH,
    high: float = 130 * KMH,
    tolerance: float = 0.5 * KMH,
    scan: float = 10 * KMH,
    seeds: Sequence[int] = (0,),
    share: float = 1.0,
    jobs: int = 1,
    progress: Progress = silent,
    **settings: Any,
) -> EntrySpeed:
    """Highest entry speed at which a manoeuvre's verdict still passes: a scan, then bisection at its first failure.

    Verdicts need not be monotone in speed: a car may fail at one speed and pass again above. The answer is below the
    first failure that the scan meets, and what is clean above it is reported as an island; a failure between two
    clean speeds of the scan goes unseen.

    Args:
        manoeuvre: A name, which ``settings`` go to, or an instance, whose drives below its own speed last longer, so
            that they cover the same way.
        vehicle: A name, the path of a TOML file, or a Vehicle; estimator and controller are told this very car.
        estimator: What the controller sees the car through.
        controller: Who brakes.
        sensors: The name of a suite, or Sensors.
        low, high: Between which speeds the scan goes [m/s].
        tolerance: Distance of the last clean to the first failed speed at which bisection ends [m/s].
        scan: Largest step of the scan [m/s].
        seeds: Of the noise; each is searched alone.
        share: Of the seeds that must be clean at the answer, in (0, 1].
        jobs: Processes.
        progress: Called after every drive; the total is an estimate until the scan is over.
        settings: Of the manoeuvre, SI: friction, amplitude, ...

    Raises:
        UnknownNameError: If a name is not known.
        TypeError: If the manoeuvre has no such setting.
        ValueError: If the range, the tolerance, the scan, the share or the seeds cannot be.
    """
    if not 0 < low < high < math.inf:
        raise ValueError(f"the lowest speed must be positive and below the highest, not {low} and {high} m/s")
    if not (tolerance > 0 and scan > 0):
        raise ValueError(f"tolerance and scan must be positive, not {tolerance} and {scan} m/s")
    if not 0 < share <= 1:
        raise ValueError(f"share must be in (0, 1], not {share}")
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds must be at least one, each once, not {list(seeds)}")
    begun = partial(_begun, manoeuvre, settings)
    car, noise, _ = load(vehicle), suite(sensors), begun(low)
    eyes, law = ESTIMATORS.make(estimator), CONTROLLERS.make(controller)

    def attempts(plan: Sequence[tuple[float, int]], total: int) -> list[Attempt]:
        cells = ((of_this_car(begun(v), car, noise), seed) for v, seed in plan)
        drives = (delayed(_attempt)(cell, eyes, law, seed) for cell, seed in cells)
        return at_work(drives, jobs, progress, total, before=len(done))

    done: list[Attempt] = []
    grid = np.linspace(low, high, 1 + max(1, math.ceil((high - low) / scan - 1e-9))).tolist()
    halvings = max(0, math.ceil(math.log2((grid[1] - grid[0]) / tolerance) - 1e-9))
    total = len(seeds) * (len(grid) + halvings)
    done += attempts([(v, seed) for v in grid for seed in seeds], total)
    total = len(done) + halvings * sum(_open(_of(done, seed), tolerance) for seed in seeds)
    while plan := [(_middle(_of(done, s)), s) for s in seeds if _open(_of(done, s), tolerance)]:
        done += attempts(plan, total)
    return EntrySpeed(tuple(_of(done, seed) for seed in seeds), low, high, tolerance, share)


def _begun(manoeuvre: str | Manoeuvre, settings: dict[str, Any], speed: float) -> Manoeuvre:
    """The manoeuvre at another speed."""
    test: Manoeuvre
    if isinstance(manoeuvre, str):
        test = MANOEUVRES.make(manoeuvre, **settings, speed=speed)
        return test
    test = MANOEUVRES.make(manoeuvre, **settings)
    return replace(test, speed=speed, duration=test.duration * max(1.0, test.speed / speed))


def _attempt(cell: Scenario, estimator: Estimator, controller: Controller, seed: int) -> Attempt:
    log = rollout(cell, estimator, controller, seed)
    verdict = cell.manoeuvre.judge(log, cell.nominal)
    return Attempt(cell.manoeuvre.speed, seed, tuple(c.name for c in verdict.criteria if c.judged and not c.passed))


def _of(attempts: Sequence[Attempt], seed: int) -> SeedSearch:
    mine = sorted((a for a in attempts if a.seed == seed), key=lambda a: a.speed)
    return SeedSearch(seed, tuple(mine))


def _open(search: SeedSearch, tolerance: float) -> bool:
    return search.fails - search.clean > tolerance * (1 + 1e-9) and math.isfinite(search.fails)


def _middle(search: SeedSearch) -> float:
    return 0.5 * (search.clean + search.fails)
