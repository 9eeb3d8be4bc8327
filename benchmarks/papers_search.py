"""The common search of tunings for the papers' experiments."""

import tomllib
from collections.abc import Callable, Container, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.tune import FIRST_SEED, search
from vse_gym.evaluation.tunings import Tuning, changed, default_of, ranges
from vse_gym.replay import Trace, shadow
from vse_gym.report.text import Sheet
from vse_gym.scenarios import Scenario
from vse_gym.simulation import rollout
from vse_gym.types import Log

TUNINGS = Path(__file__).parent / "papers_tunings"
TRAINING_SEEDS = 4
Drive = Callable[[int], Scenario]  # a seed's drive; module-level, so that it travels to other processes
Loss = Callable[[Log, Trace], float]  # what a search makes small


def tuned(system: str, name: str) -> Estimator:
    """An estimator with the tuning found for a system's experiment, or its default if none was searched."""
    path = tuning_file(system, name)
    return Tuning.load(path).make() if path.exists() else default_of(name)


def tuning_file(system: str, name: str, variant: str = "") -> Path:
    """Of an estimator's tuning; one of the experiment's own, module:name, by its name."""
    return TUNINGS / f"{system}_{name.rpartition(':')[2]}{variant and '_' + variant}.toml"


def tune_for(
    system: str,
    name: str,
    drive: Drive,
    loss: Loss,
    budget: int,
    variant: str = "",
    begin: Estimator | None = None,
    within: Container[str] | None = None,
) -> Path | None:
    """Search a tuning that makes ``loss`` small on seeds from 1000 on; the same budget and sampler for everybody.

    Args:
        variant: Tells this search's file from that of the estimator's common one.
        begin: Settings to begin with, and to keep where none is searched; None: the default's.
        within: Fields of the estimator in which to search; None: all.

    Returns:
        The file, or None if there is nothing to tune.
    """
    default = default_of(name) if begin is None else begin
    limits = {k: v for k, v in ranges(default).items() if within is None or k.partition(".")[0] in within}
    if not limits:
        return None
    start = {setting: float(attrgetter(setting)(default)) for setting in limits}
    seeds = range(FIRST_SEED, FIRST_SEED + TRAINING_SEEDS)
    logs = {s: (rollout(drive(s), "truth", "none", s), drive(s).nominal) for s in seeds}

    def score(values: Mapping[str, float], part: int) -> float:
        log, nominal = logs[seeds[part]]
        trace = shadow(log, changed(default, values), nominal, seeds[part])
        value = loss(log, trace) if not trace.ended else np.inf
        return float(value) if np.isfinite(value) else 1e6

    trials, _ = search(score, start, limits, len(seeds), budget)
    whole = [t for t in trials if len(t.scores) == len(seeds)]
    best = min(whole, key=lambda t: float(np.mean(t.scores)))
    origin: dict[str, Any] = {
        "command": f"python benchmarks/papers.py {system} --tune --budget {budget}",
        "default": float(np.mean(whole[0].scores)),
        "tuned": float(np.mean(best.scores)),
        "first_seed": seeds.start,
        "seeds": len(seeds),
        "budget": budget,
        "finished": len(whole),
    }
    path = tuning_file(system, name, variant)
    Tuning.of(name, changed(default, best.values), origin).save(path)
    return path


def search_rows(system: str) -> Sheet:
    """What the searches found."""
    rows = []
    for path in sorted(TUNINGS.glob(f"{system}_*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        origin = table["origin"]
        rows.append(
            [
                path.stem.removeprefix(f"{system}_"),
                f"{origin['default']:.3g}",
                f"{origin['tuned']:.3g}",
                str(origin["budget"]),
            ]
        )
    return Sheet(["search", "loss at its start", "loss found", "trials"], rows)
