"""A picture of one drive: where the car went, what it did, and what the controller believed of it."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from vse_gym.controllers.esc import StabilityControl
from vse_gym.controllers.reference import follow_reference
from vse_gym.metrics import sideslip_std
from vse_gym.physics import parameters as p
from vse_gym.picture_path import draw_path
from vse_gym.scenarios import Scenario
from vse_gym.types import SLOW, Y_ROLL_RATE, Log

WHEELS = ("front left", "front right", "rear left", "rear right")
TRUE, SEEN, WANTED = "black", "C1", "C0"


def reference_yaw_rate(log: Log, scenario: Scenario) -> np.ndarray:
    """What the stability control took the driver to want, from what it saw, (T,) [rad/s]."""
    reference = StabilityControl().reference(scenario.nominal)
    out, state = np.empty(len(log.time)), (0.0, 0.0)
    for k in range(len(log.time)):
        state = follow_reference(reference, *state, log.estimate[k, 0], log.estimate[k, 4], log.inputs[k, 0])
        out[k] = state[0]
    return out


def draw(log: Log, scenario: Scenario, title: str, path: str | Path) -> None:
    """Path, sideslip true and estimated with its 95 % band, yaw rate and reference, brakes, steering, readings, roll.

    Raises:
        ModuleNotFoundError: If matplotlib, of the extra [report], is not installed.
        ValueError: If the path's ending is no picture format.
    """
    from matplotlib.figure import Figure

    rows: Any = [["path", "path"], ["sideslip", "yaw"], ["brakes", "speed"], ["readings", "gyro"]]
    if rolls := bool(np.any(log.truth[:, p.ROLL])):
        rows.append(["roll", "swing"])
    figure = Figure(figsize=(13, 2 * len(rows) + 0.5), layout="constrained")
    figure.suptitle(title, fontsize=11)
    grid = figure.subplot_mosaic(rows, height_ratios=[1.2] + [1] * (len(rows) - 1))
    draw_path(grid["path"], log, scenario)
    _sideslip(grid["sideslip"], log)
    t, deg = log.time, 180 / math.pi
    axes = grid["yaw"]
    axes.plot(t, deg * log.truth[:, p.YAW_RATE], color=TRUE, label="true")
    axes.plot(t, deg * log.estimate[:, 2], color=SEEN, lw=1, label="estimated")
    axes.plot(t, deg * reference_yaw_rate(log, scenario), "--", color=WANTED, lw=1, label="reference")
    axes.set_ylabel("yaw rate [deg/s]")
    axes = grid["brakes"]
    for k, wheel in enumerate(WHEELS):
        axes.plot(t, log.brake[:, k], lw=1, label=wheel)
    axes.set_ylabel("brake torque [N m]")
    axes = grid["speed"]
    axes.plot(t, 3.6 * log.truth[:, p.VX], color=TRUE, label="true")
    axes.plot(t, 3.6 * log.estimate[:, 0], color=SEEN, lw=1, label="estimated")
    axes.set_ylabel("forward speed [km/h]")
    _readings(grid["readings"], t, log.readings[:, 1], log.truth[:, p.AY], "lateral acceleration [m/s²]")
    _readings(grid["gyro"], t, deg * log.readings[:, 2], deg * log.truth[:, p.YAW_RATE], "gyro [deg/s]")
    if rolls:
        grid["roll"].plot(t, deg * log.truth[:, p.ROLL], color=TRUE, label="true, positive leans right")
        grid["roll"].set_ylabel("roll [deg]")
        true, heard = deg * log.truth[:, p.ROLL_RATE], deg * log.readings[:, Y_ROLL_RATE]
        _readings(grid["swing"], t, heard, true, "roll rate [deg/s]")
    for name, axes in grid.items():
        axes.grid(alpha=0.3)
        if name == "path":  # beside the title, out of the way
            axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), ncols=7, frameon=False, borderaxespad=0.1)
        else:
            axes.legend(fontsize=8, loc="upper right")
            axes.set_xlim(0, scenario.manoeuvre.duration)
            axes.set_xlabel("time [s]", fontsize=8)
    figure.savefig(path, dpi=110)


def _sideslip(axes: Any, log: Log) -> None:
    deg = 180 / math.pi
    seen = np.arctan2(log.estimate[:, 1], log.estimate[:, 0])
    moving = np.hypot(log.truth[:, p.VX], log.truth[:, p.VY]) > SLOW  # a standing car has no sideslip
    seen = np.where(moving, seen, np.nan)
    band = 1.96 * sideslip_std(log.estimate, log.cov)
    axes.plot(log.time, deg * np.where(moving, log.sideslip, np.nan), color=TRUE, label="true")
    axes.plot(log.time, deg * seen, color=SEEN, lw=1, label="estimated")
    if np.isfinite(band).any():
        low, high = deg * (seen - band), deg * (seen + band)
        axes.fill_between(log.time, low, high, color=SEEN, alpha=0.25, lw=0, label="its 95 % band")
    axes.set_ylabel("sideslip [deg]")


def _readings(axes: Any, t: np.ndarray, heard: np.ndarray, true: np.ndarray, label: str) -> None:
    axes.plot(t, heard, ".", color="0.6", markersize=2, label="reading")
    axes.plot(t, true, color=TRUE, lw=1, label="true")
    axes.set_ylabel(label)
