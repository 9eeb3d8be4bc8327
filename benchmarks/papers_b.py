"""CN110532590A (2019): an adaptive cubature particle filter on a car that rolls, beside the unscented one.

The patent's pages with the test are lost: car, manoeuvres, noise and numbers are chosen. Measured are ax, ay, roll rate
and yaw rate, as published; steering and wheel speeds are inputs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
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
from vse_gym.simulation import Scenario, scenario
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
TUNED = ("papers_b:ackf", "papers_b:upf", "papers_b:acpf")
BUDGET = 40  # trials of each search
UPF, ACPF, ACKF = "upf", "acpf", "ackf"
PUBLISHED, OF_UPF, OF_ACPF = ", as published", ", upf's tuning", ", acpf's tuning"
PLAIN = f"{ACPF} 100 without adaptation{OF_UPF}"
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
    lent = replace(found[ACPF], **{name: getattr(found[UPF], name) for name in SHARED})
    return out | {
        f"{UPF} 100{PUBLISHED}": upf,
        f"{ACPF} 100{PUBLISHED}": acpf,
        f"{ACPF} 100{OF_UPF}": lent,
        PLAIN: replace(lent, floor=1.0, cap=1.0),
        f"{UPF} 100{OF_ACPF}": replace(found[UPF], **{name: getattr(found[ACPF], name) for name in SHARED}),
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
    tables = {
        f"Root mean square error, median over {len(paper.seeds)} seeds [range of 90 %]": errors(heard),
        "An update's time, median over seeds [us]": costs(times),
        "Where an update of 100 particles spends it [us]": where(parts),
    }
    return Outcome([*accuracy(paper, heard), cheaper(paper, times, parts)], tables, notes())


def whole(heard: Mapping[str, Sequence[Heard]], name: str, what: str) -> Array:
    """An error's mean over the drives that a filter heard, at every seed, (S,) [deg]."""
    its = (here for here in heard.values() if name in here[0].traces)
    return np.mean([over_seeds(here, name, FIGURES[what]) for here in its], axis=0)


def accuracy(paper: Paper, heard: Mapping[str, Sequence[Heard]]) -> list[Claim]:
    """More accurate than the unscented particle filter, in roll angle and in sideslip."""
    claims = []
    for what in FIGURES:
        for size, like in (*((size, "") for size in ALL), *((100, like) for like in (PUBLISHED, OF_UPF, OF_ACPF))):
            mine, theirs = f"{ACPF} {size}{like}", f"{UPF} {size}{like}"
            mine, theirs = mine.replace(OF_ACPF, ""), theirs.replace(OF_UPF, "")
            here, other = whole(heard, mine, what), whole(heard, theirs, what)
            difference = gain(here, other)
            same = {k: h for k, h in heard.items() if mine in h[0].traces}
            single = whole(same, ACKF, what)
            alone = gain(here, single)
            text = f"{difference.text('+.1f', '%')}, {np.median(here):.3f} against {np.median(other):.3f} deg"
            claim = f"acpf more accurate than upf: {what}, {size} particles{like or ', each tuned'}"
            why = f"ackf alone {np.median(single):.3f} deg; acpf {alone.text('+.0f', '%')} to it"
            if like == OF_UPF:
                plain = gain(whole(heard, PLAIN, what), other)
                why = f"without adaptation {plain.text('+.1f', '%')} to upf; " + why
            claims.append(Claim(paper.system, claim, "-", text, difference.judged(), why))
    return claims


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
        "one tuning for all four drives, searched with 100 particles; 'as published' is each filter untuned, a "
        "particle's next step from all of its filter's covariance (carried = 1): where the search began, free to stay",
        "an accuracy claim takes each seed's mean over the four drives, of 50 and 200 particles over the lane changes; "
        "times are of one process, in turn",
    ]
