"""The curves of Chen et al. (2024), redrawn: sideslip, who is on, and errors over time."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from papers_common import Heard
from papers_statistics import DEG, sideslip_error

mpl.use("Agg")
from matplotlib import pyplot as plt

COLOURS = {"switching": "tab:red", "fusion": "tab:blue", "kf": "tab:green"}


def draw(heard: Heard, title: str, path: Path) -> None:
    """One drive: true and estimated sideslip above, errors below; grey where the kinematic scheme is on."""
    log = heard.log
    figure, axes = plt.subplots(2, 1, figsize=(9, 5.5), sharex=True, layout="constrained")
    kinematic = np.isnan(heard.traces["switching"].nis)  # the integral has no innovation
    for axis in axes:
        axis.fill_between(
            log.time, 0, 1, where=kinematic, transform=axis.get_xaxis_transform(), color="0.88", linewidth=0
        )
        axis.grid(alpha=0.3)
        axis.margins(y=0.18)  # room for the legend
    axes[0].plot(log.time, DEG * log.sideslip, "k", linewidth=1.5, label="true")
    for name, colour in COLOURS.items():
        error = sideslip_error(log, heard.traces[name])
        if name != "kf":
            axes[0].plot(log.time, DEG * log.sideslip + error, color=colour, linewidth=0.8, label=name)
        axes[1].plot(log.time, error, color=colour, linewidth=0.8, label=name)
    axes[0].set_ylabel("sideslip [deg]")
    axes[1].set_ylabel("error [deg]")
    axes[1].set_xlabel("time [s]; grey: kinematic scheme on")
    axes[0].set_title(title)
    axes[0].legend(loc="upper right", ncols=3, fontsize="small")
    axes[1].legend(loc="upper right", ncols=3, fontsize="small")
    figure.savefig(path, dpi=110)
    plt.close(figure)
