"""Tables of the switching estimator's experiment: errors, what they come from, and how sure the result is."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from papers_common import Claim, Heard, Paper, over_seeds
from papers_d_drives import SPIKE, SPIKES, Drive, grip_used, with_biases, without_outliers
from papers_d_search import STARTS, alone, searches
from papers_statistics import DEG, Median, gain, median, rms, sideslip_error, spread

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.pretreatment import Pretreated
from vse_gym.inference.pretreatment import BESSEL
from vse_gym.replay import Trace
from vse_gym.report.text import Sheet
from vse_gym.types import Array, Log

DYNAMIC = "switching's dynamic scheme alone"
# The print does not say how stiff the axles of its model are. Of the car's own [-]
STIFFNESSES = (1.2, 1.1, 1.0, 0.9, 0.8, 0.7)


def loss(log: Log, trace: Trace) -> float:
    """What the search makes small: the sideslip's RMSE [deg]."""
    return rms(sideslip_error(log, trace))


def largest(log: Log, trace: Trace) -> float:
    """Largest error of the sideslip [deg]."""
    return float(np.max(np.abs(sideslip_error(log, trace))))


def mean(log: Log, trace: Trace) -> float:
    """Mean size of the sideslip's error [deg]."""
    return float(np.mean(np.abs(sideslip_error(log, trace))))


FIGURES: Mapping[str, Callable[[Log, Trace], float]] = {"max": largest, "mean": mean, "RMSE": loss}


def with_parts(made: Mapping[str, Estimator]) -> dict[str, Estimator]:
    """Everybody, and the dynamic scheme of the switching estimator."""
    return {**made, DYNAMIC: alone("switching", made["switching"])}


def told(made: Mapping[str, Any], stiffness: float = 1.0) -> dict[str, Estimator]:
    """Both, believing in axles of so much of their stiffness."""
    return {_at(name, stiffness): replace(made[name], stiffness=stiffness) for name in ("switching", "fusion")}


def as_told(heard: list[Heard], made: Mapping[str, Any]) -> str:
    """How the RMSE compare where both believe in the car's own axles, in words."""
    searched = " and ".join(f"{made[name].stiffness:.2f}" for name in ("switching", "fusion"))
    own = better(heard, (_at("switching", 1.0), _at("fusion", 1.0)))["RMSE"]
    return f"axles searched {searched} as stiff as they are; both told their own: {own.text('+.1f', '%')}"


def better(heard: list[Heard], names: tuple[str, str] = ("switching", "fusion")) -> dict[str, Median]:
    """By how many per cent the first is better than the second in each figure; negative is better."""
    return {f: gain(*(over_seeds(heard, name, figure) for name in names)) for f, figure in FIGURES.items()}


def judged(difference: Median) -> str:
    """As printed, with its verdict."""
    return f"{difference.text('+.1f')} {difference.judged()}"


def near_limit(log: Log) -> str:
    """How much of its grip the car uses on each part of the road, in per cent."""
    return " / ".join(f"{100 * share:.0f}" for share in grip_used(log).values())


def row_of_all(where: str, heard: list[Heard], printed: Mapping[str, float]) -> list[str]:
    """A drive's line in the table of all."""
    log, found = heard[0].log, better(heard)
    cells = [cell for f, by in printed.items() for cell in (f"-{by}", judged(found[f]))]
    return [where, near_limit(log), f"{DEG * np.max(np.abs(log.sideslip)):.2f}", *cells]


def sheet_of_all(lines: list[list[str]]) -> Sheet:
    """Switching against fusion in every drive and figure."""
    heads = [head for f in FIGURES for head in (f"{f}, printed [%]", f"{f} [%]")]
    return Sheet(["drive", "grip used [%]", "largest sideslip [deg]", *heads], lines)


def errors(heard: list[Heard], names: Mapping[str, Any]) -> Sheet:
    """Errors of everybody in a drive."""
    lines = [[name, *(spread(over_seeds(heard, name, f)) for f in FIGURES.values())] for name in names]
    return Sheet(["estimator", *(f"{figure} [deg]" for figure in FIGURES)], lines)


class Phases(NamedTuple):
    """The switching estimator scheme by scheme, medians over seeds."""

    dynamic: float  # its RMSE while dynamic [deg]
    kinematic: float  # and while kinematic [deg]
    instead: float  # RMSE of its dynamic scheme, were it on all the time, while the kinematic one is on [deg]
    switches: float  # in a drive
    share: float  # of the time that the kinematic scheme is on [-]

    @property
    def text(self) -> str:
        """As printed."""
        return (
            f"kinematic {100 * self.share:.0f} % of the time, {self.switches:.0f} switches: RMSE {self.kinematic:.3f} "
            f"deg there, where the dynamic scheme alone would have {self.instead:.3f}; {self.dynamic:.3f} while dynamic"
        )


def phases(heard: list[Heard]) -> Phases:
    """How good each scheme is while it is on."""
    out = []
    for h in heard:
        trace = h.traces["switching"]
        on, error = np.isnan(trace.nis), sideslip_error(h.log, trace)  # the integral has no innovation
        other = sideslip_error(h.log, h.traces[DYNAMIC])
        out.append((rms(error[~on]), rms(error[on]), rms(other[on]), np.sum(on[1:] != on[:-1]), np.mean(on)))
    return Phases(*np.median(out, axis=0).tolist())


def when(heard: list[Heard], name: str) -> str:
    """When an estimator's largest error is, median over seeds."""
    errors = [np.abs(sideslip_error(h.log, h.traces[name])) for h in heard]
    at = np.median([h.log.time[np.argmax(e)] for h, e in zip(heard, errors, strict=True)])
    outlier = any(abs(at - begin) < 5 * SPIKE for begin, _ in SPIKES)
    return f"{name}'s at {at:.1f} s{', an outlier of the gyro' if outlier else ''}"


def shrinks(where: str, on_low: Array, on_high: Array) -> Claim:
    """Less advantage on the better road: of what is an advantage on the worse.

    Args:
        where: Which drives.
        on_low, on_high: By how many per cent switching's RMSE is less than fusion's, (S,) each; negative is better.
    """
    low, high, less = median(on_low), median(on_high), median(on_low - on_high)
    claim, published = f"{where}: less advantage (RMSE) on mu 0.85 than on mu 0.35", "-19.8 points"
    why = f"mu 0.35: {low.text('+.1f', '%')}; mu 0.85: {high.text('+.1f', '%')}"
    if low.judged() != "holds":
        here = f"no advantage on mu 0.35: {low.text('+.1f', '%')}"
        return Claim("D", claim, published, here, low.judged(), why + "; there is none that could shrink")
    return Claim("D", claim, published, less.text("+.1f", "points"), less.judged(), why)


def variants(made: Mapping[str, Estimator], family: str) -> dict[str, Estimator]:
    """What the two results are made of."""
    switching: Any = made["switching"]
    fusion: Any = made["fusion"]
    both = replace(switching.treatment, filtered=("ay", "yaw_rate"))
    tested = replace(switching.treatment, filtered=())
    searched = {
        f"{name}: as a search {start.replace('_', ' ') or 'from the settings shipped'} leaves it": tuning.make()
        for name in ("switching", "fusion")
        for start, tuning in zip(("", *STARTS), searches(name, family), strict=True)
    }
    return {
        "switching": switching,
        "switching: its dynamic scheme alone": alone("switching", switching),
        "switching: its kinematic scheme alone": replace(switching, threshold=0.0),
        "switching: with hysteresis of 0.3 m/s2": replace(switching, hysteresis=0.3),
        "switching: with the gyro filtered as ay is": replace(switching, treatment=both),
        "switching: hearing the tested gyro in both schemes": Pretreated(switching, tested),
        "switching: with the Bessel filter": replace(switching, treatment=replace(switching.treatment, damping=BESSEL)),
        "switching: with the settings as shipped": ESTIMATORS.make("switching"),
        "fusion": fusion,
        "fusion: its adaptive dynamic scheme alone": alone("fusion", fusion),
        "fusion: without adaptation": replace(fusion, adaptation=replace(fusion.adaptation, floor=1.0, cap=1.0)),
        "fusion: with the settings as shipped": ESTIMATORS.make("fusion"),
        **searched,
    }


def sensitivity(paper: Paper, where: str, drive: Drive, made: Mapping[str, Estimator]) -> list[list[str]]:
    """Lines of a drive: axles believed too stiff or too soft, sensors without outliers or with biases."""
    pair: dict[str, Any] = {name: made[name] for name in ("switching", "fusion")}
    pair[DYNAMIC] = alone("switching", pair["switching"])
    stiff = {_at(n, k): replace(e, stiffness=k) for k in STIFFNESSES for n, e in pair.items()}
    heard = paper.hear(drive, stiff, f"{where}, stiffness")
    lines = [
        _line(where, f"axles believed {100 * k:.0f} % as stiff as they are", heard, [_at(n, k) for n in pair])
        for k in STIFFNESSES
    ]
    for what, other in (("without the gyro's outliers", without_outliers), ("with the sensors' biases", with_biases)):
        lines.append(_line(where, what, paper.hear(other(drive), pair, f"{where}, {what}"), list(pair)))
    return lines


SENSITIVITY = ["drive", "otherwise", "switching RMSE [deg]", "fusion RMSE [deg]", "dynamic scheme alone RMSE [deg]"]
SENSITIVITY += [f"{f}, switching against fusion [%]" for f in FIGURES]


def _at(name: str, stiffness: float) -> str:
    return f"{name}, stiffness {stiffness:g}"


def _line(where: str, what: str, heard: list[Heard], names: list[str]) -> list[str]:
    found = better(heard, (names[0], names[1]))
    figures = [spread(over_seeds(heard, name, loss)) for name in names]
    return [where, what, *figures, *(judged(f) for f in found.values())]
