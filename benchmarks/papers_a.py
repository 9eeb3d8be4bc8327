"""A: the model-adaptive particle filter of Qin, Li, Li, Cao (2014) on a slalom, beside its two comparisons."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from papers_a_figures import draw_errors, draw_states, draw_why
from papers_common import Claim, Heard, Outcome, Paper
from papers_cost import seconds_per_update
from papers_statistics import DEG, Median, median, motion_error, rms, sideslip_error, spread

from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import Gate
from vse_gym.manoeuvres.slalom import Slalom
from vse_gym.models import DoubleTrackTuning, Nominal, SingleTrackTuning
from vse_gym.physics import parameters as p
from vse_gym.replay import Trace
from vse_gym.report.text import Sheet
from vse_gym.scenarios import Scenario
from vse_gym.sensors import LOUD, Sensors
from vse_gym.types import Array, Log
from vse_gym.vehicles import load

TUNED = ("mapf", "mapf_physics", "pf", "pf_cauchy_gaussian", "strong_tracking", "ekf")
BUDGET = 40  # trials of each search
STATES = {"vx": "m/s", "vy": "m/s", "ax": "m/s²", "ay": "m/s²", "yaw rate": "deg/s", "sideslip": "deg"}
FIVE = ("vx", "vy", "ay", "yaw rate", "sideslip")
COLUMN = {"vx": 0, "vy": 1, "yaw rate": 2, "ax": 3, "ay": 4}
TOP = 0.9  # a peak is where a signal exceeds this share of the largest value of its half wave [-]
STRONG = 0.5  # of the half waves that reach this share of the drive's largest [-]
WITHOUT_SLIP, GAUSSIAN, SHEET = "single track", "Gaussian likelihood", "noise as on the data sheet"
MEASURED_ALIKE, GATED = "pf_cauchy_gaussian, double track", "strong_tracking, gate 0.9999"
PERIOD = 0.01  # between readings [s]
SLOWEST = 0.99  # share of a drive's updates that must be fast enough
NOTES = [
    "Speed, cones and noise are not printed: 50 km/h (within the real drives' 30 to 50), cones 18 m apart, 10 s; "
    "LOUD sensors with alpha 1.5, clipped at 20 m/s² and 100 deg/s.",
    "Car `qin2014` as published (it oversteers), the printed Fiala tyre, lateral load transfer lr/l : lf/l, friction "
    "1.0; estimators are told all of that, but their tyres: `mapf` has the printed one, the single track an axle's.",
    f"A peak is where |signal| exceeds {TOP:.0%} of the largest value of its half wave, of half waves that reach "
    f"{STRONG:.0%} of the drive's largest; vx and ax are taken about their mean.",
    "All six states: geometric mean over vx, vy, ax, ay, yaw rate and sideslip of the ratios of RMSE.",
    "One manoeuvre at one speed on one road: what holds here holds for that drive and its noise.",
]

Part = Callable[[Array], Any]  # which instants of a true signal (T,) count


def drive(seed: int) -> Scenario:
    """The slalom of one seed."""
    printed = load("qin2014")
    tyre = p.FialaTyre(printed.front_tyre.slip_stiffness, printed.front_tyre.cornering_stiffness, 0.070)
    car = printed._replace(front_transfer=printed.lr / printed.wheelbase, front_tyre=tyre, rear_tyre=tyre)
    sensors = Sensors(LOUD, alpha=1.5, acceleration_range=20.0, yaw_rate_range=np.radians(100))
    slalom = Slalom(speed=50 / 3.6, cones=7.0, friction=1.0, duration=10.0, side=1.0 if seed % 2 == 0 else -1.0)
    return Scenario(slalom, car, sensors, Nominal(car, sensors.sheet, slalom.speed, 1.0, PERIOD))


training_drive = drive


def signals(log: Log) -> dict[str, Array]:
    """The six true states."""
    at = {"vx": p.VX, "vy": p.VY, "ax": p.AX, "ay": p.AY, "yaw rate": p.YAW_RATE}
    found = {name: (DEG if name == "yaw rate" else 1.0) * log.truth[:, k] for name, k in at.items()}
    return found | {"sideslip": DEG * log.sideslip}


def errors(log: Log, trace: Trace) -> dict[str, Array]:
    """Of the six states, (T,) each."""
    found = {name: motion_error(log, trace, k) for name, k in COLUMN.items()}
    return found | {"sideslip": sideslip_error(log, trace)}


def everywhere(signal: Array) -> Any:
    """The whole drive."""
    return np.ones(signal.size, dtype=bool)


def peaks(signal: Array, about_mean: bool = False) -> Any:
    """Where a signal is at the top of a strong half wave, (T,)."""
    x = signal - signal.mean() if about_mean else signal
    out = np.zeros(x.size, dtype=bool)
    ends = np.flatnonzero(np.diff(np.sign(x))) + 1
    for half in np.split(np.arange(x.size), ends):
        highest = np.abs(x[half]).max()
        if highest >= STRONG * np.abs(x).max():
            out[half] = np.abs(x[half]) >= TOP * highest
    return out


def chosen(name: str, signal: Array, part: Part) -> Any:
    """Which instants of a state count."""
    return peaks(signal, name in ("vx", "ax")) if part is peaks else part(signal)


def table(log: Log, trace: Trace, part: Part) -> Array:
    """RMSE of the six states, (6,)."""
    true, wrong = signals(log), errors(log, trace)
    return np.array([rms(wrong[name][chosen(name, true[name], part)]) for name in STATES])


def loss(log: Log, trace: Trace) -> float:
    """What the search makes small: RMSE over the whole drive as a share of each state's own deviation, six states."""
    own = np.array([signal.std() for signal in signals(log).values()])
    return float(np.mean(table(log, trace, everywhere) / own))


def all_rmse(heard: Sequence[Heard], name: str, part: Part) -> Array:
    """RMSE of the six states at every seed, (S, 6)."""
    return np.array([table(h.log, h.traces[name], part) for h in heard])


def beats(heard: Sequence[Heard], name: str, other: str, part: Part, states: Sequence[str] = tuple(STATES)) -> Median:
    """Paired: by how many per cent the states' errors are smaller, geometric mean; negative is better."""
    at = [list(STATES).index(state) for state in states]
    ratio = np.log(all_rmse(heard, name, part) / all_rmse(heard, other, part))[:, at].mean(axis=1)
    return median(100 * np.expm1(ratio))


def variants(found: Mapping[str, Estimator]) -> dict[str, Estimator]:
    """What each part of the filter is worth: one setting changed at a time, from the tuning that was found."""
    mapf: Any = found["mapf"]
    pf: Any = found["pf_cauchy_gaussian"]
    changed = {f"order {k}": replace(mapf, order=k) for k in (1, 2, 5)}
    changed |= {f"UC {uc:g}": replace(mapf, coefficient=uc) for uc in (0.001, 0.03)}
    changed |= {
        "printed gain": replace(mapf, gain="printed"),
        "constant 0.627": replace(mapf, constant="printed"),
        GAUSSIAN: replace(mapf, alpha=2.0),
        SHEET: replace(mapf, smoothing=1e-9),
        "100 particles": replace(mapf, size=100),
        "2000 particles": replace(mapf, size=2000),
        WITHOUT_SLIP: replace(mapf, model=SingleTrackTuning(**vars(mapf.model))),
    }
    like = {name: getattr(pf.model, name) for name in DoubleTrackTuning.__dataclass_fields__}
    strong: Any = found["strong_tracking"]
    return changed | {
        MEASURED_ALIKE: replace(pf, model=DoubleTrackTuning(**like)),
        GATED: replace(strong, gate=Gate(passing=0.9999)),
    }


def run(paper: Paper) -> Outcome:
    """All of it."""
    found = paper.contenders(TUNED)
    heard = paper.hear(drive, found | variants(found), "slalom")
    along = [float(np.median(all_rmse(heard, name, peaks)[:, 2])) for name in ("mapf", WITHOUT_SLIP)]
    slip = [float(np.median(all_rmse(heard, name, peaks)[:, 5])) for name in ("mapf", WITHOUT_SLIP, "pf")]
    worth = {
        what: beats(heard, what, "mapf", peaks).text("+.0f") for what in ("order 1", "printed gain", GAUSSIAN, SHEET)
    }
    against_pf = (
        f"; ax comes out of measured wheel slips, {along[0]:.2f} m/s², from drive torques {along[1]:.2f}. Against "
        f"itself: {', '.join(f'{what} {change} %' for what, change in worth.items())}. Sideslip is read off ay by four "
        f"tyres, {slip[0]:.2f} deg; by two axles {slip[1]:.2f}, `pf` {slip[2]:.2f}"
    )
    against_strong = (
        f"; outliers are changes to strong tracking: behind a gate it is itself "
        f"{beats(heard, GATED, 'strong_tracking', peaks).text('+.0f')} % and `mapf` against that "
        f"{beats(heard, 'mapf', GATED, peaks).text('+.0f')} %"
    )
    more_accurate = "at the peaks MAPF is more accurate than the particle filter (ref. 12)"
    claims = [
        _claim(heard, "mapf", "pf", peaks, more_accurate, against_pf),
        _claim(heard, "mapf", "pf", peaks, "the same of five states, without ax", states=FIVE),
        _claim(heard, "mapf", "strong_tracking", peaks, "at the peaks: than strong tracking (ref. 11)", against_strong),
        _claim(heard, "mapf", "pf", everywhere, "over the drive: than the particle filter"),
        _claim(heard, "mapf", "strong_tracking", everywhere, "over the drive: than strong tracking"),
        _real_time(found["mapf"], heard),
        _claim(heard, "mapf_physics", "pf", peaks, "not in the paper: `mapf_physics` than the particle filter, peaks"),
        _claim(heard, "mapf", "pf_cauchy_gaussian", peaks, "not in the paper: than a heavy-tailed `pf`, peaks"),
    ]
    tables = {}
    for title, part in (("RMSE at the peaks", peaks), ("RMSE over the drive", everywhere)):
        rows = []
        for name in TUNED:
            values = all_rmse(heard, name, part)
            rows.append([name, *(spread(values[:, k]) for k in range(6))])
        tables[title] = Sheet(["estimator", *(f"{name} {unit}" for name, unit in STATES.items())], rows)
    tables["mapf at the peaks: paired differences of RMSE, %"] = _paired(heard)
    tables["What a part is worth: errors at the peaks against pf"] = _worth(heard, [*TUNED, *variants(found)])
    if paper.figures:
        draw_states(heard[0], paper.figures / "A_states.png")
        draw_errors(heard[0], paper.figures / "A_peak.png")
        draw_why(heard[0], found["mapf"], drive(paper.seeds[0]), paper.seeds[0], paper.figures / "A_why.png")
    return Outcome(claims, tables, NOTES)


def _claim(
    heard: Sequence[Heard],
    name: str,
    other: str,
    part: Part,
    what: str,
    more: str = "",
    states: Sequence[str] = tuple(STATES),
) -> Claim:
    found = beats(heard, name, other, part, states)
    ours, theirs = all_rmse(heard, name, part), all_rmse(heard, other, part)
    each = 100 * (np.median(ours / theirs, axis=0) - 1)
    why = ", ".join(f"{state} {value:+.0f} %" for state, value in zip(STATES, each, strict=True))
    return Claim("A", what, "-", found.text("+.0f", "% error"), found.judged(), why + more)


def _real_time(mapf: Estimator, heard: Sequence[Heard]) -> Claim:
    spent = 1e6 * seconds_per_update({"mapf": mapf}, [h.log for h in heard], drive(0).nominal, SLOWEST)["mapf"]
    most, usual = median(spent), np.median([1e6 * h.traces["mapf"].seconds for h in heard])
    why = (
        f"{SLOWEST:.0%} of a drive's updates take less: {most.middle / (1e6 * PERIOD):.1%} of the 10 ms between "
        f"readings, 500 particles; half of them {usual:.0f} us"
    )
    return Claim("A", "MAPF stays real-time", "-", most.text(".0f", "us"), most.judged(1e6 * PERIOD), why)


def _paired(heard: Sequence[Heard]) -> Sheet:
    rows = []
    for other in TUNED[1:]:
        change = 100 * (all_rmse(heard, "mapf", peaks) / all_rmse(heard, other, peaks) - 1)
        rows.append([f"against {other}", *(median(change[:, k]).text("+.0f") for k in range(6))])
    return Sheet(["mapf", *STATES], rows)


def _worth(heard: Sequence[Heard], names: Sequence[str]) -> Sheet:
    rows = []
    for name in names:
        slip = all_rmse(heard, name, peaks)[:, 5]
        six = beats(heard, name, "pf", peaks)
        rows.append([name, six.text("+.0f", "%"), spread(slip)])
    return Sheet(["", "six states", "sideslip deg"], rows)
