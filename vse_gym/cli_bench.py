"""Commands that make and show tables: bench and report."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from vse_gym.cli_check import TargetError, find
from vse_gym.cli_screen import Jobs, bar, refuse, screen, sentences

if TYPE_CHECKING:
    import polars


def bench(
    study: Annotated[str, typer.Argument(help="A study's name, or the path of its TOML file.")],
    estimators: Annotated[
        str, typer.Option(help="Comma-separated names, or module:Class of your own; without it the study's own.")
    ] = "",
    seeds: Annotated[int | None, typer.Option(min=1, help="How many; without it the study's own.")] = None,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for finished cells, tables and figures.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what --out holds.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Throw away what --out holds.")] = False,
    precision: Annotated[
        float | None,
        typer.Option(min=1e-3, help="Add seeds until every 95 % interval of mean regret reaches no farther than this."),
    ] = None,
    max_seeds: Annotated[int, typer.Option(min=1, help="Where --precision stops adding.")] = 200,
    tunings: Annotated[
        Path | None, typer.Option(help="A file from `vse-gym tune`, a folder of such files, or `published`.")
    ] = None,
    backend: Annotated[str, typer.Option(help="loky: this machine; ray, dask: a cluster, or a local one.")] = "loky",
) -> None:
    """Drive a study and print its table, least regret first.

    Regret is what it costs to see the car through an estimate and not by its true states. With --out, each finished
    cell is kept at once: a run that was stopped or killed goes on with --resume and ends as if it never had been, and
    so does one to which estimators or seeds are added. Ctrl-C stops early and shows what was driven until then.
    """
    from vse_gym.evaluation import Bench, Finished, Results, ResultsError, Study, contenders_of, write_runs

    begin, command = time.perf_counter(), " ".join(["vse-gym", *sys.argv[1:]])
    if (resume or overwrite) and out is None:
        raise refuse(ValueError("--resume and --overwrite need --out: the folder that they are about"))
    if resume and overwrite:
        raise refuse(ValueError("--resume keeps what there is and --overwrite throws it away: give one"))
    with sentences(ResultsError):
        plan = Study.load(study)
        tuned = _tuned(tunings)
        judged = contenders_of(plan, _named(estimators), tuned)
        _say_unused(tuned, judged)
        count = seeds or plan.seeds
        if precision is not None and max_seeds < count:
            raise ValueError(f"--max-seeds {max_seeds} is less than the {count} seeds to begin with")
        finished = Finished()
        if out is not None:
            finished = Results(out, plan, judged, command, count, resume, overwrite)
    for part in finished.damaged:
        screen.print(f"[red]damaged, set aside and driven again:[/red] {escape(part)}", highlight=False)
    work = Bench(plan, judged, count, jobs, backend, finished)
    stopped = False
    with _kept_in(out):
        try:
            with bar(f"{plan.name}: cells x seeds") as tell:
                work = work.drive(tell) if precision is None else work.drive_until(precision, max_seeds, tell)
        except KeyboardInterrupt:
            stopped = True
        try:
            seen = None if stopped else work.numbers
            runs = finished.everybody(seen) if isinstance(finished, Results) else finished.collect(judged, seen)
        except ResultsError as error:  # Ctrl-C before anything was there
            screen.print(f"stopped: {error}")
            raise typer.Exit(STOPPED) from None
        show(runs, f"{plan.name}, version {plan.version}")
        note = ", [red]stopped early[/red]" if stopped else ""
        screen.print(f"{len(runs)} runs in {time.perf_counter() - begin:.1f} s{note}")
        if precision is not None:
            _say_precision(runs, precision)
        if isinstance(finished, Results):
            _say_unfinished(runs, finished.folder)
            write_runs(finished.folder, runs)
            _write(runs, finished.folder, command)
    if stopped:
        raise typer.Exit(STOPPED)


@contextmanager
def _kept_in(out: Path | None) -> Iterator[None]:
    """What cannot be driven or written is a sentence, which says where the finished cells are."""
    try:
        yield
    except (ValueError, OSError, ModuleNotFoundError) as error:
        kept = "" if out is None else f"; finished cells are kept in {out}, --resume goes on with them"
        raise refuse(RuntimeError(f"{error}{kept}")) from None


STOPPED = 130  # exit code of Ctrl-C


def report(folder: Annotated[Path, typer.Argument(help="What `vse-gym bench --out` wrote.")]) -> None:
    """Make the tables and figures of a results folder again, also of one whose run was killed."""
    from vse_gym.evaluation import ResultsError, read_runs, write_runs

    with sentences(ResultsError):
        runs = read_runs(folder)
    show(runs, f"{runs['study'][0]}, version {runs['version'][0]}")
    with sentences(ResultsError):
        _say_unfinished(runs, folder)
        write_runs(folder, runs)
        _write(runs, folder, f"vse-gym report {folder}")


def show(runs: "polars.DataFrame", title: str) -> None:
    """The tables of a study on the screen."""
    from vse_gym import report
    from vse_gym.report.details import attribution

    if "bound_sideslip_deg" in runs.columns:
        _show_bound(runs, title)
        return
    screen.print(report.on_screen(*report.cells_of(report.summary(runs), narrow=True), title=escape(title), whole=3))
    screen.print(report.LEGEND, style="dim", highlight=False)
    for block in report.in_blocks(*report.by_cell(runs)):
        screen.print(report.on_screen(*block, title="regret by cell"))
    if (parts := attribution(runs)) is not None:
        screen.print(report.on_screen(*parts, title="regret if only a part is estimated and the rest is true"))
    for line in report.reasons(runs):
        screen.print(escape(line), style="red", highlight=False)


def _show_bound(runs: "polars.DataFrame", title: str) -> None:
    from vse_gym.report import on_screen
    from vse_gym.report.bound import LEGEND, bound_cells, multiples

    times = multiples(runs)
    for (cell,), part in times.group_by(["cell"], maintain_order=True):
        heads, rows = bound_cells(part, narrow=True)
        screen.print(on_screen(heads, rows, title=escape(f"{title}: {cell}")))
    screen.print(LEGEND, style="dim", highlight=False)


def _write(runs: "polars.DataFrame", folder: Path, command: str) -> None:
    from vse_gym import report
    from vse_gym.report.bound import write_bound

    with screen.status("drawing"):
        if "bound_sideslip_deg" in runs.columns:
            write_bound(runs, folder, command)
        else:
            report.write_tables(runs, folder, command)
    screen.print(f"written: {escape(str(folder))}")


def _say_unfinished(runs: "polars.DataFrame", folder: Path) -> None:
    from vse_gym.evaluation import unfinished

    if lacking := unfinished(runs, folder):
        screen.print(f"[red]{escape(lacking)}[/red]", highlight=False)


def _say_precision(runs: "polars.DataFrame", asked: float) -> None:
    from vse_gym.report.statistics import precision

    reached = precision(runs)
    word = "reached" if reached <= asked else "[red]not reached[/red]"
    screen.print(f"precision {asked:g} {word}: {reached:.3f} with {runs['seed'].n_unique()} seeds", highlight=False)


def _named(estimators: str) -> list[Any] | None:
    """Names as they are, module:Class as an instance."""
    names = [name.strip() for name in estimators.split(",") if name.strip()]
    try:
        return [name if ":" not in name else next(iter(find(name))) for name in names] or None
    except TargetError as error:
        raise ValueError(str(error)) from error


def _tuned(path: Path | None) -> dict[str, tuple[Any, str]]:
    """Estimators of tunings files, and what to call their tunings, by name."""
    if path is None:
        return {}
    from vse_gym.evaluation.tunings import load_folder

    return {name: (tuning.make(), tuning.label) for name, tuning in load_folder(path).items()}


def _say_unused(tuned: dict[str, tuple[Any, str]], judged: Sequence[Any]) -> None:
    used = {contender.tuning for contender in judged}
    if unused := sorted(name for name, (_, label) in tuned.items() if label not in used):
        screen.print(f"[red]not used:[/red] tunings of {', '.join(unused)}, whom nobody judges here", highlight=False)
