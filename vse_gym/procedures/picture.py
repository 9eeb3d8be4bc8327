"""A picture of the whole FMVSS 126 series: hand wheel and yaw rate of every run, and the limits."""

from pathlib import Path
from typing import Any

import numpy as np

from vse_gym.manoeuvres.base import DEG
from vse_gym.manoeuvres.sine_with_dwell import SineWithDwell
from vse_gym.procedures.series import Fmvss126

PASSED, FAILED = "C0", "C3"


def draw_series(result: Fmvss126, title: str, path: str | Path) -> None:
    """Hand wheel, yaw rate, and yaw rate over its peak after the reversal with the limits; left and right in columns.

    Raises:
        ModuleNotFoundError: If matplotlib, of the extra [report], is not installed.
        ValueError: If the path's ending is no picture format.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 9), layout="constrained")
    figure.suptitle(title, fontsize=11)
    grid: Any = figure.subplots(3, 2, sharex=True, sharey="row")
    for column, (side, name) in enumerate(((1.0, "first to the left"), (-1.0, "first to the right"))):
        runs = [run for run in result.runs if run.amplitude * side > 0]
        for run in runs:
            # the larger the amplitude, the darker the line
            look = {
                "color": PASSED if run.passed else FAILED,
                "alpha": 0.3 + 0.7 * abs(run.amplitude) / max(abs(r.amplitude) for r in runs),
                "lw": 0.9,
            }
            grid[0, column].plot(run.time, run.hand_wheel / DEG, **look)
            grid[1, column].plot(run.time, run.yaw_rate / DEG, **look)
            if np.isfinite(run.yaw_rate_peak):
                grid[2, column].plot(run.time, -100 * side * run.yaw_rate / run.yaw_rate_peak, **look)
        grid[0, column].set_title(name, fontsize=10)
        _limits(grid[2, column])
        grid[2, column].set_xlabel("time [s]")
    for row, label in enumerate(("hand wheel [deg]", "yaw rate [deg/s]", "yaw rate over its peak\nafter reversal [%]")):
        grid[row, 0].set_ylabel(label)
    grid[2, 0].set_ylim(-120, 180)
    for colour, label in ((PASSED, "passed"), (FAILED, "failed")):
        grid[0, 1].plot([], [], color=colour, label=label)
    grid[0, 1].legend(fontsize=8, loc="upper right")
    for axes in grid.flat:
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def _limits(axes: Any) -> None:
    complete = SineWithDwell().complete
    for wait, limit in ((1.00, 35.0), (1.75, 20.0)):
        when = complete + wait
        axes.plot([when, when], [limit, 180], color="black", lw=2.5, solid_capstyle="butt")
        axes.annotate(f"{limit:g} %", (when, limit), textcoords="offset points", xytext=(4, 2), fontsize=8)
