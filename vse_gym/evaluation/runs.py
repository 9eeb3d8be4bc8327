"""One row per run.

A cell is driven once with true states per seed; that drive is heard by every estimator (shadow) and is what every
closed-loop drive of the same seed is compared with (loop). Cells are drawn anew for every seed, alike for everybody.
"""

import math
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from vse_gym import metrics, metrics_found
from vse_gym.estimators.anchors import Truth
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.contenders import POTENTIAL, Contender
from vse_gym.evaluation.drawn import Drawn, draw
from vse_gym.evaluation.provenance import commit, machine, package_version
from vse_gym.evaluation.study import Study
from vse_gym.models import Nominal
from vse_gym.replay import shadow
from vse_gym.simulation import rollout
from vse_gym.types import Log

if TYPE_CHECKING:
    import polars

KEYS = ("cell", "seed", "estimator")
# What differs between two runs of the same drive
TIMES = ("loop_update_us", "shadow_update_us", "seconds", "machine", "commit")

ALONE = Truth()  # whoever does not brake needs no estimate

Row = dict[str, Any]


def table(rows: Sequence[Mapping[str, Any]]) -> "polars.DataFrame":
    """Rows as a table in an order that does not depend on who finished first."""
    import polars

    return polars.DataFrame(list(rows), infer_schema_length=None).sort(KEYS)


def run_cell(study: Study, cell: Cell, seed: int, contenders: Sequence[Contender], potential: bool = True) -> list[Row]:
    """All rows of one cell at one seed. A seed whose truth drive ends badly is replaced, and that is counted.

    Args:
        study: How the cell is drawn.
        cell: What is driven.
        seed: Of draw and noise.
        contenders: Who is judged.
        potential: Whether the car without stability control has a row too.

    Raises:
        ValueError: If the truth drive ends badly at every seed.
    """
    begin = perf_counter()
    drawn = draw(study, cell, seed)
    head = heading(study, cell, seed) | {"replaced": drawn.replaced}
    rows: list[Row] = []
    if potential:
        alone = rollout(drawn.scenario, "truth", "none", drawn.seed)
        names = Contender(POTENTIAL, ALONE).columns | {"tuning": "", "tuning_digest": ""}
        rows.append(head | names | loop_columns(drawn, alone) | took(begin))
    for contender in contenders:
        begin = perf_counter()
        tyres_known = cell.plant == "double_track"
        heard = shadow_columns(drawn.truth, contender.estimator, drawn.scenario.nominal, drawn.seed, tyres_known)
        log = rollout(drawn.scenario, contender.estimator, cell.controller, drawn.seed)
        rows.append(head | contender.columns | loop_columns(drawn, log) | heard | took(begin))
    return rows


def heading(study: Study, cell: Cell, seed: int) -> Row:
    """What a row says of its drive and of its making."""
    return {
        "study": study.name,
        "version": study.version,
        "study_digest": study.digest,
        "package": package_version(),
        "cell": cell.name,
        "manoeuvre": cell.manoeuvre,
        "vehicle": cell.vehicle,
        "controller": cell.controller,
        "sensors": cell.sensors,
        "plant": cell.plant,
        "benign": cell.benign,
        "seed": seed,
    }


def took(begin: float) -> Row:
    """How long a row's work took, where, and in which state of the code."""
    return {"seconds": perf_counter() - begin, "machine": machine(), "commit": commit()}


def shadow_columns(log: Log, estimator: Estimator, nominal: Nominal, seed: int, tyres_known: bool = True) -> Row:
    """Columns of an estimator that listens to a drive; ``tyres_known``: the log's vehicle is what moved."""
    heard = shadow(log, estimator, nominal, seed)
    e = metrics.errors(log.truth, heard.estimate, heard.cov, heard.nis, heard.effective_size)
    direct: Row = {f"shadow_{k}": v for k, v in metrics.direct(e).items()}
    direct |= {f"shadow_{k}": v for k, v in metrics_found.found(log, heard.found, nominal, tyres_known).items()}
    if heard.ended:  # errors of the part that it survived would flatter it
        direct = {k: None if isinstance(v, float) else True for k, v in direct.items()}
    return direct | {"shadow_update_us": 1e6 * heard.seconds, "shadow_ended": heard.ended}


def loop_columns(drawn: Drawn, log: Log) -> Row:
    """Columns of a closed-loop drive."""
    scenario, truth = drawn.scenario, drawn.truth
    out: Row = {"loop_ended": log.ended, "loop_filled": " ".join(log.filled), "loop_passed": False}
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
    own: Row = {k: v for k, v in metrics.direct(e).items() if k != "effective_size"}
    own["update_us"] = 1e6 * float(np.median(log.seconds))
    return out | {f"loop_{k}": v for k, v in own.items()} | _regret(metrics.regret(log, truth, drawn.cell.benign))


def _regret(regret: metrics.Regret) -> dict[str, float]:
    return {"regret": regret.total} | {f"regret_{k}": v for k, v in regret._asdict().items()}
