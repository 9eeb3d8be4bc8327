"""CN110532590A (2019): an adaptive cubature particle filter on a car that rolls, beside the unscented one.

The patent's pages with the test are lost: car, manoeuvres, noise and numbers are chosen. Measured are ax, ay, roll rate
and yaw rate, as published; steering and wheel speeds are inputs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from papers_b_cost import ROWS, stages
from papers_b_figures import draw
from papers_common import Claim, Heard, Outcome, Paper, over_seeds
from papers_cost import seconds_per_update
from papers_statistics import DEG, gain, rms, sideslip_error, spread

from vse_gym.estimators.adaptive_cubature import AdaptiveCubatureKalmanFilter
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.sigma_particle import AdaptiveCubatureParticleFilter, UnscentedParticleFilter
from vse_gym.manoeuvres.base import KMH
from vse_gym.models import RollTrackTuning
from vse_gym.physics import parameters as p
from vse_gym.replay import Trace
from vse_gym.report.text import Sheet
from vse_gym.scenarios import Scenario, scenario
from vse_gym.types import FOUND, Array, Log

CAR, FRICTION, SPEED = "wei2019_roll", 0.85, 80 * KMH
NOISES = {"Gaussian": "loud+roll_rate", "Cauchy-Gaussian": "cauchy_gaussian+roll_rate"}
SINE: dict[str, float] = {"amplitude": 40 / DEG, "period": 2.0, "begin": 1.0, "stop": 7.0}
TESTS: dict[str, dict[str, float]] = {"double_lane_change": {}, "sine_steer": SINE}
SIZES = {"lane change": (50, 100, 200), "sine steer": (100,)}  # particles in each drive
ALL = SIZES["lane change"]
ROLL = FOUND.index("roll")

# The filters as the patent has them measure: wheel speeds are inputs, no readings
MEASURED = RollTrackTuning(speedometer=False)
ackf = AdaptiveCubatureKalmanFilter(model=MEASURED)
upf = UnscentedParticleFilter(model=MEASURED)
acpf = AdaptiveCubatureParticleFilter(model=MEASURED)


@dataclass(frozen=True)
class CarryingUnscented(UnscentedParticleFilter):
    """All of a particle's covariance is carried on, as published: not searched."""

    carried: float = 1.0


@dataclass(frozen=True)
class CarryingAdaptiveCubature(AdaptiveCubatureParticleFilter):
    """The same."""

    carried: float = 1.0


upf_carrying = CarryingUnscented(model=MEASURED)
acpf_carrying = CarryingAdaptiveCubature(model=MEASURED)
TUNED = ("papers_b:ackf", "papers_b:upf", "papers_b:acpf", "papers_b:upf_carrying", "papers_b:acpf_carrying")
BUDGET = 40  # trials of each search
UPF, ACPF, ACKF = "upf", "acpf", "ackf"
PUBLISHED, CARRYING, CERTAIN = ", as published", ", as published, tuned", ", tuned, carried 0"
OF_UPF, OF_ACPF = ", upf's tuning", ", acpf's tuning"
PLAIN = f"{ACPF} 100 without adaptation{OF_UPF}"
# Who is compared with whom, upf first
PAIRS = {
    "100 particles, as published (carried = 1), untuned": (f"{UPF} 100{PUBLISHED}", f"{ACPF} 100{PUBLISHED}"),
    "100 particles, as published (carried = 1), each tuned": (f"{UPF} 100{CARRYING}", f"{ACPF} 100{CARRYING}"),
    "100 particles, each tuned, carried included": (f"{UPF} 100", f"{ACPF} 100"),
}
MORE = {
    "the same, but carried = 0": (f"{UPF} 100{CERTAIN}", f"{ACPF} 100{CERTAIN}"),
    "both with upf's tuning": (f"{UPF} 100", f"{ACPF} 100{OF_UPF}"),
    "both with upf's tuning, acpf without adaptation": (f"{UPF} 100", PLAIN),
    "both with acpf's tuning": (f"{UPF} 100{OF_ACPF}", f"{ACPF} 100"),
    "50 particles, each tuned, lane changes alone": (f"{UPF} 50", f"{ACPF} 50"),
    "200 particles, each tuned, lane changes alone": (f"{UPF} 200", f"{ACPF} 200"),
}
SHARED = ("model", "widening", "carried")  # settings that both particle filters have and that are tuned


def drive(test: str, noise: str) -> Scenario:
    """The friction is told, as the car is."""
    made = scenario(test, CAR, NOISES[noise], speed=SPEED, friction=FRICTION, **TESTS[test])
    return replace(made, nominal=replace(made.nominal, friction=FRICTION))


def lane_gaussian(seed: int) -> Scenario:
    """A double lane change, Gaussian noise."""
    return drive("double_lane_change", "Gaussian")


def lane_heavy(seed: int) -> Scenario:
    """The same, heavy-tailed noise."""
    return drive("double_lane_change", "Cauchy-Gaussian")


def sine_gaussian(seed: int) -> Scenario:
    """A sine of the hand wheel, Gaussian noise."""
    return drive("sine_steer", "Gaussian")


def sine_heavy(seed: int) -> Scenario:
    """The same, heavy-tailed noise."""
    return drive("sine_steer", "Cauchy-Gaussian")


DRIVES = {
    "lane change, Gaussian": lane_gaussian,
    "lane change, Cauchy-Gaussian": lane_heavy,
    "sine steer, Gaussian": sine_gaussian,
    "sine steer, Cauchy-Gaussian": sine_heavy,
}


def training_drive(seed: int) -> Scenario:
    """Each of the four in turn: one tuning for all."""
    return list(DRIVES.values())[seed % 4](seed)


def roll_error(log: Log, trace: Trace) -> Array:
    """Estimated minus true roll angle, (T,) [deg]."""
    return DEG * (trace.found[:, ROLL] - log.truth[:, p.ROLL])


def roll(log: Log, trace: Trace) -> float:
    """RMSE of the roll angle [deg]."""
    return rms(roll_error(log, trace))


def sideslip(log: Log, trace: Trace) -> float:
    """RMSE of the sideslip angle [deg]."""
    return rms(sideslip_error(log, trace))


def loss(log: Log, trace: Trace) -> float:
    """What the search makes small: both, in degrees."""
    return roll(log, trace) + sideslip(log, trace)


FIGURES = {"roll angle": roll, "sideslip": sideslip}


def contenders(paper: Paper, sizes: Iterable[int]) -> dict[str, Estimator]:
    """Tuned, at numbers of particles; with 100 also as published, and each with what was found for the other."""
    found: Mapping[str, Any] = {name.partition(":")[2]: e for name, e in paper.contenders(TUNED).items()}
    out: dict[str, Estimator] = {ACKF: found[ACKF]}
    for size in sizes:
        out |= {f"{name} {size}": replace(found[name], size=size) for name in (UPF, ACPF)}
    of_upf, of_acpf = ({setting: getattr(found[name], setting) for setting in SHARED} for name in (UPF, ACPF))
    lent = replace(found[ACPF], **of_upf)
    return out | {
        f"{UPF} 100{PUBLISHED}": upf,
        f"{ACPF} 100{PUBLISHED}": acpf,
        f"{UPF} 100{CARRYING}": found["upf_carrying"],
        f"{ACPF} 100{CARRYING}": found["acpf_carrying"],
        f"{UPF} 100{CERTAIN}": replace(found[UPF], carried=0.0),
        f"{ACPF} 100{CERTAIN}": replace(found[ACPF], carried=0.0),
        f"{ACPF} 100{OF_UPF}": lent,
        PLAIN: replace(lent, floor=1.0, cap=1.0),
        f"{UPF} 100{OF_ACPF}": replace(found[UPF], **of_acpf),
    }


def run(paper: Paper) -> Outcome:
    """Every drive, heard by all; then what an update costs, in one process."""
    filters = contenders(paper, ALL)
    heard = {}
    for what, make in DRIVES.items():
        heard[what] = paper.hear(make, contenders(paper, SIZES[what.partition(",")[0]]), what)
    for what, here in heard.items():
        draw(paper.figures, what, here[0], {"upf 100": "C0", "acpf 100": "C1", ACKF: "C2"}, roll_error)
    logs = [h.log for h in heard["lane change, Gaussian"]]
    told = lane_gaussian(0).nominal
    short = [log._replace(time=log.time[:ROWS]) for log in logs]
    times = {n: seconds_per_update({k: filters[f"{k} {n}"] for k in (UPF, ACPF)}, short, told) for n in ALL}
    parts = {name: stages(filters[f"{name} 100"], logs[0], told) for name in (UPF, ACPF)}
    claims, compared = accuracy(paper, heard, filters)
    tables = {
        "acpf against upf, mean over the drives, median over seeds": compared,
        f"Root mean square error, median over {len(paper.seeds)} seeds [range of 90 %]": errors(heard),
        "An update's time, median over seeds [us]": costs(times),
        "Where an update of 100 particles spends it [us]": where(parts),
    }
    return Outcome([*claims, cheaper(paper, times, parts)], tables, notes())


def whole(heard: Mapping[str, Sequence[Heard]], name: str, what: str) -> Array:
    """An error's mean over the drives that a filter heard, at every seed, (S,) [deg]."""
    its = (here for here in heard.values() if name in here[0].traces)
    return np.mean([over_seeds(here, name, FIGURES[what]) for here in its], axis=0)


def effective(heard: Mapping[str, Sequence[Heard]], name: str) -> float:
    """How many particles count: the median over the readings of all drives and seeds."""
    its = (h.traces[name].effective_size for here in heard.values() for h in here if name in h.traces)
    return float(np.nanmedian(np.concatenate(list(its))))


def carried(filters: Mapping[str, Any], names: Iterable[str]) -> str:
    """How much of its covariance a particle's next step starts from."""
    return " / ".join(dict.fromkeys(f"{filters[name].carried:.2g}" for name in names))


def accuracy(
    paper: Paper, heard: Mapping[str, Sequence[Heard]], filters: Mapping[str, Any]
) -> tuple[list[Claim], Sheet]:
    """More accurate than the unscented particle filter, in roll angle and in sideslip; and all comparisons."""
    claims, rows = [], []
    for which, names in (PAIRS | MORE).items():
        row = [which, carried(filters, names), " / ".join(f"{effective(heard, name):.1f}" for name in names)]
        for what in FIGURES:
            other, here = (whole(heard, name, what) for name in names)
            difference = gain(here, other)
            row += [f"{np.median(other):.3f} / {np.median(here):.3f}"]
            row += [f"{difference.text('+.1f')} {difference.judged()}"]
            if which not in PAIRS:
                continue
            single = whole(heard, ACKF, what)
            text = f"{difference.text('+.1f', '%')}, {np.median(here):.3f} against {np.median(other):.3f} deg"
            why = f"effective sample size (upf / acpf) {row[2]}, carried {row[1]}; ackf alone, tuned, "
            why += f"{np.median(single):.3f} deg, acpf {gain(here, single).text('+.0f', '%')} to it"
            claim = f"acpf more accurate than upf: {what}, {which}"
            claims.append(Claim(paper.system, claim, "-", text, difference.judged(), why))
        rows.append(row)
    heads = ["which", "carried", "effective sample size"]
    heads += [head for what in FIGURES for head in (f"{what} [deg]", f"{what}, acpf to upf [%]")]
    claims.sort(key=lambda claim: [what in claim.claim for what in FIGURES].index(True))
    return claims, Sheet([heads[0], *(f"{head}, upf / acpf" if "%" not in head else head for head in heads[1:])], rows)


def cheaper(paper: Paper, times: Mapping[int, Mapping[str, Array]], parts: Mapping[str, Mapping[str, float]]) -> Claim:
    """Cheaper per step than the unscented particle filter at the same number of particles."""
    gains = {size: gain(here[ACPF], here[UPF]) for size, here in times.items()}
    verdicts = {g.judged() for g in gains.values()}
    text = "; ".join(f"{size}: {g.text('+.1f', '%')}" for size, g in gains.items())
    mine, other = parts[ACPF], parts[UPF]
    saved = {stage: other[stage] - mine[stage] for stage in mine}
    most = sorted(saved, key=lambda stage: -abs(saved[stage]))[:3]
    why = "10 points against 11, but the cubature rule has none in the middle, which p(x|x_old) needs: "
    why += "22 model calls a particle against 23. Saved at 100 particles [us]: "
    why += ", ".join(f"{stage} {saved[stage]:+.0f}" for stage in most)
    verdict = verdicts.pop() if len(verdicts) == 1 else "open"
    claim = "acpf cheaper per step than upf at the same number of particles"
    return Claim(paper.system, claim, "-", text, verdict, why)


def errors(heard: Mapping[str, Sequence[Heard]]) -> Sheet:
    """Every filter's errors in every drive, and how many particles count."""
    rows = []
    for what, here in heard.items():
        for name in here[0].traces:
            figures = [spread(over_seeds(here, name, figure), ".3f") for figure in FIGURES.values()]
            size = np.median([np.nanmedian(h.traces[name].effective_size) for h in here]) if " " in name else np.nan
            rows.append([what, name, *figures, "-" if np.isnan(size) else f"{size:.1f}"])
    return Sheet(["drive", "filter", *(f"{what} [deg]" for what in FIGURES), "effective particles"], rows)


def costs(times: Mapping[int, Mapping[str, Array]]) -> Sheet:
    """What an update takes."""
    rows = []
    for size, here in times.items():
        mine, other = 1e6 * here[ACPF], 1e6 * here[UPF]
        rows.append([str(size), spread(other, ".0f"), spread(mine, ".0f"), gain(mine, other).text("+.1f", "%")])
    return Sheet(["particles", UPF, ACPF, "acpf to upf, paired"], rows)


def where(parts: Mapping[str, Mapping[str, float]]) -> Sheet:
    """The stages of an update."""
    stages_ = parts[UPF]
    rows = [[stage, f"{stages_[stage]:.1f}", f"{parts[ACPF][stage]:.1f}"] for stage in stages_]
    return Sheet(["stage", UPF, ACPF], rows)


def notes() -> list[str]:
    """What was chosen."""
    return [
        "all of the test: its pages are lost",
        "car: wei2019_roll, a typical mid-size car, on unsteady tyres (0.15 and 0.45 m)",
        "80 km/h, friction 0.85, both told: ISO 3888-1 double lane change; three periods of 2 s, 40 deg of hand wheel",
        "sensors: the loud suite and a roll gyro; the same noise as a Cauchy-Gaussian mixture of alpha 1.3",
        "z = [ax, ay, p, r]; wheel speeds are inputs; both particle filters weigh by the mixture of alpha 1.5",
        "one tuning for all four drives, searched with 100 particles. As published a particle's next step starts from "
        "all of its filter's covariance (carried = 1); that is compared untuned and, with everything else searched, "
        "tuned. Where carried was searched too, both searches end near 0, where a particle is certain of where it is: "
        "that is no longer the published filter",
        "a comparison takes each seed's mean over the four drives, of 50 and 200 particles over the lane changes; "
        "times are of one process, in turn",
    ]
