"""What the papers' experiments share: drives heard by several estimators, figures with their spread, claims."""

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from rich.progress import track
from scipy.stats import quantile_test

from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.tune import FIRST_SEED, search
from vse_gym.evaluation.tunings import Tuning, changed, default_of, ranges
from vse_gym.physics import parameters as p
from vse_gym.replay import Trace, shadow
from vse_gym.report.text import Sheet
from vse_gym.simulation import Scenario, rollout
from vse_gym.types import Array, Log

TUNINGS = Path(__file__).parent / "papers_tunings"
TRAINING_SEEDS = 4
LEVEL = 0.9  # of every interval here
DEG = 180 / np.pi


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


Drive = Callable[[int], Scenario]  # a seed's drive; module-level, so that it travels to other processes
Loss = Callable[[Log, Trace], float]  # what a search makes small


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


# -- figures --------------------------------------------------------------------------------------------------------


def sideslip_error(log: Log, trace: Trace) -> Array:
    """Estimated minus true sideslip, (T,) [deg]."""
    return DEG * np.arctan2(trace.estimate[:, 1], trace.estimate[:, 0]) - DEG * log.sideslip


def motion_error(log: Log, trace: Trace, which: int) -> Array:
    """Error of vx, vy (m/s), yaw rate (deg/s), ax or ay (m/s2), counted from 0, (T,)."""
    true = log.truth[:, (p.VX, p.VY, p.YAW_RATE, p.AX, p.AY)[which]]
    return (DEG if which == 2 else 1.0) * (trace.estimate[:, which] - true)


def rms(x: Array) -> float:
    """Of what is known."""
    return float(np.sqrt(np.nanmean(np.square(x))))


def over_seeds(heard: Sequence[Heard], name: str, figure: Loss) -> Array:
    """A figure of one estimator at every seed, (S,)."""
    return np.array([figure(h.log, h.traces[name]) for h in heard])


def spread(values: Sequence[float] | Array, spec: str = ".3g") -> str:
    """Median over seeds, and the range that holds 90 % of them."""
    low, middle, high = np.nanquantile(values, [0.5 - LEVEL / 2, 0.5, 0.5 + LEVEL / 2])
    return f"{middle:{spec}} [{low:{spec}}, {high:{spec}}]"


class Median(NamedTuple):
    """The median over seeds with its 90 % confidence interval."""

    middle: float
    low: float
    high: float

    def text(self, spec: str = "+.3g", unit: str = "") -> str:
        """As printed."""
        return f"{self.middle:{spec}} [{self.low:{spec}}, {self.high:{spec}}]{unit and ' ' + unit}"

    def judged(self, less_than: float = 0.0) -> str:
        """Whether the median is less than so much: "holds", "fails" or "open"."""
        return "holds" if self.high < less_than else "fails" if self.low > less_than else "open"


def median(values: Sequence[float] | Array) -> Median:
    """Exact for any law: by the signs of the differences to it."""
    x = np.asarray(values, dtype=float)
    interval = quantile_test(x, q=float(np.median(x)), p=0.5).confidence_interval(LEVEL)
    low, high = (end if np.isfinite(end) else pick(x) for end, pick in zip(interval, (np.min, np.max), strict=True))
    return Median(float(np.median(x)), float(low), float(high))


def gain(here: Array, other: Array) -> Median:
    """Paired by seed: by how many per cent ``here`` is less than ``other``; negative is better."""
    return median(100 * (here / other - 1))


# -- tunings --------------------------------------------------------------------------------------------------------


def tuned(system: str, name: str) -> Estimator:
    """An estimator with the tuning found for a system's experiment, or its default if none was searched."""
    path = _file(system, name)
    return Tuning.load(path).make() if path.exists() else default_of(name)


def _file(system: str, name: str) -> Path:
    """Of an estimator's tuning; one of the experiment's own, module:name, by its name."""
    return TUNINGS / f"{system}_{name.rpartition(':')[2]}.toml"


def tune_for(system: str, name: str, drive: Drive, loss: Loss, budget: int, jobs: int = 1) -> Path | None:
    """Search a tuning that makes ``loss`` small on seeds from 1000 on; the same budget and sampler for everybody.

    Returns:
        The file, or None if there is nothing to tune.
    """
    default = default_of(name)
    limits = ranges(default)
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
    path = _file(system, name)
    Tuning.of(name, changed(default, best.values), origin).save(path)
    return path


def search_rows(system: str) -> Sheet:
    """What the searches found."""
    rows = []
    for path in sorted(TUNINGS.glob(f"{system}_*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        origin = table["origin"]
        rows.append([table["estimator"], f"{origin['default']:.3g}", f"{origin['tuned']:.3g}", str(origin["budget"])])
    return Sheet(["estimator", "loss with defaults", "loss found", "trials"], rows)
