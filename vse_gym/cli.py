"""The command line: list, run; the other commands have files of their own."""

import math
import re
import sys
from collections.abc import Callable
from dataclasses import fields
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Column, Table

from vse_gym import cli_bench, cli_check, cli_compare, cli_procedures, cli_tune
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.cli_check import of_kind
from vse_gym.cli_screen import (
    ControllerName,
    EstimatorName,
    SuiteName,
    VehicleName,
    first_sentence,
    mark,
    refuse,
    screen,
    sentences,
)
from vse_gym.registry import Registry

app = typer.Typer(
    name="vse-gym",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",  # otherwise a paragraph of help keeps the line breaks of the source
)


@app.callback()
def start() -> None:
    """Vehicle state estimation, judged by the drive."""
    # A tunings file may name a class of a file in the current folder; last, so that nothing installed is hidden.
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)


# The end of a sentence: a full stop before a capital, but none after a short capitalised word, as in "Trans. CSAM".
SENTENCE_END = re.compile(r"(?<!\b[A-Z])(?<!\b[A-Z]\w{3})(?<!\b[A-Z]\w{4})\. (?=[A-Z])")


def _head_sentence(path: Path) -> str:
    """The first sentence of the comment at the head of a file."""
    lines = takewhile(lambda line: line.startswith("#"), path.read_text(encoding="utf-8").splitlines())
    said = " ".join(line.removeprefix("#").strip() for line in lines)
    return SENTENCE_END.split(said + " ", maxsplit=1)[0].strip().removesuffix(".") + "." if said else ""


def _differs(suite: Any) -> str:
    """What a sensor suite is: the core of its noise, and each setting that is not the default."""
    usual, sheet = type(suite)(), suite.sheet
    said = [f"sigma {sheet.acceleration:g} m/s2, {math.degrees(sheet.yaw_rate):g} deg/s" if suite.noise else "no noise"]
    for field in fields(suite):
        value = getattr(suite, field.name)
        if value == getattr(usual, field.name) or field.name in ("sheet", "noise"):
            continue
        name, degrees = field.name.replace("_", " "), "yaw_rate" in field.name
        if isinstance(value, float):
            name += f" {math.degrees(value):g} deg" if degrees else f" {value:g}"
        said.append(name)
    return "; ".join(said)


@app.command("list")
def list_names(
    kind: Annotated[str | None, typer.Argument(help="Of one kind alone, such as `estimators`.")] = None,
) -> None:
    """Everything that has a name: estimators, controllers, manoeuvres, vehicles, sensor suites, studies."""
    kinds: dict[str, Callable[[], dict[str, str]]] = {
        "estimator": lambda: _registered(ESTIMATORS),
        "controller": lambda: _registered(CONTROLLERS),
        "manoeuvre": lambda: _registered(MANOEUVRES),
        "vehicle": _vehicles,
        "sensors": _suites,
        "study": _studies,
    }
    plurals = {name: {"study": "studies"}.get(name, name.removesuffix("s") + "s") for name in kinds}
    shown = [name for name in kinds if kind in (None, name, plurals[name])]
    if not shown:
        raise refuse(ValueError(f"nothing is of the kind {kind!r}; known: {', '.join(plurals.values())}"))
    table = Table("kind", "name", Column("what it is", overflow="fold"))
    for one in shown:
        for name, what in kinds[one]().items():
            table.add_row(one, name, escape(what))
        table.add_section()
    screen.print(table)


def _registered(registry: Registry[Any]) -> dict[str, str]:
    return {name: first_sentence(registry[name]) for name in registry}


def _vehicles() -> dict[str, str]:
    from vse_gym import vehicles

    return {name: _head_sentence(vehicles.FOLDER / f"{name}.toml") for name in vehicles.names()}


def _suites() -> dict[str, str]:
    from vse_gym.sensors import EXTRAS, SUITES

    more = {f"<any of these>+{extra}": f"the same with the sensor '{extra}' on board" for extra in EXTRAS}
    return {name: _differs(suite) for name, suite in SUITES.items()} | more


def _studies() -> dict[str, str]:
    from vse_gym.evaluation import STUDIES, study_names

    return {name: _head_sentence(STUDIES / f"{name}.toml") for name in study_names()}


@app.command()
def run(
    manoeuvre: Annotated[
        str, typer.Argument(help="What is driven: a name that `vse-gym list` shows, or module:Class.")
    ],
    estimator: EstimatorName = "ekf",
    controller: ControllerName = "esc",
    vehicle: VehicleName = "qin2014_understeer",
    sensors: SuiteName = "gaussian",
    friction: Annotated[float | None, typer.Option(help="Of the road; without it the manoeuvre's own.")] = None,
    speed_kmh: Annotated[float | None, typer.Option(help="At the start [km/h].")] = None,
    amplitude_deg: Annotated[float | None, typer.Option(help="Of the hand wheel, where there is one [deg].")] = None,
    plant: Annotated[str, typer.Option(help="double_track, or commonroad_mb: CommonRoad's car.")] = "double_track",
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw the drive into this file: .png, .svg, .pdf or another that matplotlib writes."),
    ] = None,
) -> None:
    """Drive once and say how it went; with --plot, draw it.

    The first lines are the manoeuvre's criteria with their limits, the others what the drive cost. A verdict that
    failed is an answer, not an error: the exit code is 0.
    """
    from vse_gym import metrics
    from vse_gym.manoeuvres.base import si
    from vse_gym.scenarios import scenario
    from vse_gym.simulation import rollout

    if plot is not None and (plot.is_dir() or not plot.suffix):
        raise refuse(ValueError(f"--plot needs a file with an ending, such as drive.png, not {str(plot)!r}"))
    given: dict[str, Any] = {"friction": friction, "speed_kmh": speed_kmh, "amplitude_deg": amplitude_deg}
    with sentences():
        settings = si({k: v for k, v in given.items() if v is not None})
        drive = scenario(of_kind(manoeuvre, MANOEUVRES), vehicle, sensors, plant=plant, **settings)
        log = rollout(drive, of_kind(estimator, ESTIMATORS), of_kind(controller, CONTROLLERS), seed)
    if not len(log.time):
        raise refuse(RuntimeError(f"the drive never began: {log.ended}"))
    verdict = drive.manoeuvre.judge(log, drive.nominal)
    test = drive.manoeuvre
    title = f"{manoeuvre} at {3.6 * test.speed:g} km/h on friction {test.friction:g}: {vehicle}, {controller} with "
    title += f"{estimator}, {sensors} sensors, seed {seed}"
    table = Table("", "figure", "limit", title=escape(title), title_justify="left")
    for c in verdict.criteria:
        word = mark(c.passed) if c.judged else "for information"
        sign = ">=" if c.at_least else "<="
        unit = f" {c.unit}".rstrip()
        table.add_row(escape(c.name), f"{c.figure:.2f}{unit}", f"{sign} {c.limit:g}{unit}: {word}")
    table.add_section()
    for name, metric in metrics.METRICS.items():
        words, unit = _in_words(name)
        figure = metric(log)
        table.add_row(words, f"{figure:.2f} {unit}" if unit else "yes" if figure else "no", "")
    screen.print(table)
    screen.print(f"verdict: {mark(verdict.passed, 'passed', 'failed')}")
    if plot is not None:
        from vse_gym.picture import draw

        try:
            plot.parent.mkdir(parents=True, exist_ok=True)
            draw(log, drive, title, plot)
        except ModuleNotFoundError:
            raise refuse(ModuleNotFoundError("drawing needs matplotlib: pip install 'vse-gym[report]'")) from None
        except (ValueError, OSError) as error:
            raise refuse(error) from None
        screen.print(f"drawn: {escape(str(plot))}")


def _in_words(metric: str) -> tuple[str, str]:
    """A metric's name without its unit, and the unit; without one it says yes or no."""
    units = {"deg": "deg", "kJ": "kJ", "mps": "m/s", "s": "s"}
    words, _, suffix = metric.rpartition("_")
    return (words.replace("_", " "), units[suffix]) if suffix in units else (metric.replace("_", " "), "")


app.command("bench")(cli_bench.bench)
app.command("report")(cli_bench.report)
app.command("fmvss126")(cli_procedures.fmvss126)
app.command("entry-speed")(cli_procedures.entry_speed)
app.command("check")(cli_check.check)
app.command("compare")(cli_compare.compare)
app.command("tune")(cli_tune.tune)

if __name__ == "__main__":
    app()
