"""FMVSS 126: slowly increasing steer, then the series of sines with dwell."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from joblib import delayed

from vse_gym import metrics
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import DEG, Criterion
from vse_gym.manoeuvres.sine_with_dwell import SineWithDwell, first_peak
from vse_gym.manoeuvres.slowly_increasing_steer import SlowlyIncreasingSteer
from vse_gym.physics import parameters as p
from vse_gym.procedures.drives import Progress, at_work, of_this_car, silent
from vse_gym.sensors import SUITES, Sensors, suite
from vse_gym.simulation import rollout
from vse_gym.types import Array
from vse_gym.vehicles import load

if TYPE_CHECKING:
    import polars


@dataclass(frozen=True)
class SeriesRun:
    """One sine with dwell of the series."""

    amplitude: float  # of the hand wheel; positive: first to the left [rad]
    multiple: float  # of A [-]
    criteria: tuple[Criterion, ...]  # of the standard, each with its figure and limit
    ended: str  # why the drive ended early; empty: it did not
    peak_sideslip: float  # [rad]
    brake_energy: float  # [J]
    yaw_rate_peak: float  # first after the hand wheel's reversal, towards the second half; NaN if none [rad/s]
    time: Array = field(repr=False, compare=False)  # (T,) [s]
    hand_wheel: Array = field(repr=False, compare=False)  # (T,) [rad]
    yaw_rate: Array = field(repr=False, compare=False)  # (T,) [rad/s]

    @property
    def passed(self) -> bool:
        """Whether every judged criterion is kept, to the end of the drive."""
        return not self.ended and all(c.passed for c in self.criteria if c.judged)


@dataclass(frozen=True)
class Fmvss126:
    """What the procedure found."""

    steer_at_0_3g: float  # A, mean of both directions [rad]
    runs: tuple[SeriesRun, ...]  # by amplitude, left before right

    @property
    def passed(self) -> bool:
        """Whether every run passed."""
        return all(run.passed for run in self.runs)

    @property
    def peak_sideslip(self) -> float:
        """Largest of all runs [rad]."""
        return max(run.peak_sideslip for run in self.runs)

    def table(self) -> "polars.DataFrame":
        """One row per run, units in the columns' names; a criterion that is not judged is neither kept nor not."""
        import polars

        rows: list[dict[str, Any]] = []
        for run in self.runs:
            row: dict[str, Any] = {
                "multiple_of_A": run.multiple,
                "amplitude_deg": abs(run.amplitude) / DEG,
                "first_to": "left" if run.amplitude > 0 else "right",
            }
            for c in run.criteria:
                row |= {f"{c.name} [{c.unit}]": c.figure, f"{c.name}: kept": c.passed if c.judged else None}
            row |= {"peak_sideslip_deg": run.peak_sideslip / DEG, "brake_energy_kJ": run.brake_energy / 1e3}
            rows.append(row | {"ended": run.ended, "passed": run.passed})
        return polars.DataFrame(rows, infer_schema_length=None)


def series_amplitudes(a: float) -> list[float]:
    """Amplitudes of FMVSS 126 S7.9: from 1.5 A by 0.5 A to the greater of 6.5 A and 270 deg, or 300 deg [rad].

    The last is 300 deg if 6.5 A is more. No amplitude is driven twice.
    """
    last = 300 * DEG if 6.5 * a > 300 * DEG else max(6.5 * a, 270 * DEG)
    rising = [0.5 * k * a for k in range(3, 2 + math.ceil(last / (0.5 * a)))]
    return [*(amplitude for amplitude in rising if amplitude < last - 1e-9), last]


def measure_steer_at_0_3g(vehicle: str | p.Vehicle) -> float:
    """A of a car by FMVSS 126 S7.6: mean magnitude over slowly increasing steer to the left and to the right [rad].

    The standard repeats each direction three times; here one is enough, because the plant repeats itself to the bit.
    The car is driven without stability control, and its lateral acceleration is the true one.

    Raises:
        ValueError: If the car does not reach 0.375 g, so that there is nothing to draw the line through.
    """
    car, found = load(vehicle), []
    for side in (1.0, -1.0):
        cell = of_this_car(SlowlyIncreasingSteer(rate=side * SlowlyIncreasingSteer.rate), car, SUITES["clean"])
        log = rollout(cell, "truth", "none", 0)
        figures = {c.name: c.figure for c in cell.manoeuvre.judge(log, cell.nominal).criteria}
        angle = figures["hand-wheel angle at 0.3 g, A"]
        if not math.isfinite(angle):
            reached = f"{figures['largest lateral acceleration']:.2f} g"
            raise ValueError(
                f"this car has no A: it reaches {reached} of the 0.375 g that slowly increasing steer needs"
            )
        found.append(abs(angle) * DEG)
    return sum(found) / 2


def fmvss126(
    vehicle: str | p.Vehicle,
    estimator: str | Estimator = "ekf",
    controller: str | Controller = "esc",
    sensors: str | Sensors = "gaussian",
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
) -> Fmvss126:
    """The whole procedure of FMVSS 126 (49 CFR 571.126, S7.6 and S7.9): A, then every sine with dwell of the series.

    Estimator and controller are told this very car and a friction of 0.9.

    Args:
        vehicle: A name, the path of a TOML file, or a Vehicle.
        estimator: What the controller sees the car through.
        controller: Who brakes.
        sensors: The name of a suite, or Sensors.
        seed: Of the noise, the same in every run.
        jobs: Processes.
        progress: Called after every run of the series.

    Raises:
        UnknownNameError: If a name is not known.
        ValueError: If the car has no A.
    """
    car, noise = load(vehicle), suite(sensors)
    eyes, law = ESTIMATORS.make(estimator), CONTROLLERS.make(controller)
    a = measure_steer_at_0_3g(car)
    steers = [side * amplitude for amplitude in series_amplitudes(a) for side in (1.0, -1.0)]
    drives = (delayed(_series_run)(car, noise, eyes, law, seed, amplitude, a) for amplitude in steers)
    return Fmvss126(a, tuple(at_work(drives, jobs, progress, len(steers))))


def _series_run(
    car: p.Vehicle, noise: Sensors, estimator: Estimator, law: Controller, seed: int, amplitude: float, a: float
) -> SeriesRun:
    test = SineWithDwell(amplitude=amplitude)
    cell = of_this_car(test, car, noise)
    log = rollout(cell, estimator, law, seed)
    if not len(log.time):
        raise ValueError(f"the drive never began: {log.ended}")
    against = -math.copysign(1.0, amplitude) * log.truth[:, p.YAW_RATE]
    return SeriesRun(
        amplitude=amplitude,
        multiple=abs(amplitude) / a,
        criteria=test.verdict(log, cell.nominal).criteria,
        ended=log.ended,
        peak_sideslip=log.peak_sideslip,
        brake_energy=1e3 * metrics.brake_energy_kJ(log),
        yaw_rate_peak=first_peak(log.time, against, test.begin + 0.5 / test.frequency, test.complete),
        time=log.time,
        hand_wheel=log.hand_wheel,
        yaw_rate=log.truth[:, p.YAW_RATE],
    )
