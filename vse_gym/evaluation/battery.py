"""A study's drives under several controllers, one row per controller and estimator: who controls best?

Unlike :func:`run_cell`, which judges estimators under the cell's own controller, nothing is replaced here: a seed at
which a controller spins the car with true states is that controller's own fault. Drives are paired: at one seed all
controllers and estimators meet the same car, road and noise.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

from vse_gym.catalogue import CONTROLLERS
from vse_gym.controllers.base import Controller
from vse_gym.controllers.esc import StabilityControl
from vse_gym.evaluation.bench import Progress, quiet
from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.contenders import Contender, Judged, contenders
from vse_gym.evaluation.drawn import Drawn
from vse_gym.evaluation.parallel import in_parallel
from vse_gym.evaluation.runs import Row, heading, loop_columns
from vse_gym.evaluation.study import Study
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.simulation import rollout
from vse_gym.types import Log

if TYPE_CHECKING:
    import polars

OWN = "cell's own"  # the controller that each cell names
AXES = ("controller", "estimator", "seed", "cell")


def battery_rows(
    study: Study, cell: Cell, seed: int, controllers: Mapping[str, Controller], judged: Sequence[Contender]
) -> list[Row]:
    """All rows of one cell at one seed.

    Args:
        study: How the cell is drawn.
        cell: What is driven.
        seed: Of draw and noise.
        controllers: Who brakes, by the names of their rows.
        judged: What they see the car through.
    """
    scenario = cell.scenario(study.randomise, seed)
    rows: list[Row] = []
    for name, controller in controllers.items():
        truth = rollout(scenario, "truth", controller, seed)
        drawn = Drawn(cell, scenario, seed, 0, truth)
        for contender in judged:
            log = rollout(scenario, contender.estimator, controller, seed)
            row = heading(study, cell, seed) | {"controller": name, "truth_ended": truth.ended}
            row |= contender.columns | loop_columns(drawn, log)
            row["loop_yaw_error_degps"] = yaw_error_degps(log, scenario.nominal) if len(log.time) else None
            if truth.ended:  # a regret against a drive that ended badly says nothing
                row |= {key: None for key in row if key.startswith("regret")}
            rows.append(row)
    return rows


def yaw_error_degps(log: Log, nominal: Nominal) -> float:
    """Mean difference of the yaw rate to what the driver wants, as far as the road's friction bears it.

    A car that is kept from sliding by not turning has a large one. The reference is that of ``esc``, from true states
    and the true friction.
    """
    wanted = StabilityControl().reference(nominal)
    speed = np.maximum(log.truth[:, p.VX], 1.0)
    steady = speed * log.steer / (wanted.wheelbase + wanted.understeer * speed**2)
    limit = 0.85 * log.friction * p.GRAVITY / speed
    blend = 1 - math.exp(-wanted.dt / wanted.lag)
    reference = lfilter([blend], [1.0, blend - 1.0], np.clip(steady, -limit, limit))
    return math.degrees(float(np.mean(np.abs(log.truth[:, p.YAW_RATE] - reference))))


def battery(
    study: Study,
    controllers: Mapping[str, str | Controller],
    estimators: Judged,
    seeds: int | None = None,
    jobs: int = 1,
    progress: Progress = quiet,
) -> "polars.DataFrame":
    """The table of a study's drives under each of these controllers, sorted; columns as those of a study.

    Args:
        study: What is driven.
        controllers: Names or instances, a trained agent's too, by the names of their rows. ``OWN`` as a name is the
            controller that each cell names.
        estimators: As for :func:`vse_gym.evaluate`.
        seeds: How many; None: the study's own.
        jobs: Processes.
        progress: Is told how many of how many cells and seeds are finished.

    Raises:
        UnknownNameError, TypeError, ValueError: If a controller or an estimator cannot be.
    """
    import polars

    named = {name: CONTROLLERS.make(c) for name, c in controllers.items() if c != OWN}
    judged = contenders(estimators)
    count = study.seeds if seeds is None else seeds
    calls = []
    for seed in range(study.first_seed, study.first_seed + count):
        for cell in study.cells:
            own = {name: CONTROLLERS.make(cell.controller) for name, c in controllers.items() if c == OWN}
            calls.append((study, cell, seed, own | named, judged))
    rows: list[Row] = []
    progress(0, len(calls))
    with closing(in_parallel(battery_rows, calls, jobs)) as driven:
        for done, some in enumerate(driven, 1):
            rows += some
            progress(done, len(calls))
    return polars.DataFrame(rows, infer_schema_length=None).sort(AXES)
