"""Sideslip and stiffnesses of system E over a drive."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from papers_common import Heard
from papers_statistics import DEG

from vse_gym.metrics_found import true_value
from vse_gym.types import FOUND


def draw(title: str, heard: Heard, colours: Mapping[str, str], path: Path) -> None:
    """Reference and estimates; the road wheels' angle below."""
    from matplotlib.figure import Figure

    log, traces = heard
    figure = Figure(figsize=(8, 8.5), layout="constrained")
    frames = figure.subplots(4, 1, sharex=True, height_ratios=(3, 3, 3, 1))
    axles = ("stiffness_front", "stiffness_rear")
    for name, colour in colours.items():
        estimate, found = traces[name].estimate, traces[name].found
        frames[0].plot(log.time, DEG * np.arctan2(estimate[:, 1], estimate[:, 0]), color=colour, lw=1, label=name)
        for axes, axle in zip(frames[1:3], axles, strict=True):
            axes.plot(log.time, 1e-3 * found[:, FOUND.index(axle)], color=colour, lw=1)
    frames[0].plot(log.time, DEG * log.sideslip, "k", lw=1.4, label="reference")
    for axes, axle in zip(frames[1:3], axles, strict=True):
        axes.plot(log.time, 1e-3 * true_value(log, axle), "k", lw=1.4)
        axes.set_ylabel(f"{axle.replace('_', ' ')} [kN/rad]")
        axes.set_ylim(bottom=0)
    frames[0].set(ylabel="sideslip [deg]", title=title)
    frames[0].legend(fontsize=8, frameon=False)
    frames[3].plot(log.time, DEG * log.steer, "k", lw=1)
    frames[3].set(ylabel="steer [deg]", xlabel="time [s]")
    figure.align_ylabels(frames)
    figure.savefig(path, dpi=120)
