"""System E: SR-UKF fed cornering stiffnesses by forgetting least squares. Tian, Zhang, Wang, Chen (2018).

J. Jilin University (Engineering).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from papers_common import Claim, Heard, Outcome, Paper, over_seeds
from papers_statistics import DEG, gain, median, rms, sideslip_error, spread
from rich.progress import track

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.stiffness_adaptive import StiffnessAdaptiveKalmanFilter
from vse_gym.metrics_found import SMALLEST, true_value
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.axles import axle_stiffness
from vse_gym.replay import Trace, shadow
from vse_gym.report.text import Sheet
from vse_gym.sensors import stream
from vse_gym.simulation import Scenario, rollout, scenario
from vse_gym.types import FOUND, Array, Estimate, Log, Reading

ROADS = (0.9, 0.4)  # friction
FORCE_NOISE = 50.0  # of the simulated force sensor [N]
FOLLOWS = 15.0  # an RMS error below so many per cent of the reference's RMS is called following (chosen)
STEP = 10e-3  # in which an update must have been made, to be in real time [s]
AXLES = ("stiffness_front", "stiffness_rear")
TUNED = ("sr_ukf_rls", "sr_ukf")
BUDGET = 60  # trials of each search
FROM_AY, SENSOR, FIXED, PEER = "forces from ay and dr/dt", "force sensor", "stiffness fixed", "sr_ukf, no least squares"
DEFAULT = "default tuning"


def drive(friction: float) -> Scenario:
    """The hand wheel's sine as published; one road."""
    return scenario("sine_steer", "tian2018_electric", "gaussian", friction=friction)


def training_drive(seed: int) -> Scenario:
    """Both roads by turns."""
    return drive(ROADS[seed % 2])


def loss(log: Log, trace: Trace) -> float:
    """RMS error of the sideslip over its RMS."""
    return rms(sideslip_error(log, trace)) / rms(DEG * log.sideslip)


class SensorState(NamedTuple):
    """The filter's state, and how many readings it has heard."""

    inner: Any
    heard: int


@dataclass(frozen=True)
class WithForceSensor(Estimator):
    """The filter in a car whose axles have force sensors: its readings carry both lateral forces. Of this file only.

    What they read comes with the estimator and not with the drive: no car of the benchmark has them.
    """

    inner: StiffnessAdaptiveKalmanFilter
    forces: Array  # front and rear at each reading, noise included, (T, 2) [N]

    def init(self, nominal: Nominal, rng: np.random.Generator) -> SensorState:
        return SensorState(self.inner.init(nominal, rng), 0)

    def update(self, state: SensorState, reading: Reading, rng: np.random.Generator) -> SensorState:
        more = reading._replace(y=np.concatenate((reading.y, self.forces[state.heard])))
        return SensorState(self.inner.update(state.inner, more, rng), state.heard + 1)

    def estimate(self, state: SensorState) -> Estimate:
        return self.inner.estimate(state.inner)


def slip_angles(log: Log) -> Array:
    """Of both axles, (T, 2) [rad]."""
    assert log.vehicle is not None
    car, vx, vy, r = log.vehicle, log.truth[:, p.VX], log.truth[:, p.VY], log.truth[:, p.YAW_RATE]
    front = log.steer - np.arctan2(vy + car.lf * r, vx)
    return np.column_stack((front, -np.arctan2(vy - car.lr * r, vx)))


def axle_forces(log: Log) -> Array:
    """Lateral forces of both axles in wheel axes, (T, 2) [N]: the stiffness's reference, times the slip angle."""
    assert log.vehicle is not None
    secant = axle_stiffness(log.vehicle, log.truth, log.steer, log.friction, 1e-9)
    return np.nan_to_num(secant * slip_angles(log))


def heard(friction: float, rows: Mapping[str, Estimator], seed: int) -> Heard:
    """One seed's drive on one road, heard by everybody; who has a force sensor is given what it reads.

    Raises:
        RuntimeError: If an estimator stops early.
    """
    setting = drive(friction)
    log = rollout(setting, "truth", "none", seed)
    noise = FORCE_NOISE * stream(seed, "papers/force sensor").standard_normal((len(log.time), 2))
    forces, traces = axle_forces(log) + noise, {}
    for name, estimator in rows.items():
        if isinstance(estimator, StiffnessAdaptiveKalmanFilter) and SENSOR in name:
            estimator = WithForceSensor(estimator, forces)
        traces[name] = shadow(log, estimator, setting.nominal, seed)
        if traces[name].ended:
            raise RuntimeError(f"{name} stopped on friction {friction} at seed {seed}: {traces[name].ended}")
    return Heard(log, traces)


def contenders(paper: Paper) -> dict[str, Estimator]:
    """The filter with either force, each beside itself without least squares; and the project's own SR-UKF."""
    searched = paper.contenders(TUNED)
    filter_: Any = searched["sr_ukf_rls"]
    fixed = replace(filter_, adapts=False)
    names = FROM_AY, f"{FROM_AY}, {FIXED}", SENSOR, f"{SENSOR}, {FIXED}"
    return dict(zip(names, (filter_, fixed, filter_, fixed), strict=True)) | {
        f"{FROM_AY}, {DEFAULT}": ESTIMATORS.make("sr_ukf_rls"),
        PEER: searched["sr_ukf"],
    }


def sideslip_percent(log: Log, trace: Trace) -> float:
    """RMS error over the RMS of the true sideslip."""
    return 100 * loss(log, trace)


def stiffness_percent(axle: str) -> Any:
    """The same of an axle's stiffness, where its slip angle is 0.3 deg or more, as a figure of a drive."""

    def figure(log: Log, trace: Trace) -> float:
        true = true_value(log, axle)
        error = np.where(np.isnan(true), np.nan, trace.found[:, FOUND.index(axle)] - true)
        return 100 * rms(error) / rms(true)

    return figure


def microseconds(log: Log, trace: Trace) -> float:
    """Median time of an update and estimate."""
    return 1e6 * trace.seconds


def run(paper: Paper) -> Outcome:
    """Both roads, heard by everybody."""
    rows, claims, tables, by_road = contenders(paper), [], {}, {}
    work = Parallel(n_jobs=paper.jobs, return_as="generator")
    for friction in ROADS:
        jobs = work(delayed(heard)(friction, rows, seed) for seed in paper.seeds)
        by_road[friction] = list(track(jobs, f"E: friction {friction}", total=len(paper.seeds), transient=True))
        tables[f"Friction {friction}: RMS error over RMS, median over seeds [90 % of them]"] = _table(
            by_road[friction], rows
        )
    for friction, made in by_road.items():
        for force in (FROM_AY, SENSOR):
            claims += _claims(friction, force, made)
        _draw(friction, made, paper.figures / f"E_friction_{10 * friction:02.0f}.png")
    spent = median(over_seeds(by_road[ROADS[1]], FROM_AY, microseconds))
    claims.append(
        Claim(
            "E", "in real time", "-", spent.text(".3g", "us"), spent.judged(1e6 * STEP), f"a step is {STEP * 1e3:g} ms"
        )
    )
    return Outcome(claims, tables, _notes(by_road))


def _table(made: Sequence[Heard], names: Any) -> Sheet:
    heads = ["", "sideslip [%]", "front stiffness [%]", "rear stiffness [%]", "largest sideslip error [deg]"]
    lines = []
    for name in names:
        stiffness = ["-" if name == PEER else spread(over_seeds(made, name, stiffness_percent(axle))) for axle in AXLES]
        worst = over_seeds(made, name, lambda log, trace: float(np.max(np.abs(sideslip_error(log, trace)))))
        lines.append([name, spread(over_seeds(made, name, sideslip_percent)), *stiffness, spread(worst)])
    return Sheet(heads, lines)


def _claims(friction: float, force: str, made: Sequence[Heard]) -> list[Claim]:
    out = []
    figures = {"sideslip": sideslip_percent, **{a: stiffness_percent(a) for a in AXLES}}
    slips = [DEG * np.nanmax(np.abs(slip_angles(made[0].log)[:, k])) for k in (0, 1)]
    for what, figure in figures.items():
        ours, fixed = (over_seeds(made, name, figure) for name in (force, f"{force}, {FIXED}"))
        name = f"friction {friction}, {force}: {what.replace('_', ' ')}"
        follows, better = median(ours), gain(ours, fixed)
        why = _why(what, slips, made, force) if follows.judged(FOLLOWS) != "holds" else ""
        figure_text = follows.text(".3g", "%")
        out.append(Claim("E", f"{name} follows (under {FOLLOWS:g} %)", "-", figure_text, follows.judged(FOLLOWS), why))
        out.append(
            Claim("E", f"{name} better than with fixed stiffness", "-", better.text("+.0f", "%"), better.judged(), "")
        )
    peer = gain(*(over_seeds(made, name, sideslip_percent) for name in (force, PEER)))
    claim = f"friction {friction}, {force}: sideslip better than the single track's SR-UKF, searched alike"
    out.append(Claim("E", claim, "-", peer.text("+.0f", "%"), peer.judged(), "its tyres saturate at a friction of 0.9"))
    return out


def _why(what: str, slips: Sequence[float], made: Sequence[Heard], force: str) -> str:
    log, trace = made[0].log, made[0].traces[force]
    if what == "sideslip":
        error = np.abs(sideslip_error(log, trace))
        k = int(np.argmax(error))
        return f"worst at {log.time[k]:.1f} s, {error[k]:.1f} deg, where it is {DEG * abs(log.sideslip[k]):.1f} deg"
    axle = AXLES.index(what)
    true, found = true_value(log, what), trace.found[:, FOUND.index(what)]
    late = lag_of(true, found, log.time[1] - log.time[0])
    low = np.nanmin(true)
    return (
        f"slips up to {slips[axle]:.0f} deg take the stiffness down to {1e-3 * low:.0f} kN/rad and up again within "
        f"the turn; the estimate is {1e3 * late:.0f} ms late, and in error by {_without_lag(true, found, late):.0f} % "
        "when that is taken off"
    )


def lag_of(true: Array, found: Array, dt: float, most: float = 1.0) -> float:
    """By how much an estimate is late: the shift that makes its RMS error least [s]."""
    shifts = range(round(most / dt))
    return dt * min(shifts, key=lambda k: rms(found[k:] - true[: len(true) - k]))


def _without_lag(true: Array, found: Array, late: float, dt: float = 0.01) -> float:
    k = round(late / dt)
    return 100 * rms(found[k:] - true[: len(true) - k]) / rms(true)


def _notes(by_road: Mapping[float, Sequence[Heard]]) -> list[str]:
    peaks = []
    for friction, made in by_road.items():
        slip = DEG * np.nanmax(np.abs(slip_angles(made[0].log)), axis=0)
        peaks.append(f"{slip[0]:.1f} and {slip[1]:.1f} deg on {friction}")
    return [
        "every number of the car, the sensors (the quiet set), Q and R; the filter hears wheel speeds too, since the "
        "speed would else be left to the drive forces",
        f"largest slip angles, front and rear: {', '.join(peaks)}; the road's friction is told to nobody (0.9 on both)",
        f"force sensor: the plant's lateral force of each axle with a noise of {FORCE_NOISE:g} N",
        f"the reference: the plant's Fy over alpha of each axle, masked below {DEG * SMALLEST:.1f} deg; following "
        f"means an RMS error under {FOLLOWS:g} % of the reference's RMS",
        "searched and driven on the same two manoeuvres, with other noise; the table has the default tuning beside it",
        "fixed: the same filter with the same tuning and nominal stiffnesses, which stand for no least squares",
        "searched tunings: the common search, loss the sideslip's RMS error over its RMS on both roads by turns",
    ]


# -- pictures ---------------------------------------------------------------------------------------------------------

COLOURS = {FROM_AY: "tab:blue", SENSOR: "tab:green", f"{FROM_AY}, {FIXED}": "tab:orange"}


def _draw(friction: float, made: Sequence[Heard], path: Path) -> None:
    from matplotlib.figure import Figure

    log, traces = made[0]
    figure = Figure(figsize=(8, 7.5), layout="constrained")
    frames = figure.subplots(3, 1, sharex=True)
    for name, colour in COLOURS.items():
        estimate, found = traces[name].estimate, traces[name].found
        frames[0].plot(log.time, DEG * np.arctan2(estimate[:, 1], estimate[:, 0]), color=colour, lw=1, label=name)
        for axes, axle in zip(frames[1:], AXLES, strict=True):
            axes.plot(log.time, 1e-3 * found[:, FOUND.index(axle)], color=colour, lw=1)
    frames[0].plot(log.time, DEG * log.sideslip, "k", lw=1.4, label="reference")
    for axes, axle in zip(frames[1:], AXLES, strict=True):
        axes.plot(log.time, 1e-3 * true_value(log, axle), "k", lw=1.4)
        axes.set_ylabel(f"{axle.replace('_', ' ')} [kN/rad]")
        axes.set_ylim(bottom=0)
    frames[0].set(ylabel="sideslip [deg]", title=f"friction {friction}")
    frames[0].legend(fontsize=8, frameon=False)
    frames[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=120)
