"""System C under other noise: what the fuzzy R brings, and what noise in the regressor does to the mass."""

from functools import partial

import numpy as np
from papers_c_drive import LEAST_AY, PUBLISHED, SHEET, STEP_VARIANCES, TRUE_MASS, drive, largest, last_mass, told
from papers_common import Paper, over_seeds
from papers_statistics import Median, gain, spread

from vse_gym.physics import parameters as p
from vse_gym.report.text import Sheet
from vse_gym.types import Y_AY, Log

GROWTHS = (1.0, 10.0, 30.0, 100.0)


def fuzzy(paper: Paper) -> tuple[Sheet, dict[tuple[float, float], Median]]:
    """What adapting R changes, over Q and the growth of the noise; of the sideslip also by (Q, growth)."""
    lines, brought = [], {}
    rows = {f"{kind} {q}": told(q, **more) for q in STEP_VARIANCES for kind, more in (("U", {}), ("", {"adapted": ()}))}
    for growth in GROWTHS[1:]:
        made = paper.hear(partial(drive, growth=growth), rows, f"noise growing to {growth:g} sigma")
        for q in STEP_VARIANCES:
            changes = {w: gain(*(over_seeds(made, f"{kind} {q}", largest(w)) for kind in ("U", ""))) for w in PUBLISHED}
            brought[q, growth] = changes["sideslip"]
            size = spread(over_seeds(made, f" {q}", largest("sideslip")))
            lines.append([f"{q:g}", f"{growth:g}", *(change.text("+.1f") for change in changes.values()), size])
    order = sorted(range(len(lines)), key=lambda k: -float(lines[k][0]))
    heads = ["Q of a step", "sigma grows to, times", *PUBLISHED, "sideslip without it [deg]"]
    return Sheet(heads, [lines[k] for k in order]), brought


def noise(paper: Paper) -> Sheet:
    """The mass at the end over the growth of the noise, and what the noise in phi alone would make of it."""
    lines, filter_ = [], told()
    for growth in GROWTHS:
        made = paper.hear(partial(drive, growth=growth, linear=True), {"told": filter_}, "noise in phi")
        alone = [_mass_of_exact_forces(one.log, filter_.forgetting) for one in made]
        sigma = f"{growth * SHEET.acceleration:.2f}"
        lines.append([f"{growth:g}", sigma, spread(over_seeds(made, "told", last_mass), ".0f"), spread(alone, ".0f")])
    heads = [
        "sigma grows to, times",
        "sigma of ay in the end [m/s2]",
        "mass at the end [kg]",
        "if forces were exact [kg]",
    ]
    return Sheet(heads, lines)


def _mass_of_exact_forces(log: Log, forgetting: float) -> float:
    """Least squares with the true m ay on the left and the reading on the right: errors in variables alone [kg]."""
    heard = np.abs(log.readings[:, Y_AY]) >= LEAST_AY
    phi, age = log.readings[heard, Y_AY], np.arange(heard.sum())[::-1]
    weight = forgetting**age
    return float(TRUE_MASS * np.sum(weight * phi * log.truth[heard, p.AY]) / np.sum(weight * phi**2))
