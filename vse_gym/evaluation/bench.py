"""Driving a study: what is missing, in parallel, kept as it comes."""

import math
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.contenders import Contender, Judged, contenders
from vse_gym.evaluation.files import write_runs
from vse_gym.evaluation.matched import run_matched
from vse_gym.evaluation.parallel import in_parallel
from vse_gym.evaluation.results import Finished, Results
from vse_gym.evaluation.runs import run_cell
from vse_gym.evaluation.study import Study

if TYPE_CHECKING:
    import polars

Progress = Callable[[int, int], None]
FEWEST = 10  # seeds, before a precision is believed: an interval of a few is too narrow too often
MOST_SEEDS = 200  # where adding seeds for a precision stops


def quiet(done: int, total: int) -> None:
    """Progress that nobody wants to see."""


@dataclass(frozen=True)
class Bench:
    """A study with those whom it judges, and how it is driven.

    Raises:
        ValueError: If there are fewer seeds than one.
    """

    study: Study
    judged: tuple[Contender, ...]
    seeds: int
    jobs: int = 1
    backend: str = "loky"
    finished: Finished = field(default_factory=Finished)  # where finished cells are kept

    def __post_init__(self) -> None:
        if self.seeds < 1:
            raise ValueError(f"seeds must be at least 1, not {self.seeds}")

    def tasks(self) -> list[tuple[Any, ...]]:
        """Arguments of every call of :func:`run_cell`, or of :func:`run_matched`, that is still to be made."""
        out: list[tuple[Any, ...]] = []
        for seed in self.numbers:  # seeds first: an early end leaves whole seeds, which can be compared
            for cell in self.study.cells:
                lacking, potential = self.finished.missing(cell.name, seed, self.judged)
                if self.study.matched:
                    out += [(self.study, cell, seed, lacking)] if lacking else []
                elif lacking or potential:
                    out.append((self.study, cell, seed, lacking, potential))
        return out

    @property
    def numbers(self) -> range:
        """The seeds that are driven."""
        return range(self.study.first_seed, self.study.first_seed + self.seeds)

    @property
    def runs(self) -> "polars.DataFrame":
        """The table of what is finished.

        Raises:
            ResultsError: If nothing is.
        """
        return self.finished.collect(self.judged, self.numbers)

    def drive(self, progress: Progress = quiet) -> "Bench":
        """Drive what is missing; itself.

        Args:
            progress: Is told how many of how many cells and seeds are finished.

        Raises:
            ValueError: If a cell cannot be driven.
            OSError: If what is finished cannot be kept.
        """
        tasks = self.tasks()
        total = len(self.study.cells) * self.seeds
        done = total - len(tasks)
        progress(done, total)
        run = run_matched if self.study.matched else run_cell
        with closing(in_parallel(run, tasks, self.jobs, self.backend)) as driven:  # Ctrl-C while it closes is one too
            for rows in driven:
                self.finished.add(rows)
                done += 1
                progress(done, total)
        return self

    def drive_until(self, precision: float, most: int = MOST_SEEDS, progress: Progress = quiet) -> "Bench":
        """Drive, adding seeds until the interval of each mean regret is as narrow as asked, or there are ``most``.

        Every stage depends on finished rows alone, so that a run that is gone on with adds the seeds that an unbroken
        one would.

        Args:
            precision: Half width of the widest 95 % interval [regret].
            most: Seeds.
            progress: As of :meth:`drive`.

        Returns:
            The bench with the seeds that it took.

        Raises:
            ValueError: If the study is a matched one, whose drives have no regret; and as :meth:`drive`.
        """
        if self.study.matched:
            raise ValueError(f"study {self.study.name!r} has no regret whose precision could be asked for: give seeds")
        from vse_gym.report.statistics import precision as half_width

        if self.seeds < min(FEWEST, most):
            return replace(self, seeds=min(FEWEST, most)).drive_until(precision, most, progress)
        self.drive(progress)
        reached = half_width(self.runs)
        if reached <= precision or self.seeds >= most:
            return self
        more = replace(self, seeds=seeds_for(precision, reached, self.seeds, most))
        return more.drive_until(precision, most, progress)


def seeds_for(precision: float, reached: float, seeds: int, most: int) -> int:
    """How many seeds an interval of half width ``precision`` will need, given what ``seeds`` of them have reached.

    The half width falls with the root of the number; a tenth is added, at most as many again are, and at least one is.
    """
    wanted = math.ceil(1.1 * seeds * (reached / precision) ** 2) if math.isfinite(reached) else 2 * seeds
    return min(most, max(seeds + 1, min(2 * seeds, wanted)))


def evaluate(
    study: Study | str,
    estimators: Judged | None = None,
    seeds: int | None = None,
    jobs: int = 1,
    tunings: Mapping[str, tuple[Estimator, str]] | None = None,
    out: Path | str | None = None,
) -> "polars.DataFrame":
    """One row per cell, seed and estimator, sorted; columns ``loop_*`` and ``shadow_*``, see :mod:`vse_gym.metrics`.

    Args:
        study: A study or its name.
        estimators: Names, instances, or a mapping from row names to either; None: the study's own.
        seeds: How many, from the study's first on; None: the study's own.
        jobs: Processes.
        tunings: For names of the catalogue, the estimator to take in place of its default and what to call that.
        out: A folder: finished cells are kept there, and those that it has already are not driven again.
    """
    study = Study.load(study) if isinstance(study, str) else study
    judged = contenders_of(study, estimators, tunings)
    told = f"evaluate({study.name!r})"
    count = study.seeds if seeds is None else seeds
    finished = Finished() if out is None else Results(Path(out), study, judged, told, count, resume=True)
    bench = Bench(study, judged, count, jobs, finished=finished).drive()
    if isinstance(finished, Results):
        write_runs(finished.folder, finished.everybody(bench.numbers))
    return bench.runs


def contenders_of(
    study: Study, estimators: Judged | None = None, tunings: Mapping[str, tuple[Estimator, str]] | None = None
) -> tuple[Contender, ...]:
    """Whom a study judges: these, else its own, else all that have a name."""
    named: Judged = estimators if estimators is not None else study.estimators or tuple(ESTIMATORS)
    return contenders(named, tunings, study.attribution)
