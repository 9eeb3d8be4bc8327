"""The search for a tuning: least mean regret in the loop, on cells and seeds that no table reports."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed

from vse_gym import metrics
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.drawn import Drawn, draw
from vse_gym.evaluation.provenance import commit, package_version
from vse_gym.evaluation.study import Study
from vse_gym.evaluation.tunings import Tuning, changed, default_of, ranges
from vse_gym.simulation import rollout

TRAINING = "training-v2"
FIRST_SEED = 1000  # seeds below are those of tables
VALIDATION = 10  # seeds after those of the search, on which the best few are driven again
FINALISTS = 3

Progress = Callable[[str, int, int], None]


def _silent(what: str, done: int, total: int) -> None:
    """Who is told and says nothing."""


def validation_seeds(study: Study, seeds: int | None = None) -> range:
    """Seeds of the second look at the best few; the search itself uses those from the study's first up to here."""
    begin = study.first_seed + (seeds or study.seeds)
    return range(begin, begin + VALIDATION)


class Score(NamedTuple):
    """Mean regret and its 95 % interval: Student's, over seeds, whose means over the cells are independent."""

    mean: float
    low: float
    high: float


def score_of(regrets: Sequence[float], least: float = -math.inf) -> Score:
    """The score of one mean regret per seed, (n,); the interval ends where the figure cannot be less."""
    from scipy.stats import t

    mean, n = float(np.mean(regrets)), len(regrets)
    half = float(t.ppf(0.975, n - 1) * np.std(regrets, ddof=1)) / math.sqrt(n) if n > 1 else math.inf
    return Score(mean, max(mean - half, least), mean + half)


# -- drives -----------------------------------------------------------------------------------------------------------


def regret(drawn: Drawn, estimator: Estimator) -> float:
    """Of one drive."""
    log = rollout(drawn.scenario, estimator, drawn.cell.controller, drawn.seed)
    return metrics.regret(log, drawn.truth, drawn.cell.benign).total


class Drives:
    """The cells of a study; what is drawn for a seed is kept, so that everybody meets the same."""

    def __init__(self, study: Study, work: Parallel):
        self.study, self.work = study, work
        self._drawn: dict[int, list[Drawn]] = {}

    def score(self, estimator: Estimator, seed: int) -> float:
        """Mean regret over the cells, each counting alike."""
        if seed not in self._drawn:
            self._drawn[seed] = self.work(delayed(draw)(self.study, cell, seed) for cell in self.study.cells)
        return float(np.mean(self.work(delayed(regret)(drawn, estimator) for drawn in self._drawn[seed])))


# -- the search -------------------------------------------------------------------------------------------------------


class Trial(NamedTuple):
    """A point of the search, and its scores part by part; fewer than there are parts if it was stopped."""

    values: dict[str, float]
    scores: tuple[float, ...]


def search(
    score: Callable[[Mapping[str, float], int], float],
    start: Mapping[str, float],
    limits: Mapping[str, tuple[float, float]],
    parts: int,
    budget: int,
    seed: int = 0,
    progress: Progress = _silent,
) -> tuple[list[Trial], bool]:
    """Minimise the mean of ``score(values, part)`` over all parts by optuna's multivariate TPE. Bergstra et al. (2011).

    The first trial is the start. A trial is stopped, from the second part on, if the best that its running mean has
    been so far is worse than the median of the running means that finished trials had at the same part (optuna's median
    pruner); so a lucky first part protects a bad trial. Ctrl-C ends the search.

    Args:
        score: To be minimised, deterministic.
        start: Values by name.
        limits: Where to search, by name; on a logarithmic scale, or on a linear one from zero.
        parts: How many there are.
        budget: Trials.
        seed: Of the sampler.
        progress: Told what is being done, and how many of how many trials are done.

    Returns:
        The trials that were not cut off, in their order, and whether all were made.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    floats = optuna.distributions.FloatDistribution
    space: dict[str, Any] = {name: floats(low, high, log=low > 0) for name, (low, high) in limits.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # optuna 4 calls the option that
        sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True)
    pruner = optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=1)
    study = optuna.create_study(sampler=sampler, pruner=pruner)
    study.enqueue_trial(dict(start))
    trials: list[Trial] = []
    try:
        for done in range(budget):
            trial = study.ask(space)
            scores: list[float] = []
            values = {name: float(trial.params[name]) for name in limits}
            for part in range(parts):
                scores.append(score(values, part))
                trial.report(float(np.mean(scores)), part)
                if trial.should_prune() and part + 1 < parts:
                    break
            state = optuna.trial.TrialState.COMPLETE if len(scores) == parts else optuna.trial.TrialState.PRUNED
            study.tell(trial, float(np.mean(scores)) if len(scores) == parts else None, state)
            trials.append(Trial(values, tuple(scores)))
            best = min(float(np.mean(t.scores)) for t in trials if len(t.scores) == parts)
            progress(f"best {best:.2f}, default {np.mean(trials[0].scores):.2f}", done + 1, budget)
    except KeyboardInterrupt:
        return trials, False
    return trials, True


def prepared(
    name: str, budget: int, study: Study | str = TRAINING, seeds: int | None = None
) -> tuple[Estimator, Study, int]:
    """The estimator with its default settings, the study and its seeds, if they can be searched.

    Raises:
        UnknownNameError: If there is no such estimator or study.
        ValueError: If nothing of it can be tuned, the budget is none, or the study's seeds are those of tables.
    """
    study = Study.load(study) if isinstance(study, str) else study
    seeds = study.seeds if seeds is None else seeds
    default = default_of(name)
    if not ranges(default):
        raise ValueError(f"estimator {name!r} has nothing to tune: no field of it was made by `tunable`")
    if budget < 1 or seeds < 1:
        raise ValueError(f"budget and seeds must be at least 1, not {budget} and {seeds}")
    if study.first_seed < FIRST_SEED:
        reported = f"its seeds begin at {study.first_seed}, and those below {FIRST_SEED} are for tables"
        raise ValueError(f"study {study.name!r} is not for tuning: {reported}")
    return default, study, seeds


def tune(
    name: str,
    budget: int,
    study: Study | str = TRAINING,
    seeds: int | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = _silent,
) -> Tuning:
    """The best tuning of an estimator that so many trials find; its ``origin`` says how it was found.

    The best few of the search and the default are driven again on later seeds, and the best there wins: those scores
    are nearly honest, the search's own are not.

    Args:
        name: Of the estimator in the catalogue, or module:Class.
        budget: Trials, the default's among them.
        study: Cells and seeds, from 1000 on, which no table reports.
        seeds: Of the search; None: the study's own.
        seed: Of the sampler.
        jobs: Processes, over the cells of a trial; the result does not depend on them.
        progress: As :func:`search` has it.

    Raises:
        UnknownNameError, ValueError: As :func:`prepared`.
        KeyboardInterrupt: If stopped before the default itself was driven; later there is a best so far.
        ModuleNotFoundError: If optuna is missing.
    """
    named = study if isinstance(study, str) else study.name
    default, study, seeds = prepared(name, budget, study, seeds)
    limits = ranges(default)
    start = {setting: float(attrgetter(setting)(default)) for setting in limits}
    with Parallel(n_jobs=jobs) as work:
        drives = Drives(study, work)
        trials, whole = search(
            lambda values, part: drives.score(changed(default, values), study.first_seed + part),
            start,
            limits,
            seeds,
            budget,
            seed,
            progress,
        )
        finished = [trial for trial in trials if len(trial.scores) == seeds]
        if not finished:
            raise KeyboardInterrupt
        ranked = sorted(finished, key=lambda trial: np.mean(trial.scores))
        finalists = [finished[0], *(trial for trial in ranked[:FINALISTS] if trial is not finished[0])]
        again: list[tuple[float, ...]] = []
        if whole:
            again, whole = _again(drives, default, finalists, validation_seeds(study, seeds), progress)
    best = finalists[int(np.argmin([np.mean(s) for s in again]))] if again else ranked[0]
    origin = {
        "command": f"vse-gym tune {name} --budget {budget} --study {named} --seeds {seeds} --seed {seed}",
        "study": study.name,
        "study_version": study.version,
        "cells": len(study.cells),
        "budget": budget,
        "finished": len(finished),
        "stopped_early": len(trials) - len(finished),
        "interrupted": not whole,
        "sampler": "optuna, TPE, multivariate",
        "sampler_seed": seed,
        "optuna": version("optuna"),
        "package": package_version(),
        "commit": commit(),
        "training": {"first_seed": study.first_seed, "seeds": seeds} | _compared(finished[0].scores, best.scores),
    }
    if again:
        later = validation_seeds(study, seeds)
        compared = _compared(again[0], again[finalists.index(best)])
        origin["validation"] = {"first_seed": later.start, "seeds": len(later), "finalists": len(again)} | compared
    return Tuning.of(name, changed(default, best.values), {"outcome": _outcome(origin)} | origin)


def _outcome(origin: Mapping[str, Any]) -> str:
    """What came of the search, in words."""
    if origin["interrupted"]:
        return "stopped early: this is the best so far, not driven again on later seeds"
    difference = origin["validation"]["difference"]
    if difference["mean"] == 0:
        return "nothing better than the default was found"
    return "better than the default" if difference["high"] < 0 else "not clearly better than the default"


def _again(
    drives: Drives, default: Estimator, finalists: list[Trial], seeds: range, progress: Progress
) -> tuple[list[tuple[float, ...]], bool]:
    """Regrets of all finalists on these seeds, and whether there was time for all; if not, of none."""
    regrets = []
    try:
        for k, trial in enumerate(finalists):
            estimator = changed(default, trial.values)
            regrets.append(tuple(drives.score(estimator, seed) for seed in seeds))
            progress("the best few on later seeds", k + 1, len(finalists))
    except KeyboardInterrupt:
        return [], False
    return regrets, True


def _compared(default: Sequence[float], tuned: Sequence[float]) -> dict[str, Any]:
    """Scores of both, and of their paired difference."""
    pairs = [a - b for a, b in zip(tuned, default, strict=True)]
    alone = {"default": score_of(default, 0.0), "tuned": score_of(tuned, 0.0)}  # regret is not negative
    scores = alone | {"difference": score_of(pairs)}
    return {name: score._asdict() for name, score in scores.items()}
