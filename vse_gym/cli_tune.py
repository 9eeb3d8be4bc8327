"""The command that searches for a tuning: tune."""

from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from vse_gym.catalogue import ESTIMATORS
from vse_gym.cli_check import of_kind
from vse_gym.cli_screen import Jobs, bars, refuse, screen, sentences


def tune(
    estimator: Annotated[
        str, typer.Argument(help="Whose settings are searched: a name that `vse-gym list` shows, or module:Class.")
    ],
    budget: Annotated[
        int, typer.Option(min=1, help="Settings to try, the default first. For a fair comparison, the same for all.")
    ] = 60,
    study: Annotated[str, typer.Option(help="Cells and seeds that no table reports.")] = "training-v2",
    seeds: Annotated[int | None, typer.Option(min=1, help="Of the search; without it the study's own.")] = None,
    seed: Annotated[int, typer.Option(help="Of the sampler.")] = 0,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option(help="File; without it tunings/ESTIMATOR.toml.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file if there is one.")] = False,
) -> None:
    """Search for a better tuning in the loop and write it into a tunings file, which says where it comes from.

    The first trial is the default. Hopeless trials are stopped early. The best few are driven again on later seeds,
    beside the default, and the best there is written, the default itself if nothing is better. Ctrl-C stops the search
    and writes the best so far.
    """
    path = out if out is not None else Path("tunings") / f"{estimator.rpartition(':')[2]}.toml"
    if path.is_dir() or path.suffix != ".toml":
        raise refuse(ValueError(f"--out needs a file that ends in .toml, not {str(path)!r}"))
    with sentences():
        from vse_gym.evaluation.tune import prepared
        from vse_gym.evaluation.tune import tune as search

        of_kind(estimator, ESTIMATORS)
        prepared(estimator, budget, study, seeds)
        _probe(path, overwrite)
        try:
            with bars() as progress:
                task = progress.add_task(escape(estimator), total=budget)

                def told(what: str, done: int, total: int) -> None:
                    progress.update(task, description=escape(f"{estimator}: {what}"), completed=done, total=total)

                tuning = search(estimator, budget, study, seeds, seed, jobs, told)
        except ModuleNotFoundError as error:
            if error.name != "optuna":
                raise
            raise ModuleNotFoundError("tuning needs optuna: pip install 'vse-gym[tune]'") from None
    screen.print(_settings(tuning))
    for line in _said(tuning.origin):
        screen.print(line, highlight=False)
    try:
        tuning.save(path)
    except OSError as error:
        screen.print(tuning.text, highlight=False, markup=False, soft_wrap=True)
        raise refuse(OSError(f"{path} could not be written: {error}; above is what it would have held")) from None
    screen.print(f"written: {escape(str(path))}, {tuning.label}", highlight=False)
    if tuning.origin["interrupted"]:
        raise typer.Exit(130)


def _probe(path: Path, overwrite: bool) -> None:
    """Whether the file may be written, found out before the search and not after it."""
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists: --overwrite replaces it, --out names another")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OSError(f"{path} cannot be written ({error}): --out needs a file in a folder that can be") from error


def _settings(tuning: Any) -> Table:
    from vse_gym.evaluation.tunings import default_of, ranges

    default, tuned = default_of(tuning.estimator), tuning.make()
    table = Table("setting", "from", "to", "default", "tuned")
    for name, (low, high) in ranges(default).items():
        value = attrgetter(name)
        table.add_row(name, f"{low:g}", f"{high:g}", f"{value(default):.3g}", f"{value(tuned):.3g}")
    return table


def _said(origin: Any) -> list[str]:
    """What came of it, in sentences."""
    lines = [f"{origin['finished']} trials finished, {origin['stopped_early']} stopped early as hopeless"]
    for what in ("training", "validation"):
        if what in origin:
            o = origin[what]
            seeds = f"{what}, seeds {o['first_seed']} to {o['first_seed'] + o['seeds'] - 1}"
            lines.append(f"mean regret, {seeds}: tuned {_interval(o['tuned'])}, default {_interval(o['default'])}")
    outcome = origin["outcome"] if origin["outcome"].startswith("better") else f"[yellow]{origin['outcome']}[/yellow]"
    if "validation" not in origin or origin["validation"]["difference"]["mean"] == 0:
        return [*lines, outcome]
    return [*lines, f"tuned less default: {_interval(origin['validation']['difference'])}: {outcome}"]


def _interval(score: Any) -> str:
    return f"{score['mean']:.2f} ({score['low']:.2f} to {score['high']:.2f})"
