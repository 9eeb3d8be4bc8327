"""Chen, Wu, Ge, Zhao (2024): a switching estimator for the sideslip angle, beside one that fuses the same schemes."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from papers_common import Claim, Heard, Outcome, Paper, gain, median, over_seeds, rms, sideslip_error, spread
from papers_d_cost import seconds_inside, seconds_per_update
from papers_d_figures import draw

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.pretreatment import Pretreated
from vse_gym.manoeuvres.base import DEG, Criterion, Manoeuvre, Verdict
from vse_gym.manoeuvres.driver import Pedals, pedals
from vse_gym.manoeuvres.triple_lane_change import TripleLaneChange
from vse_gym.models import Nominal
from vse_gym.replay import Trace
from vse_gym.report.text import Sheet
from vse_gym.sensing import NoiseRecord
from vse_gym.sensors import LOUD, Sensors
from vse_gym.simulation import Scenario, scenario
from vse_gym.types import Y_YAW_RATE, Array, Car, Driver, Log

CAR = "chen2024_c_class"
TUNED = ("switching", "fusion", "kf", "ekf", "kinematic")
SPIKES = ((2.0, 0.47), (7.0, 0.84))  # when, and how high the gyro's outliers reach (published) [s], [rad/s]
SPIKE = 0.03  # how long each is (chosen) [s]


@dataclass(frozen=True)
class Published(Sensors):
    """The paper's inertial sensors, which are this project's loud ones, and the two outliers of its gyro."""

    def record(self, steps: int, dt: float, seed: int) -> NoiseRecord:
        """As of any sensors, with the outliers."""
        noise = super().record(steps, dt, seed)
        added = noise.added.copy()
        for when, height in SPIKES:
            added[round(when / dt) : round((when + SPIKE) / dt), Y_YAW_RATE] = height
        return noise._replace(added=added)


SENSORS = Published(LOUD)
BIASED = replace(SENSORS, acceleration_bias=0.5, yaw_rate_bias=0.1 * DEG)  # as they are before calibration


@dataclass(frozen=True)
class AcceleratingSine(Manoeuvre):
    """Fixed throttle from 12.5 m/s, the hand wheel a sine whose amplitude changes: the paper's drives on a test rig.

    Speed, frictions and when the amplitude changes are published, the rest is chosen: so that the car nears its limit
    at the end, where it is at 80 to 90 % of what the road gives.
    """

    speed: float = 12.5
    acceleration: float = 0.25  # that the throttle gives on a level road [m/s2]
    amplitude: float = 20 * DEG  # of the hand wheel [rad]
    period: float = 4.0  # [s]
    weak: float = 1.0  # amplitude between 7 and 18 s over the one before [-]
    grown: float = 1.0  # amplitude at the end over the one before, growing from 30 s on [-]

    def init(self, nominal: Nominal) -> Pedals:
        return pedals(nominal.vehicle, nominal.dt)._replace(pressed=self.acceleration)

    def drive(self, state: Pedals, time: float, car: Car) -> tuple[Driver, Pedals]:
        share = self.weak if 7.0 <= time < 18.0 else 1.0
        if time > 30.0:
            share = 1.0 + (self.grown - 1.0) * (time - 30.0) / (self.duration - 30.0)
        angle = share * self.amplitude * math.sin(2 * math.pi * time / self.period)
        return Driver(angle, state.torque), state

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        """The paper has none; sideslip is reported."""
        return Verdict((Criterion("largest sideslip", log.peak_sideslip / DEG, 15.0, "deg"),))


LANES = TripleLaneChange()
LOW = AcceleratingSine(friction=0.35, duration=30.0, weak=0.3)
HIGH = AcceleratingSine(friction=0.85, duration=40.0, acceleration=0.3, amplitude=30 * DEG, grown=1.25)


def lane_changes(seed: int) -> Scenario:
    """Three double lane changes on a road that gets slippery."""
    return scenario(LANES, CAR, SENSORS)


def spared(seed: int) -> Scenario:
    """The same without outliers."""
    return scenario(LANES, CAR, Sensors(LOUD))


def biased(seed: int) -> Scenario:
    """The same with the sensors' biases left in."""
    return scenario(LANES, CAR, BIASED)


def low(seed: int) -> Scenario:
    """Accelerating on friction 0.35."""
    return scenario(LOW, CAR, SENSORS)


def high(seed: int) -> Scenario:
    """Accelerating on friction 0.85."""
    return scenario(HIGH, CAR, SENSORS)


training_drive = lane_changes


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

# What the paper prints: by how many per cent switching is better than fusion
PRINTED = {
    "lane changes": (lane_changes, {"max": 40.7, "mean": 22.4, "RMSE": 30.6}),
    "accelerating, mu 0.35": (low, {"max": 26.6, "mean": 33.0, "RMSE": 31.5}),
    "accelerating, mu 0.85": (high, {"max": 9.9, "mean": 16.1, "RMSE": 11.7}),
}
CHEAPER = 24.4  # per cent of run time


def variants(tuned: Mapping[str, Estimator]) -> dict[str, Estimator]:
    """What the two results are made of."""
    switching: Any = tuned["switching"]
    fusion: Any = tuned["fusion"]
    both = replace(switching.treatment, filtered=("ay", "yaw_rate"))
    return {
        "switching": switching,
        "its dynamic scheme alone": replace(switching, threshold=math.inf),
        "its kinematic scheme alone": replace(switching, threshold=0.0),
        "with hysteresis of 0.3 m/s2": replace(switching, hysteresis=0.3),
        "with the gyro filtered as ay is": replace(switching, treatment=both),
        "hearing the tested gyro in both schemes": Pretreated(switching, replace(switching.treatment, filtered=())),
        "with the settings as shipped": ESTIMATORS.make("switching"),
        "fusion": fusion,
        "its adaptive dynamic scheme alone": replace(fusion, gain=math.inf),
        "without adaptation": replace(fusion, adaptation=replace(fusion.adaptation, floor=1.0, cap=1.0)),
        "fusion with the settings as shipped": ESTIMATORS.make("fusion"),
    }


def rows(heard: list[Heard], names: Mapping[str, Any]) -> Sheet:
    """Errors of everybody in a drive."""
    table = [[name, *(spread(over_seeds(heard, name, f)) for f in FIGURES.values())] for name in names]
    return Sheet(["estimator", *(f"{figure} [deg]" for figure in FIGURES)], table)


def by_scheme(heard: list[Heard]) -> tuple[Array, Array, Array]:
    """RMSE of the switching estimator while each scheme is on [deg], and how often it switches in a drive, (S,) each."""
    out = []
    for h in heard:
        trace = h.traces["switching"]
        kinematic, error = np.isnan(trace.nis), sideslip_error(h.log, trace)
        out.append((rms(error[~kinematic]), rms(error[kinematic]), int(np.sum(kinematic[1:] != kinematic[:-1]))))
    dynamic, integral, switches = np.array(out).T
    return dynamic, integral, switches


def at_peaks(heard: list[Heard], name: str) -> Array:
    """When each seed's largest error is, (S,) [s]."""
    return np.array([h.log.time[np.argmax(np.abs(sideslip_error(h.log, h.traces[name])))] for h in heard])


def run(paper: Paper) -> Outcome:
    """Three drives, the cost of an update, and what the result comes from."""
    tuned = paper.contenders(TUNED)
    claims: list[Claim] = []
    tables: dict[str, Sheet] = {}
    advantage: dict[str, Array] = {}
    for where, (drive, printed) in PRINTED.items():
        heard = paper.hear(drive, tuned, where)
        tables[f"Sideslip error, {where}"] = rows(heard, tuned)
        dynamic, integral, switches = by_scheme(heard)
        why = (
            f"its RMSE is {np.median(dynamic):.3f} deg while dynamic, {np.median(integral):.3f} while kinematic, after "
            f"{np.median(switches):.0f} switches; fusion's {np.median(over_seeds(heard, 'fusion', loss)):.3f}; its "
            f"largest error at {np.median(at_peaks(heard, 'switching')):.1f} s, "
            f"fusion's at {np.median(at_peaks(heard, 'fusion')):.1f} s"
        )
        for figure, by in printed.items():
            mine, theirs = (over_seeds(heard, name, FIGURES[figure]) for name in ("switching", "fusion"))
            better = gain(mine, theirs)
            claim = f"{where}: switching's {figure} error of sideslip is below fusion's"
            claims.append(Claim("D", claim, f"-{by} %", better.text("+.1f", "%"), better.judged(), why))
        advantage[where] = 100 * (over_seeds(heard, "switching", loss) / over_seeds(heard, "fusion", loss) - 1)
        draw(heard[0], f"Chen et al. (2024): {where}, seed {paper.seeds[0]}", paper.figures / f"D_{drive.__name__}.png")
        if drive is lane_changes:
            cost_log = heard[0].log
    shrinks = median(advantage["accelerating, mu 0.35"] - advantage["accelerating, mu 0.85"])
    claims.append(
        Claim("D", "the advantage in RMSE is smaller on mu 0.85 than on 0.35", "-31.5 %, -11.7 %",
              shrinks.text("+.1f", "points"), shrinks.judged(), "difference of the two gains above, paired by seed")
    )  # fmt: skip
    claims.append(_cost(tuned, cost_log, lane_changes(0).nominal, tables))
    made = variants(tuned)
    tables["What the lane changes' errors come from"] = rows(paper.hear(lane_changes, made, "variants"), made)
    tables["Lane changes without the gyro's two outliers"] = rows(paper.hear(spared, tuned, "no outliers"), tuned)
    tables["Lane changes with the sensors' biases left in"] = rows(paper.hear(biased, tuned, "biases"), tuned)
    return Outcome(claims, tables, NOTES)


def _cost(tuned: Mapping[str, Estimator], log: Log, nominal: Nominal, tables: dict[str, Sheet]) -> Claim:
    pair = {name: tuned[name] for name in ("switching", "fusion")}
    outside = seconds_per_update({**pair, "kf": tuned["kf"], "ekf": tuned["ekf"]}, log, nominal)
    inside = seconds_inside(pair["switching"], pair["fusion"], log, nominal)
    names = [
        [name, spread(1e6 * outside[name]), spread(1e6 * inside[name]) if name in inside else "-"] for name in outside
    ]
    tables["Time of an update"] = Sheet(["estimator", "from Python [us]", "inside compiled code [us]"], names)
    less, core = gain(outside["switching"], outside["fusion"]), gain(inside["switching"], inside["fusion"])
    why = f"{core.text('+.1f', '%')} inside compiled code; fusion runs both schemes, and adapts"
    return Claim(
        "D", "switching takes less time than fusion", f"-{CHEAPER} %", less.text("+.1f", "%"), less.judged(), why
    )


NOTES = [
    "The car's track, height and tyres are chosen; the print has mass, inertia, axle distances and radius.",
    "A lane change takes 95 m, since ISO 3888-1's 30 m would need 27 m/s2 at 120 km/h; the true car's driver follows the "
    "line, and the friction changes at 9 and 18 s of way at the start speed.",
    f"Outliers of the gyro last {SPIKE} s. Biases are off (calibrated out beforehand) but for the last table. Wheel speeds "
    "have 0.1 rad/s of noise, the steering angle 0.02 deg.",
    "Accelerating drives: throttle for 0.25 (mu 0.35) and 0.3 m/s2 (mu 0.85), a hand-wheel sine of 4 s and 20 or 30 deg; on "
    "mu 0.35 30 % of it during 7-18 s; on mu 0.85 a quarter more from 30 to 40 s.",
    "The low-pass is the printed transfer function, bilinear; its output and the gyro are tested against the steady "
    "turn's yaw rate, lagged by 0.1 s. The kinematic scheme takes the tested gyro, unfiltered: the text says that ay is "
    "filtered, and has no other use for a tested yaw rate. Median of 5, patience of 0.05 s.",
    "Fusion is this project's reading of Cheng, Li, Chen (2018): the square-root cubature filter on the same linear "
    "bicycle, its noise found by window matching, and a complementary filter with the same kinematic scheme.",
    "The threshold of 1.5 m/s2 is the paper's and not searched. A search that may move it puts it above every ay of the "
    "drive, and so the kinematic scheme off.",
    "A seed draws the noise; the drive is the same.",
]
