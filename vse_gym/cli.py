"""The command line: list, run, bench."""

import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.registry import Registry

app = typer.Typer(
    name="vse-gym",
    help="Vehicle state estimation, judged by the drive.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
screen = Console()


def _refuse(error: Exception) -> typer.Exit:
    """A mistake of the user is a sentence, not a traceback."""
    Console(stderr=True).print(f"[red]error:[/red] {escape(str(error))}", highlight=False)
    return typer.Exit(2)


def _first_sentence(thing: Any) -> str:
    return (thing.__doc__ or "").strip().split("\n")[0]


@app.command("list")
def list_names() -> None:
    """Everything that has a name: estimators, controllers, manoeuvres, vehicles, sensor suites, studies."""
    from vse_gym import vehicles
    from vse_gym.evaluation import study_names
    from vse_gym.sensors import EXTRAS, SUITES

    kinds: dict[str, Registry[Any]] = {"estimator": ESTIMATORS, "controller": CONTROLLERS, "manoeuvre": MANOEUVRES}
    table = Table("kind", "name", "what it is")
    for kind, registry in kinds.items():
        for name in registry:
            table.add_row(kind, name, _first_sentence(registry[name]))
        table.add_section()
    suites = [*SUITES, *(f"<any of these>+{extra}" for extra in EXTRAS)]
    for kind, names in (("vehicle", vehicles.names()), ("sensors", suites), ("study", study_names())):
        for name in names:
            table.add_row(kind, name, "")
        table.add_section()
    screen.print(table)


@app.command()
def run(
    manoeuvre: Annotated[str, typer.Argument(help="What is driven; `vse-gym list` names all.")],
    estimator: Annotated[str, typer.Option(help="What the controller sees the car through.")] = "ekf",
    controller: Annotated[str, typer.Option(help="Who brakes.")] = "esc",
    vehicle: Annotated[str, typer.Option(help="A name, or the path of a TOML file.")] = "qin2014_understeer",
    sensors: Annotated[str, typer.Option(help="Sensor suite; loud+optical has an optical sensor too.")] = "gaussian",
    friction: Annotated[float | None, typer.Option(help="Of the road; without it the manoeuvre's own.")] = None,
    speed_kmh: Annotated[float | None, typer.Option(help="At the start [km/h].")] = None,
    amplitude_deg: Annotated[float | None, typer.Option(help="Of the hand wheel, where there is one [deg].")] = None,
    plant: Annotated[str, typer.Option(help="double_track, or commonroad_mb: CommonRoad's car.")] = "double_track",
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    plot: Annotated[Path | None, typer.Option(help="Draw the drive into this file (.png, .svg, .pdf).")] = None,
) -> None:
    """Drive once and say how it went; with --plot, draw it."""
    from vse_gym import metrics
    from vse_gym.manoeuvres.base import si
    from vse_gym.simulation import rollout, scenario

    given: dict[str, Any] = {"friction": friction, "speed_kmh": speed_kmh, "amplitude_deg": amplitude_deg}
    try:
        settings = si({k: v for k, v in given.items() if v is not None})
        drive = scenario(manoeuvre, vehicle, sensors, plant=plant, **settings)
        log = rollout(drive, estimator, controller, seed)
    except (KeyError, ValueError, TypeError, ModuleNotFoundError) as error:
        raise _refuse(error) from None
    if not len(log.time):
        raise _refuse(RuntimeError(f"the drive never began: {log.ended}"))
    verdict = drive.manoeuvre.judge(log, drive.nominal)
    title = f"{manoeuvre}, {vehicle}, {controller} with {estimator}, {sensors} sensors, seed {seed}"
    table = Table("", "figure", "limit", title=escape(title), title_justify="left")
    for c in verdict.criteria:
        mark = ("[green]ok[/green]" if c.passed else "[red]fails[/red]") if c.judged else "for information"
        sign = ">=" if c.at_least else "<="
        table.add_row(escape(c.name), f"{c.figure:.2f} {c.unit}", f"{sign} {c.limit:g} {c.unit}: {mark}")
    table.add_section()
    for name, metric in metrics.METRICS.items():
        table.add_row(name, f"{metric(log):.2f}", "")
    screen.print(table)
    screen.print(f"verdict: {'[green]passed[/green]' if verdict.passed else '[red]failed[/red]'}")
    if plot is not None:
        from vse_gym.picture import draw

        try:
            draw(log, drive, title, plot)
        except ModuleNotFoundError:
            raise _refuse(ModuleNotFoundError("drawing needs matplotlib: pip install 'vse-gym[report]'")) from None
        except (ValueError, OSError) as error:
            raise _refuse(error) from None
        screen.print(f"drawn: {escape(str(plot))}")


@app.command()
def bench(
    study: Annotated[str, typer.Argument(help="A study's name, or the path of its TOML file.")],
    estimators: Annotated[str, typer.Option(help="Comma-separated names; without it the study's own.")] = "",
    seeds: Annotated[int | None, typer.Option(min=1, help="How many; without it the study's own.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes; -1: all cores.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for the table of runs, the summary and the figure.")] = None,
) -> None:
    """Drive a study and print its table, least regret first."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from vse_gym import report
    from vse_gym.evaluation import Study, run_study, table

    names = [name.strip() for name in estimators.split(",") if name.strip()] or None
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    rows: list[dict[str, Any]] = []
    begin, stopped = time.perf_counter(), False
    try:
        plan = Study.load(study)
        work = run_study(plan, names, seeds, jobs)
        with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=screen, transient=True) as progress:
            task = progress.add_task(f"{plan.name}: cells x seeds", total=len(plan.cells) * (seeds or plan.seeds))
            for part in work:
                rows += part
                progress.advance(task)
    except KeyboardInterrupt:
        stopped = True
    except (KeyError, ValueError, TypeError, ModuleNotFoundError) as error:
        raise _refuse(error) from None
    if not rows:
        raise _refuse(RuntimeError("stopped before the first cell was finished"))
    runs = table(rows)
    title = f"{plan.name}, version {plan.version}"
    screen.print(report.on_screen(*report.cells_of(report.summary(runs), narrow=True), title=escape(title), whole=3))
    screen.print(report.LEGEND, style="dim", highlight=False)
    screen.print(report.on_screen(*report.by_cell(runs), title="regret by cell"))
    for line in report.reasons(runs):
        screen.print(escape(line), style="red", highlight=False)
    note = ", [red]stopped early[/red]" if stopped else ""
    screen.print(f"{len(rows)} runs in {time.perf_counter() - begin:.1f} s{note}")
    if out is not None:
        report.write(runs, out, " ".join(["vse-gym", *sys.argv[1:]]))
        screen.print(f"written: {escape(str(out))}")
    if stopped:
        raise typer.Exit(130)


if __name__ == "__main__":
    app()
