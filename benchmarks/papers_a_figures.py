"""The curves of Qin et al. (2014) redrawn: states over time, errors at a peak, and why the autoregression lags."""

from pathlib import Path
from typing import Any

import numpy as np
from papers_common import Heard
from papers_statistics import DEG, motion_error, sideslip_error

from vse_gym.inference.autoregression import coefficients_used
from vse_gym.physics import parameters as p
from vse_gym.scenarios import Scenario
from vse_gym.sensors import stream
from vse_gym.types import Array, Reading

SHOWN = {"mapf": "C3", "pf": "C0", "strong_tracking": "C2", "mapf_physics": "C1"}
PANELS = (  # label, column of an estimate (-1: sideslip), index in the plant's state, factor
    ("vx [m/s]", 0, p.VX, 1.0),
    ("vy [m/s]", 1, p.VY, 1.0),
    ("ax [m/s²]", 3, p.AX, 1.0),
    ("ay [m/s²]", 4, p.AY, 1.0),
    ("yaw rate [deg/s]", 2, p.YAW_RATE, DEG),
    ("sideslip [deg]", -1, -1, DEG),
)


def _panels(title: str) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 8), layout="constrained")
    figure.suptitle(title, fontsize=11)
    return figure, figure.subplots(3, 2, sharex=True)


def _true(heard: Heard, at: int) -> Array:
    return heard.log.sideslip if at < 0 else heard.log.truth[:, at]


def draw_states(heard: Heard, path: Path) -> None:
    """The six states, true and estimated, over the drive."""
    figure, axes = _panels("Slalom, 50 km/h, 100 Hz, Cauchy-Gaussian noise: states")
    for ax, (label, column, at, factor) in zip(axes.ravel(), PANELS, strict=True):
        ax.plot(heard.log.time, factor * _true(heard, at), "k", lw=1.2, zorder=3, label="true")  # over the noise
        for name, colour in SHOWN.items():
            estimate = heard.traces[name].estimate
            value = np.arctan2(estimate[:, 1], estimate[:, 0]) if column < 0 else estimate[:, column]
            ax.plot(heard.log.time, factor * value, color=colour, lw=0.8, label=name)
        ax.set_ylabel(label)
    _finish(figure, axes, path)


def draw_errors(heard: Heard, path: Path) -> None:
    """The six states' errors around the strongest peak of ay."""
    figure, axes = _panels("The same drive: errors around the strongest peak of ay")
    middle = heard.log.time[np.argmax(np.abs(heard.log.truth[:, p.AY]))]
    near = np.abs(heard.log.time - middle) < 0.6
    for ax, (label, column, _, _) in zip(axes.ravel(), PANELS, strict=True):
        ax.axhline(0, color="k", lw=0.8)
        for name, colour in SHOWN.items():
            trace = heard.traces[name]
            wrong = sideslip_error(heard.log, trace) if column < 0 else motion_error(heard.log, trace, column)
            ax.plot(heard.log.time[near], wrong[near], color=colour, lw=1, label=name)
        ax.set_ylabel(f"error of {label}")
    _finish(figure, axes, path)


def draw_why(heard: Heard, estimator: Any, setting: Scenario, seed: int, path: Path) -> None:
    """What the autoregression of vy foretells a step ahead against what it becomes, and the coefficients it learns."""
    from matplotlib.figure import Figure

    log, rng = heard.log, stream(seed, "estimator")
    state = estimator.init(setting.nominal, rng)
    foretold, learnt = [], []
    for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True):
        adaptation, ar = state.fixed.adaptation, state.swarm.learnt
        foretold.append(np.sum(coefficients_used(adaptation, ar) * ar.past, axis=1) - ar.past[:, 0])
        state = estimator.update(state, Reading(*row), rng)
        learnt.append(state.swarm.learnt.coefficients[1])
    steps = np.diff(log.truth[:, p.VY], prepend=0.0)
    figure = Figure(figsize=(13, 7), layout="constrained")
    figure.suptitle("The same drive: what mapf's autoregression of vy foretells", fontsize=11)
    axes = figure.subplots(3, 1, sharex=True)
    axes[0].plot(log.time, DEG * log.steer, "k", lw=1)
    axes[0].set_ylabel("road wheel [deg]")
    axes[1].plot(log.time, 1e3 * steps, "k", lw=1.5, label="true change of vy in a step")
    axes[1].plot(log.time, 1e3 * np.array(foretold)[:, 1], "C3", lw=0.7, label="foretold by the autoregression")
    axes[1].set_ylabel("[mm/s]")
    axes[2].plot(log.time, np.array(learnt), lw=1, label=[f"a{k + 1}" for k in range(len(learnt[0]))])
    axes[2].set_ylabel("coefficients of vy [-]")
    for ax in axes[1:]:
        ax.legend(loc="upper left", fontsize=8)
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)


def _finish(figure: Any, axes: Any, path: Path) -> None:
    axes[0, 0].legend(loc="best", fontsize=8, ncol=2)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
