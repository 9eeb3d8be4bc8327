"""What all commands share: the screen, mistakes as sentences, a bar, and options that mean the same everywhere."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

screen = Console()


def _processes(jobs: int) -> int:
    if jobs < 1 and jobs != -1:
        raise typer.BadParameter(f"must be at least 1, or -1 for all cores, not {jobs}")
    return jobs


EstimatorName = Annotated[
    str,
    typer.Option(
        "--estimator",
        help="What the controller sees the car through: a name that `vse-gym list` shows, or module:Class.",
    ),
]
ControllerName = Annotated[str, typer.Option("--controller", help="Who brakes, by such a name; `none`: nobody.")]
VehicleName = Annotated[str, typer.Option("--vehicle", help="A name, or the path of a TOML file of your own.")]
SuiteName = Annotated[str, typer.Option("--sensors", help="Sensor suite: how the readings lie.")]
Jobs = Annotated[int, typer.Option("--jobs", help="Processes; -1: all cores.", callback=_processes)]


def refuse(error: Exception) -> typer.Exit:
    """A mistake of the user is a sentence, not a traceback."""
    console = Console(stderr=True)  # which shall not break a path: the terminal folds what is too long
    console.print(f"[red]error:[/red] {escape(str(error))}", highlight=False, soft_wrap=True)
    return typer.Exit(2)


@contextmanager
def sentences(*others: type[Exception]) -> Iterator[None]:
    """Names and settings that cannot be, and other errors, are a sentence and exit code 2; Ctrl-C is one and 130."""
    said: tuple[type[Exception], ...] = (KeyError, ValueError, TypeError, OSError, ModuleNotFoundError, *others)
    try:
        yield
    except said as error:
        raise refuse(error) from None
    except KeyboardInterrupt:
        Console(stderr=True).print("stopped", highlight=False)
        raise typer.Exit(130) from None


def first_sentence(thing: Any) -> str:
    """The first line of a docstring, which says what it is."""
    return (thing.__doc__ or "").strip().split("\n")[0]


def bars() -> Progress:
    """How far the work is, while it lasts."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=screen, transient=True)


@contextmanager
def bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar that is told how many of how many are done."""
    with bars() as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def mark(good: bool, yes: str = "ok", no: str = "fails") -> str:
    """A word in its colour."""
    return f"[green]{yes}[/green]" if good else f"[red]{no}[/red]"
