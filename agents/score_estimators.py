"""Learned estimators beside filters, off the loop: on drives like those of training, and outside their range.

    python agents/score_estimators.py --drives 200 --jobs 2
    python agents/score_estimators.py ekf gru gru:results/estimators/gru.npz

All hear the same drives, which no training used. Outside the range of training: a friction of 0.1, the headline's cars
as they are, three times the noise that was drawn (of which the data sheet tells).
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Annotated, Any

import numpy as np
import typer
from estimator_drives import FIRST, HEADLINE, LOST, Task, drawn, laden
from estimator_records import SHORTEST
from estimator_scores import score, table
from rich.console import Console
from rich.progress import track

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation import Study
from vse_gym.evaluation.parallel import in_parallel
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import fitting_integrator
from vse_gym.sensors import stream
from vse_gym.simulation import rollout
from vse_gym.vehicles import load

UNUSED = 50_000  # the first number: in the middle of what seed 0 may use, which takes the first and the last
ICE = 0.1
JUDGED = ("ekf", "ukf", "ekf_cauchy_gaussian", "kinematic", "gru", "kalman_gru")


def on_ice(task: Task) -> Task:
    """On a road of a friction of 0.1 everywhere."""
    manoeuvre = task.scenario.manoeuvre
    names = [f.name for f in fields(manoeuvre) if f.name.startswith("friction")]
    slippery: dict[str, Any] = {name: ICE for name in names if getattr(manoeuvre, name) is not None}
    return task._replace(scenario=replace(task.scenario, manoeuvre=replace(manoeuvre, **slippery)))


def in_a_headline_car(task: Task) -> Task:
    """In one of the headline's cars, laden as in training."""
    kinds = sorted({cell.vehicle for cell in Study.load(HEADLINE).cells})
    told = load(kinds[task.seed % len(kinds)])
    driven = laden(told, stream(task.seed, "headline car"))
    nominal = replace(task.scenario.nominal, vehicle=told)
    changes: dict[str, Any] = {"vehicle": driven, "nominal": nominal, "integrator": fitting_integrator(driven)}
    return task._replace(scenario=replace(task.scenario, **changes))


def in_noise(task: Task) -> Task:
    """With three times the noise that was drawn."""
    sheet = task.scenario.sensors.sheet
    louder = sheet._replace(**{name: 3 * getattr(sheet, name) for name in ("acceleration", "yaw_rate", "wheel_speed")})
    sensors, nominal = replace(task.scenario.sensors, sheet=louder), replace(task.scenario.nominal, sheet=louder)
    return task._replace(scenario=replace(task.scenario, sensors=sensors, nominal=nominal))


CONDITIONS = {
    "as in training": lambda task: task,
    "friction 0.1": on_ice,
    "the headline's cars": in_a_headline_car,
    "three times the noise": in_noise,
}


def heard(condition: str, number: int, judged: Sequence[tuple[str, Estimator]]) -> tuple[str, Any, list[Any]]:
    """A drive under a condition: its truth (T, 5), and of each estimator the motion (T, 5) and variances (T, 3)."""
    task = CONDITIONS[condition](drawn(number))
    log = rollout(task.scenario, task.estimator, task.controller, task.seed)
    lost = np.flatnonzero(~(np.abs(log.sideslip) < LOST))
    kept = slice(0, lost[0] if lost.size else len(log.time))
    traces = [shadow(log, estimator, task.scenario.nominal, task.seed) for _, estimator in judged]
    told = [(trace.estimate[kept], trace.cov[kept].diagonal(axis1=1, axis2=2)) for trace in traces]
    return condition, log.truth[kept][:, [p.VX, p.VY, p.YAW_RATE, p.AX, p.AY]], told


def made(name: str) -> Estimator:
    """An estimator by its name, a learned one with a file of weights after a colon."""
    kind, _, weights = name.partition(":")
    estimator: Estimator = ESTIMATORS.make(kind, **({"weights": weights} if weights else {}))
    return estimator


def main(
    estimators: Annotated[list[str] | None, typer.Argument(help="Names, or a learned one's with :FILE.npz.")] = None,
    count: Annotated[int, typer.Option("--drives", min=1, max=1000, help="Under each condition.")] = 200,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
) -> None:
    """Print one table for each condition."""
    judged = [(name, made(name)) for name in estimators or JUDGED]
    calls = [(condition, UNUSED + k, judged) for k in range(count) for condition in CONDITIONS]
    found: dict[str, list[Any]] = {condition: [] for condition in CONDITIONS}
    for condition, truth, told in track(in_parallel(heard, calls, jobs), description="driving", total=len(calls)):
        if len(truth) >= SHORTEST:
            found[condition].append((truth, told))
    for condition, drives in found.items():
        truth, scores = [t for t, _ in drives], {}
        for k, (name, _) in enumerate(judged):
            std = [np.sqrt(told[k][1]) for _, told in drives]
            known = all(np.isfinite(s).all() for s in std)
            scores[name] = score(truth, [told[k][0] for _, told in drives], std if known else None)
        Console().print(table(scores, f"{condition}: {len(drives)} drives, seeds from {FIRST + UNUSED}"))


if __name__ == "__main__":
    typer.run(main)
