"""System C: mass by least squares and fuzzy measurement noise. Wang, Wei, Zhao, Zhang, Yan (2017).

doi:10.3969/j.issn.1004-132X.2017.06.019.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from papers_c_drive import (
    AMPLITUDE,
    BEGIN,
    CAR,
    FOUND_BY,
    GROWTH,
    LEAST_AY,
    MASS_OFF,
    PUBLISHED,
    SHEET,
    START,
    STEP_VARIANCES,
    TRUE_MASS,
    WithStiffness,
    drive,
    errors,
    largest,
    last_mass,
    mass_error,
    secant,
    told,
)
from papers_c_figures import draw_mass, draw_motion, draw_surface
from papers_c_noise import fuzzy, noise
from papers_common import Claim, Heard, Outcome, Paper, over_seeds
from papers_statistics import DEG, Median, gain, median, rms, spread

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.models.three_dof import CAR_SENSORS
from vse_gym.physics import parameters as p
from vse_gym.replay import Trace
from vse_gym.report.text import Sheet
from vse_gym.simulation import rollout
from vse_gym.types import Array, Log

TUNED = ("ekf_3dof", "rls_faekf")
BUDGET = 60  # trials of each search
EKF, OWN, TOLD = "ekf_3dof", "rls_faekf, its own sideslip", "rls_faekf, told the sideslip"
SECANT, EKF_SECANT = f"{TOLD} and the tyres' secant", "ekf_3dof, told the tyres' secant"
PLAIN, HEAVY = f"{TOLD}, R as it is", f"{OWN}, from 1900 kg"
EKF_WIDE, WIDE = "ekf_3dof with gyro and wheels", f"{OWN}, with gyro and wheels"

training_drive = drive


def loss(log: Log, trace: Trace) -> float:
    """RMS errors over the published largest ones of the RLS-FAEKF, mean of the three."""
    return float(np.mean([rms(e) / PUBLISHED[name][0] for name, e in errors(log, trace).items()]))


def contenders(paper: Paper, share: tuple[float, float]) -> dict[str, Estimator]:
    """Published settings, the parts of them that explain, and what else could be done."""
    searched = paper.contenders(TUNED)
    return {
        EKF: ESTIMATORS.make("ekf_3dof"),
        TOLD: told(),
        OWN: ESTIMATORS.make("rls_faekf", **BEGIN),
        HEAVY: ESTIMATORS.make("rls_faekf", mass_start=1900 / CAR.mass),
        PLAIN: told(adapted=()),
        EKF_SECANT: WithStiffness(ESTIMATORS.make("ekf_3dof"), share),
        SECANT: WithStiffness(told(), share),
        "ekf_3dof, searched tuning": searched["ekf_3dof"],
        f"{OWN}, searched tuning": replace(searched["rls_faekf"], **BEGIN),  # type: ignore[type-var]
        EKF_WIDE: ESTIMATORS.make("ekf_3dof", model=CAR_SENSORS),
        WIDE: ESTIMATORS.make("rls_faekf", model=CAR_SENSORS, **BEGIN),
    }


def run(paper: Paper) -> Outcome:
    """The slalom, heard by everybody; on linear tyres; and with other noise."""
    front, rear = secant(rollout(drive(0), "truth", "none", 0))
    rows = contenders(paper, (front, rear))
    few = {name: rows[name] for name in (EKF, OWN, TOLD)}
    made = paper.hear(drive, rows, "slalom")
    linear = paper.hear(partial(drive, linear=True), few, "slalom on linear tyres")
    sheet, brought = fuzzy(paper)
    tables = {
        "Largest errors, median over seeds [90 % of them]": _table(made, rows),
        "The same on linear tyres": _table(linear, few),
        f"{PLAIN}: what the fuzzy R changes of it, % of the largest errors [90 %]": sheet,
        f"{TOLD}, on linear tyres: noise in phi = ay makes the car seem light": noise(paper),
    }
    panels = {"the plant's tyres": made[0], "linear tyres": linear[0]}
    colours = {OWN: "tab:blue", TOLD: "tab:green", SECANT: "tab:red", WIDE: "tab:purple"}
    draw_mass(panels, colours, TRUE_MASS, MASS_OFF, paper.figures / "C_mass.png")
    colours = {EKF: "tab:orange", OWN: "tab:blue", TOLD: "tab:green", SECANT: "tab:red"}
    printed = {name: ours for name, (ours, _, _) in PUBLISHED.items()}
    draw_motion(made[0], colours, printed, paper.figures / "C_motion.png")
    draw_surface(paper.figures / "C_fuzzy_surface.png")
    return Outcome(_claims(made, linear, brought), tables, _notes(made, (front, rear)))


# -- tables -----------------------------------------------------------------------------------------------------------


def _table(made: Sequence[Heard], names: Any) -> Sheet:
    heads = ["", "mass from 9 s on, kg off", *(f"{name} [{unit}]" for name, (_, _, unit) in PUBLISHED.items())]
    lines = []
    for name in names:
        mass = "-" if name.startswith("ekf") else spread(over_seeds(made, name, mass_error))
        lines.append([name, mass, *(spread(over_seeds(made, name, largest(which))) for which in PUBLISHED)])
    return Sheet(heads, lines)


# -- claims -----------------------------------------------------------------------------------------------------------


def _claims(
    made: Sequence[Heard], linear: Sequence[Heard], brought: Mapping[tuple[float, float], Median]
) -> list[Claim]:
    claims = [_mass(made, name, what, why) for name, what, why in _readings(made, linear)]
    claims += [_against_ekf(made, linear, which) for which in PUBLISHED]
    return [*claims, _as_printed(made, linear), _fuzzy_claim(brought)]


def _mass(made: Sequence[Heard], name: str, what: str, why: str) -> Claim:
    found = median(over_seeds(made, name, mass_error))
    claim = f"{what}: mass found within {FOUND_BY:g} s, then at most {MASS_OFF:g} kg off"
    return Claim("C", claim, f"{MASS_OFF:g} kg", found.text(".3g", "kg"), found.judged(MASS_OFF), why)


def _readings(made: Sequence[Heard], linear: Sequence[Heard]) -> list[tuple[str, str, str]]:
    def ends(name: str, heard: Sequence[Heard] = made) -> str:
        return f"{np.median(over_seeds(heard, name, last_mass)):.0f}"

    return [
        (
            TOLD,
            "as published (least squares are told the true sideslip)",
            f"the plant's tyres give less force than the model's at these slips, which reads as mass: it ends at "
            f"{ends(TOLD)} kg, on linear tyres at {ends(TOLD, linear)}",
        ),
        (
            SECANT,
            "the same, the model's stiffnesses being the tyres' secant over the drive",
            f"it ends at {ends(SECANT)} kg: so read, the print is right",
        ),
        (
            OWN,
            "by the filter's own sideslip",
            f"with the published Q the filter takes the sideslip from ay by the very mass it believes: from {START:g} "
            f"kg it ends at {ends(OWN)}, from 1900 at {ends(HEAVY)}; with gyro, wheels and a small Q at {ends(WIDE)}",
        ),
    ]


def _against_ekf(made: Sequence[Heard], linear: Sequence[Heard], which: str) -> Claim:
    ours, theirs, unit = PUBLISHED[which]

    def change(name: str, other: str = EKF, heard: Sequence[Heard] = made) -> Median:
        return gain(*(over_seeds(heard, who, largest(which)) for who in (name, other)))

    better, sizes = change(TOLD), [np.median(over_seeds(made, who, largest(which))) for who in (TOLD, EKF)]
    others = {
        "both told the tyres' secant": change(SECANT, EKF_SECANT),
        "on linear tyres": change(TOLD, EKF, linear),
        "by its own sideslip": change(OWN),
        "both with gyro and wheels, own sideslip": change(WIDE, EKF_WIDE),
    }
    why = f"{sizes[0]:.2g} against {sizes[1]:.2g} {unit}; " + ", ".join(
        f"{what} {value.middle:+.0f} %" for what, value in others.items()
    )
    claim = f"as published: largest error of {which} less than the plain EKF's"
    return Claim("C", claim, f"{ours:g} against {theirs:g} {unit}", better.text("+.0f", "%"), better.judged(), why)


def _as_printed(made: Sequence[Heard], linear: Sequence[Heard]) -> Claim:
    """By how much the worst of the three largest errors exceeds what is printed."""

    def over(name: str, heard: Sequence[Heard]) -> Array:
        return np.array([over_seeds(heard, name, largest(w)) / PUBLISHED[w][0] for w in PUBLISHED])

    worst = median(over(TOLD, made).max(axis=0))
    said = {
        "as published": over(TOLD, made),
        "told the tyres' secant": over(SECANT, made),
        "on linear tyres": over(TOLD, linear),
        "by its own sideslip": over(OWN, made),
    }
    times = (f"{what} {' / '.join(f'{x:.2g}' for x in np.median(each, axis=1))}" for what, each in said.items())
    noise = DEG * GROWTH * SHEET.acceleration / _slope()
    why = f"{', '.join(times)} times the printed; ay's noise alone is worth a sigma of {noise:.2f} deg in the end"
    claim = "as published: largest errors of vx, sideslip and yaw rate no more than printed, the worst of three"
    printed = ", ".join(f"{ours:g} {unit}" for ours, _, unit in PUBLISHED.values())
    return Claim("C", claim, printed, worst.text(".3g", "times"), worst.judged(1.0), why)


def _fuzzy_claim(brought: Mapping[tuple[float, float], Median]) -> Claim:
    here = brought[STEP_VARIANCES[0], GROWTH]
    q, growth = min(brought, key=lambda at: brought[at].middle)
    why = (
        f"with Q = {STEP_VARIANCES[0]:g} the doubt about the sideslip drowns R whatever U says; most at Q = {q:g} and "
        f"{growth:g} times sigma: {brought[q, growth].text('+.0f', '%')}, see the table"
    )
    claim = (
        f"the fuzzy R makes the largest error of the sideslip smaller, with the published Q and {GROWTH:g} times sigma"
    )
    return Claim("C", claim, "-", here.text("+.1f", "%"), here.judged(), why)


def _slope() -> float:
    """How much ay there is to a sideslip angle, by the filter's model [m/s2 per rad]."""
    return 2 * (CAR.front_tyre.cornering_stiffness + CAR.rear_tyre.cornering_stiffness) / CAR.mass


def _notes(made: Sequence[Heard], share: tuple[float, float]) -> list[str]:
    log = made[0].log
    yaw = DEG * np.abs(log.truth[:, p.YAW_RATE]).max()
    beta = DEG * np.abs(log.sideslip).max()
    return [
        f"amplitude: {np.degrees(AMPLITUDE):.3g} deg of the front wheels, since the print has 10 without a unit: "
        f"the yaw rate peaks at {yaw:.1f} deg/s and the sideslip at {beta:.2f} deg, where the printed percentages "
        "imply 25-30 and 1.3-1.7; this car's table is lost, and no amplitude meets both",
        f"noise: variance of ay 0.001 at the start (the published R), then rising in proportion to time from 2 to 8 s "
        f"to {GROWTH**2:g} times that, which is as far as U reaches; ax and the gyro grow alike",
        "the published Q, R and Euler's step of 10 ms for everybody but the rows that say otherwise; forgetting 0.998, "
        "rule table, scaling of the fuzzy inputs and the window of 30 readings are chosen",
        f"with the published Q = 0.1 of a step, the doubt about the sideslip alone makes H P H^T at least "
        f"{0.1 * _slope() ** 2:.0f} (m/s2)^2, where R is 0.001 to 0.1: whatever U says, ay is believed all but wholly",
        "told the sideslip: the least squares take the true angle, as the paper's figures do; the filter does not",
        f"told the tyres' secant: the model's cornering stiffnesses are what the plant's axles give over the drive by "
        f"least squares of force over slip angle where |ay| is {LEAST_AY} m/s2 or more, {share[0]:.3f} (front) and "
        f"{share[1]:.3f} (rear) of the slope at zero; the print does not say which its own are",
        "searched tunings: the common search, loss the mean RMS error over the published largest ones; the mass "
        "started at the curb's there",
    ]
