"""A learning curve as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure


def draw_curve(path: Path, curve: Sequence[Any], alone: Mapping[str, float], title: str) -> None:
    """Returns over steps: while exploring, and on held-out drives, beside those of the controller alone and of nobody.

    Args:
        path: Of the picture.
        curve: Points of a run.
        alone: Mean returns "controller_alone" and "nobody" on the same held-out drives.
        title: Of the picture.
    """
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(6, 3.2), layout="constrained")
        axes = figure.subplots()
        steps = [point.steps / 1e3 for point in curve]
        axes.plot(steps, [point.training for point in curve], color="0.7", label="training drives, exploring")
        (line,) = axes.plot(steps, [point.held_out for point in curve], label="held-out drives, mean")
        low, mean = [point.low for point in curve], [point.held_out for point in curve]
        axes.fill_between(steps, low, mean, color=line.get_color(), alpha=0.15, label="down to their worst tenth")
        axes.axhline(alone["controller_alone"], color="C1", linestyle="--", label="the controller underneath, alone")
        axes.axhline(alone["nobody"], color="C3", linestyle=":", label="nobody")
        axes.set(xlabel="thousand steps", ylabel="return of a drive", title=title)
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
        figure.savefig(path, dpi=110)
