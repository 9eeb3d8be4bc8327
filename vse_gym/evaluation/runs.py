"""One row per run.

A cell is driven once with true states per seed; that drive is heard by every estimator (shadow) and is what every
closed-loop drive of the same seed is compared with (loop). Cells are drawn anew for every seed, alike for everybody.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from joblib import Parallel, delayed

from vse_gym import metrics
from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.contenders import POTENTIAL, Judged, judged
from vse_gym.evaluation.study import Study
from vse_gym.replay import shadow
from vse_gym.simulation import Scenario, rollout
from vse_gym.types import Log

if TYPE_CHECKING:
    import polars

MOST_REPLACED = 20  # a cell whose truth drive ends badly this often in a row is no cell


def run_study(
    study: Study, estimators: Judged | None = None, seeds: int | None = None, jobs: int = 1
) -> Iterator[list[dict[str, Any]]]:
    """Rows as they come, all those of one cell and seed together; every (cell, seed) once, in no order."""
    if seeds is not None and seeds < 1:
        raise ValueError(f"seeds must be at least 1, not {seeds}")
    rows = judged(estimators if estimators is not None else study.estimators or tuple(ESTIMATORS))
    numbers = range(study.first_seed, study.first_seed + (seeds or study.seeds))
    tasks = [(cell, seed) for seed in numbers for cell in study.cells]
    work = Parallel(n_jobs=jobs, return_as="generator_unordered")
    yield from work(delayed(run_cell)(study, cell, seed, rows) for cell, seed in tasks)


def evaluate(
    study: Study | str, estimators: Judged | None = None, seeds: int | None = None, jobs: int = 1
) -> "polars.DataFrame":
    """One row per cell, seed and estimator, sorted; columns ``loop_*`` and ``shadow_*``, see :mod:`vse_gym.metrics`.

    Args:
        study: A study or its name.
        estimators: Names, instances, or a mapping from row names to either; None: the study's own.
        seeds: How many, from the study's first on; None: the study's own.
        jobs: Processes.
    """
    study = Study.load(study) if isinstance(study, str) else study
    return table([row for part in run_study(study, estimators, seeds, jobs) for row in part])


def table(rows: Sequence[Mapping[str, Any]]) -> "polars.DataFrame":
    """Rows as a table in an order that does not depend on who finished first."""
    import polars

    return polars.DataFrame(list(rows), infer_schema_length=None).sort("cell", "seed", "estimator")


def run_cell(study: Study, cell: Cell, seed: int, estimators: Mapping[str, Estimator]) -> list[dict[str, Any]]:
    """All rows of one cell at one seed. A seed whose truth drive ends badly is replaced, and that is counted."""
    for replaced in range(MOST_REPLACED):
        used = seed + 1_000_000 * replaced
        scenario = cell.scenario(study.randomise, used)
        truth = rollout(scenario, "truth", cell.controller, used)
        if not truth.ended:
            break
    else:
        why = f"with true states {cell.controller} ends badly ({truth.ended}) at every seed"
        raise ValueError(f"cell {cell.name!r}: {why}")
    head = {
        "study": study.name,
        "version": study.version,
        "cell": cell.name,
        "manoeuvre": cell.manoeuvre,
        "vehicle": cell.vehicle,
        "controller": cell.controller,
        "sensors": cell.sensors,
        "plant": cell.plant,
        "benign": cell.benign,
        "seed": seed,
        "replaced": replaced,
    }
    alone = rollout(scenario, "truth", "none", used)
    rows = [head | {"estimator": POTENTIAL} | _loop(scenario, cell, alone, truth)]
    for name, estimator in estimators.items():
        heard = shadow(truth, estimator, scenario.nominal, used)
        e = metrics.errors(truth.truth, heard.estimate, heard.cov, heard.nis, heard.effective_size)
        direct: dict[str, Any] = {f"shadow_{k}": v for k, v in metrics.direct(e).items()}
        if heard.ended:  # errors of the part that it survived would flatter it
            direct = {k: None if isinstance(v, float) else True for k, v in direct.items()}
        direct |= {"shadow_update_us": 1e6 * heard.seconds, "shadow_ended": heard.ended}
        log = rollout(scenario, estimator, cell.controller, used)
        rows.append(head | {"estimator": name} | _loop(scenario, cell, log, truth) | direct)
    return rows


def _loop(scenario: Scenario, cell: Cell, log: Log, truth: Log) -> dict[str, Any]:
    """Columns of a closed-loop drive."""
    out: dict[str, Any] = {"loop_ended": log.ended, "loop_filled": " ".join(log.filled), "loop_passed": False}
    if not len(log.time):  # an estimator that raises on the first reading has no drive to measure
        return out | _regret(metrics.ENDED_BADLY)
    out["loop_passed"] = scenario.manoeuvre.judge(log, scenario.nominal).passed
    for name, metric in metrics.METRICS.items():
        value, reference = metric(log), metric(truth)
        out |= {f"loop_{name}": value, f"loop_{name}_diff": value - reference}
        out |= {f"loop_{name}_absdiff": abs(value - reference)}
    heading = metrics.heading_difference_deg(log, truth)
    out |= {"loop_heading_diff_deg": heading, "loop_heading_absdiff_deg": abs(heading)}
    out |= {"loop_path_deviation_m": metrics.path_deviation_m(log, truth)}
    unknown = np.full(len(log.time), math.nan)
    e = metrics.errors(log.truth, log.estimate, log.cov, log.nis, unknown)
    own: dict[str, Any] = {k: v for k, v in metrics.direct(e).items() if k != "effective_size"}
    own["update_us"] = 1e6 * float(np.median(log.seconds))
    return out | {f"loop_{k}": v for k, v in own.items()} | _regret(metrics.regret(log, truth, cell.benign))


def _regret(regret: metrics.Regret) -> dict[str, float]:
    return {"regret": regret.total} | {f"regret_{k}": v for k, v in regret._asdict().items()}
