"""System C's pictures: the mass, the motion with its errors, and the fuzzy controller's surface."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from papers_common import Heard
from papers_statistics import DEG, motion_error, sideslip_error

from vse_gym.inference.fuzzy import CENTRES, OUTPUTS, SETS, rule_surface
from vse_gym.physics import parameters as p
from vse_gym.types import FOUND


def draw_mass(panels: Mapping[str, Heard], colours: Mapping[str, str], true: float, band: float, path: Path) -> None:
    """The mass over time, a panel for each drive; grey: within so much of the true one [kg]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    frames = figure.subplots(1, len(panels), sharey=True)
    for axes, (title, (log, traces)) in zip(frames, panels.items(), strict=True):
        for name, colour in colours.items():
            if name in traces:
                axes.plot(log.time, traces[name].found[:, FOUND.index("mass")], color=colour, label=name)
        axes.axhspan(true - band, true + band, color="0.85", label=f"true, and {band:g} kg beside it")
        axes.set(xlabel="time [s]", title=title)
    frames[0].set_ylabel("mass [kg]")
    figure.legend(*frames[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    figure.savefig(path, dpi=120)


def draw_motion(heard: Heard, colours: Mapping[str, str], printed: Mapping[str, float], path: Path) -> None:
    """vx, sideslip and yaw rate on the left, their errors on the right; grey: the largest that was printed."""
    from matplotlib.figure import Figure

    log, traces = heard
    true = log.truth[:, p.VX], DEG * log.sideslip, DEG * log.truth[:, p.YAW_RATE]
    figure = Figure(figsize=(9, 7.5), layout="constrained")
    frames = figure.subplots(3, 2, sharex=True)
    for row, ((quantity, limit), unit) in enumerate(zip(printed.items(), ("m/s", "deg", "deg/s"), strict=True)):
        frames[row, 0].plot(log.time, true[row], color="k", lw=1.6, label="truth")
        frames[row, 1].axhspan(-limit, limit, color="0.85", label="largest error printed of RLS-FAEKF")
        for name, colour in colours.items():
            errors = motion_error(log, traces[name], 0), sideslip_error(log, traces[name])
            error = (*errors, motion_error(log, traces[name], 2))[row]
            frames[row, 0].plot(log.time, true[row] + error, color=colour, lw=0.9)
            frames[row, 1].plot(log.time, error, color=colour, lw=0.9, label=name)
        frames[row, 0].set_ylabel(f"{quantity} [{unit}]")
        frames[row, 1].set_ylabel(f"error [{unit}]")
    figure.align_ylabels(frames)
    lines = [pair for axes in frames[0] for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    figure.legend(*zip(*lines, strict=True), loc="outside lower center", ncols=2, fontsize=8)
    for axes in frames[-1]:
        axes.set_xlabel("time [s]")
    figure.savefig(path, dpi=120)


def draw_surface(path: Path) -> None:
    """The fuzzy controller's surface, as the filter interpolates it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 6))
    axes = figure.add_axes((0.04, 0.06, 0.86, 0.84), projection="3d")
    e, change = np.meshgrid(np.linspace(-1, 1, len(SETS)), np.linspace(-1, 1, len(SETS)), indexing="ij")
    axes.plot_surface(e, change, rule_surface(), cmap="viridis", edgecolor="0.3", linewidth=0.4)
    axes.set_xticks(np.linspace(-1, 1, len(SETS)), SETS, fontsize=7)
    axes.set_yticks(np.linspace(-1, 1, len(SETS)), SETS, fontsize=7)
    axes.set_zticks(CENTRES, [f"{10**c:.3g} {name}" for c, name in zip(CENTRES, OUTPUTS, strict=True)], fontsize=7)
    axes.tick_params(axis="z", pad=10)
    axes.set(xlabel="e", ylabel="change of e", title="factor U of R")
    axes.view_init(elev=24, azim=-130)
    figure.savefig(path, dpi=120)
