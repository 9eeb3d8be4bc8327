"""The curves of the rolling car's drives: roll angle, sideslip, and their errors over time."""

from collections.abc import Callable, Mapping
from pathlib import Path

from papers_common import Heard
from papers_statistics import DEG, sideslip_error

from vse_gym.physics import parameters as p
from vse_gym.replay import Trace
from vse_gym.types import Array, Log


def draw(
    folder: Path, what: str, heard: Heard, shown: Mapping[str, str], roll_error: Callable[[Log, Trace], Array]
) -> None:
    """One drive: angles above, estimated and true; errors below. ``shown`` gives filters their colours."""
    from matplotlib.figure import Figure

    log = heard.log
    figure = Figure(figsize=(11, 6), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True)
    sides = (
        ("roll angle [deg]", DEG * log.truth[:, p.ROLL], roll_error),
        ("sideslip [deg]", DEG * log.sideslip, sideslip_error),
    )
    for (label, true, error), (above, below) in zip(sides, grid.T, strict=True):
        for name, colour in shown.items():
            wrong = error(log, heard.traces[name])
            above.plot(log.time, true + wrong, color=colour, lw=0.9, label=name)
            below.plot(log.time, wrong, color=colour, lw=0.9, label=name)
        above.plot(log.time, true, color="black", lw=1.2, label="true")
        above.set_ylabel(label)
        below.set_ylabel("error [deg]")
        below.set_xlabel("time [s]")
    for axes in grid.flat:
        axes.grid(alpha=0.3)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", fontsize=8, ncols=len(shown) + 1)
    figure.suptitle(f"{what} noise, 80 km/h, friction 0.85, each tuned", fontsize=10)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"B_{what.replace(', ', '_').replace(' ', '_').lower()}.png", dpi=110)
