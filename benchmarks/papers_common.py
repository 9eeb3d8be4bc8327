"""What the papers' experiments share: claims, and drives heard by several estimators."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from papers_search import Drive, Loss, tuned
from rich.progress import track

from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.tune import FIRST_SEED
from vse_gym.replay import Trace, shadow
from vse_gym.report.text import Sheet
from vse_gym.simulation import rollout
from vse_gym.types import Array, Log


class Claim(NamedTuple):
    """A sentence of a paper, its figure, and what comes out here."""

    system: str  # A to E
    claim: str
    published: str  # the printed figure; "-" where only a curve or a sentence is
    here: str  # median and 90 % interval
    holds: str  # "holds", "fails", or "open" where the interval holds zero
    why: str  # as far as measured


class Outcome(NamedTuple):
    """What an experiment gives."""

    claims: list[Claim]
    tables: dict[str, Sheet]  # by title
    notes: list[str]  # what was chosen where the print is silent


class Heard(NamedTuple):
    """One drive and what everybody made of it."""

    log: Log
    traces: Mapping[str, Trace]


@dataclass(frozen=True)
class Paper:
    """How an experiment is to be made.

    Raises:
        ValueError: If a seed is one of those that tunings are searched on.
    """

    system: str
    seeds: range
    jobs: int = 1
    figures: Path = Path("results/papers")  # folder of the pictures

    def __post_init__(self) -> None:
        if len(self.seeds) < 1 or self.seeds[-1] >= FIRST_SEED:
            raise ValueError(f"there must be seeds, all below {FIRST_SEED}: later ones are for tuning")

    def contenders(self, names: Iterable[str]) -> dict[str, Estimator]:
        """Estimators by their names, each with the tuning that the common search found on this experiment."""
        return {name: tuned(self.system, name) for name in names}

    def hear(self, drive: Drive, estimators: Mapping[str, Estimator], what: str) -> list[Heard]:
        """Drive every seed once with true states and without control; everybody hears the same readings."""
        work = Parallel(n_jobs=self.jobs, return_as="generator")
        made = work(delayed(heard)(drive, estimators, seed) for seed in self.seeds)
        return list(track(made, f"{self.system}: {what}", total=len(self.seeds), transient=True))


def heard(drive: Drive, estimators: Mapping[str, Estimator], seed: int) -> Heard:
    """One seed's drive, heard by everybody.

    Raises:
        RuntimeError: If an estimator stops early: no paper's does.
    """
    setting = drive(seed)
    log = rollout(setting, "truth", "none", seed)
    traces = {name: shadow(log, e, setting.nominal, seed) for name, e in estimators.items()}
    for name, trace in traces.items():
        if trace.ended:
            raise RuntimeError(f"{name} stopped in {setting.manoeuvre} at seed {seed}: {trace.ended}")
    return Heard(log, traces)


def over_seeds(heard: Sequence[Heard], name: str, figure: Loss) -> Array:
    """A figure of one estimator at every seed, (S,)."""
    return np.array([figure(h.log, h.traces[name]) for h in heard])
