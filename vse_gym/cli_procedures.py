"""Commands that drive a whole procedure: fmvss126 and entry-speed."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.markup import escape
from rich.table import Table

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.cli_check import of_kind
from vse_gym.cli_screen import (
    ControllerName,
    EstimatorName,
    Jobs,
    SuiteName,
    VehicleName,
    bar,
    mark,
    refuse,
    screen,
    sentences,
)
from vse_gym.manoeuvres.base import DEG, KMH


def fmvss126(
    vehicle: VehicleName = "qin2014_understeer",
    estimator: EstimatorName = "ekf",
    controller: ControllerName = "esc",
    sensors: SuiteName = "gaussian",
    seed: Annotated[int, typer.Option(help="Of the noise, the same in every run.")] = 0,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for the table (CSV) and a picture of all runs.")] = None,
) -> None:
    """The whole FMVSS 126 test of a car, an estimator and a controller; exit code 0 if all runs pass, else 1.

    Slowly increasing steer gives A, the hand-wheel angle at 0.3 g, as the mean of both directions. Each is driven
    once, without control: the standard repeats it three times, but this plant repeats itself exactly. Then sines with
    dwell of 1.5 A, 2 A, ... are driven to both sides at 80 km/h.
    """
    from vse_gym import procedures

    title = f"FMVSS 126, {vehicle}, {controller} with {estimator}, {sensors} sensors, seed {seed}"
    with sentences():
        eyes, law = of_kind(estimator, ESTIMATORS), of_kind(controller, CONTROLLERS)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        with bar("sines with dwell") as progress:
            result = procedures.fmvss126(vehicle, eyes, law, sensors, seed, jobs, progress)
        screen.print(_series_table(result, title))
        screen.print(
            f"A = {result.steer_at_0_3g / DEG:.1f} deg of hand wheel, mean of left and right, one drive each "
            "(the plant repeats itself).\nIn brackets: not judged; the displacement counts from 5 A on.",
            style="dim",
            highlight=False,
        )
        for why in sorted({run.ended for run in result.runs if run.ended}):
            count = sum(run.ended == why for run in result.runs)
            screen.print(f"{count} runs ended early: {escape(why)}", highlight=False)
        passed = sum(run.passed for run in result.runs)
        largest = f"largest sideslip {result.peak_sideslip / DEG:.1f} deg"
        word = mark(result.passed, "passed", "failed")
        screen.print(f"verdict: {word}, {passed} of {len(result.runs)} runs, {largest}", highlight=False)
        if out is not None:
            _write_series(result, title, out)
    raise typer.Exit(0 if result.passed else 1)


def _series_table(result: Any, title: str) -> Table:
    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    limits = ("1.00 s\n<= 35 %", "1.75 s\n<= 20 %", "1.07 s\n>= 1.83 m")
    for head in ("A", "deg", "first", *limits, "sideslip\ndeg", "brakes\nkJ", ""):
        table.add_column(head, justify="right", no_wrap=True)
    for run in result.runs:
        figures = [_figure(c) for c in run.criteria if c.unit == "m" or c.judged]
        side = "left" if run.amplitude > 0 else "right"
        numbers = [f"{run.peak_sideslip / DEG:.1f}", f"{run.brake_energy / 1e3:.0f}"]
        steer = [f"{run.multiple:.1f}", f"{abs(run.amplitude) / DEG:.0f}", side]
        table.add_row(*steer, *figures, *numbers, mark(run.passed, "passed", "failed"))
    return table


def _figure(c: Any) -> str:
    number = "-" if math.isnan(c.figure) else format(c.figure, ".2f" if c.unit == "m" else ".1f")
    return f"{number} {mark(c.passed)}" if c.judged else f"({number})"


def _write_series(result: Any, title: str, out: Path) -> None:
    from vse_gym.procedures.picture import draw_series

    result.table().write_csv(out / "fmvss126.csv")
    try:
        draw_series(result, title, out / "fmvss126.png")
    except ModuleNotFoundError:
        screen.print("no picture: drawing needs matplotlib: pip install 'vse-gym\\[report]'")
    screen.print(f"written: {escape(str(out))}", highlight=False)


def entry_speed(
    manoeuvre: Annotated[
        str, typer.Argument(help="What is driven: a name that `vse-gym list` shows, or module:Class.")
    ],
    vehicle: VehicleName = "qin2014_understeer",
    estimator: EstimatorName = "ekf",
    controller: ControllerName = "esc",
    sensors: SuiteName = "gaussian",
    friction: Annotated[float | None, typer.Option(help="Of the road; without it the manoeuvre's own.")] = None,
    amplitude_deg: Annotated[float | None, typer.Option(help="Of the hand wheel, where there is one [deg].")] = None,
    low: Annotated[float, typer.Option(min=1, help="Where the scan begins [km/h].")] = 30,
    high: Annotated[float, typer.Option(min=1, help="Where it ends [km/h].")] = 130,
    scan: Annotated[float, typer.Option(min=0.01, help="Its step [km/h].")] = 10,
    tolerance: Annotated[float, typer.Option(min=0.01, help="Of the answer [km/h].")] = 0.5,
    seeds: Annotated[int, typer.Option(min=1, help="How many, each with its own noise.")] = 1,
    share: Annotated[float, typer.Option(min=0.01, max=1, help="Of the seeds that must be clean.")] = 1.0,
    jobs: Jobs = 1,
) -> None:
    """Highest speed at which a manoeuvre still passes; exit code 1 if it fails at the lowest already.

    A scan over speed, then bisection at the first failure. Verdicts need not be monotone in speed: a speed above that
    passes again is reported.
    """
    from vse_gym import procedures

    if not low < high:
        raise refuse(ValueError(f"--low must lie below --high, not at {low:g} and {high:g} km/h"))
    settings: dict[str, Any] = {} if friction is None else {"friction": friction}
    if amplitude_deg is not None:
        settings["amplitude"] = amplitude_deg * DEG
    ranges = {"low": low * KMH, "high": high * KMH, "tolerance": tolerance * KMH, "scan": scan * KMH}
    with sentences(), bar(f"{manoeuvre}: drives") as progress:
        result = procedures.entry_speed(
            of_kind(manoeuvre, MANOEUVRES),
            vehicle,
            of_kind(estimator, ESTIMATORS),
            of_kind(controller, CONTROLLERS),
            sensors,
            **ranges,
            seeds=range(seeds),
            share=share,
            jobs=jobs,
            progress=progress,
            **settings,
        )
    road = "" if friction is None else f", friction {friction:g}"
    title = f"{manoeuvre}, {vehicle}, {controller} with {estimator}, {sensors} sensors{road}"
    screen.print(escape(title), style="italic", highlight=False)
    screen.print(_steps_table(result))
    screen.print(_answer(result), highlight=False)
    for line in _islands(result):
        screen.print(line, style="yellow", highlight=False)
    raise typer.Exit(1 if math.isnan(result.speed) else 0)


def _steps_table(result: Any) -> Table:
    table = Table("km/h", "clean", "what was not kept")
    attempts = [a for search in result.searches for a in search.attempts]
    for speed in sorted({a.speed for a in attempts}):
        here = [a for a in attempts if a.speed == speed]
        clean = sum(a.clean for a in here)
        reasons = sorted({name for a in here for name in a.failed})
        count = mark(clean == len(here), f"{clean} of {len(here)}", f"{clean} of {len(here)}")
        table.add_row(f"{3.6 * speed:.1f}", count, escape("; ".join(reasons)))
    return table


def _answer(result: Any) -> str:
    tolerance = f"{3.6 * result.tolerance:g} km/h"
    seeds = len(result.searches)
    if math.isnan(result.speed):
        return f"entry speed: [red]none[/red], not clean at {3.6 * result.low:.1f} km/h already (--low moves the start)"
    if not result.bounded:
        return f"entry speed: at least {3.6 * result.speed:.1f} km/h, the highest that was tried"
    line = f"entry speed: [bold]{3.6 * result.speed:.1f} km/h[/bold], to {tolerance}"
    if seeds == 1:
        return line
    slowest, fastest = (f"{3.6 * v:.1f}" if v == v else "none" for v in result.spread)
    return (
        f"{line}, with {100 * result.share:g} % of {seeds} seeds clean; single seeds from {slowest} to {fastest} km/h"
    )


def _islands(result: Any) -> list[str]:
    """Where a seed is clean again above its first failure."""
    lines = []
    for search in result.searches:
        if search.islands:
            shown = [f"{3.6 * v:.1f}" for v in search.islands]
            speeds = f"{len(shown)} speeds from {shown[0]} to {shown[-1]}" if len(shown) > 3 else ", ".join(shown)
            first = f"above its first failure at {3.6 * search.fails:.1f} km/h"
            lines.append(f"not monotone: seed {search.seed} is clean again at {speeds} km/h, {first}")
    return lines
