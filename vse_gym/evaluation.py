"""Studies: many drives, one row per run.

A cell is driven once with true states per seed; that drive is heard by every estimator (shadow) and is what every
closed-loop drive of the same seed is compared with (loop). Cells are drawn anew for every seed, alike for everybody.
"""

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from joblib import Parallel, delayed

from vse_gym import metrics
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import si
from vse_gym.models import Nominal
from vse_gym.physics.parameters import PerWheel, Vehicle
from vse_gym.registry import UnknownNameError
from vse_gym.replay import shadow
from vse_gym.sensors import stream, suite
from vse_gym.simulation import Scenario, fitting_integrator, rollout
from vse_gym.types import Log
from vse_gym.vehicles import load

if TYPE_CHECKING:
    import polars

POTENTIAL = "none"  # the row of the car without stability control: what there is to gain; never ranked
MOST_REPLACED = 20  # a cell whose truth drive ends badly this often in a row is no cell


@dataclass(frozen=True)
class Randomise:
    """How a cell is drawn for each seed; nothing of it is told to estimators."""

    speed: float = 0.0  # +/- [m/s]
    steer: float = 0.0  # +/- of the hand wheel's amplitude, relative; if not zero the side is drawn too [-]
    friction: float = 0.0  # +/- [-]
    mass: tuple[float, float] = (1.0, 1.0)  # times
    stiffness: tuple[float, float] = (1.0, 1.0)  # times, cornering stiffness of every tyre
    steering_offset: float = 0.0  # +/- of the road wheels with the hand wheel straight [rad]
    radius_error: float = 0.0  # +/- of each wheel by itself, relative [-]
    slope: float = 0.0  # +/- [rad]
    bank: float = 0.0  # +/- [rad]


@dataclass(frozen=True)
class Cell:
    """One drive of a study, as it is written down: by names, so that a row says what was driven.

    Raises:
        UnknownNameError, TypeError, ValueError: If a name or a setting cannot be; the message says what can.
    """

    name: str
    manoeuvre: str
    vehicle: str = "qin2014_understeer"
    controller: str = "esc"
    sensors: str = "gaussian"
    benign: bool = False  # a drive that needs no help: only needless braking counts
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the manoeuvre, SI or with a unit's suffix

    def __post_init__(self) -> None:
        CONTROLLERS[self.controller], suite(self.sensors), load(self.vehicle)
        MANOEUVRES.make(self.manoeuvre, **si(self.settings))

    def scenario(self, randomise: Randomise, seed: int) -> Scenario:
        """The cell as one seed draws it; estimators are told what is written."""
        written = MANOEUVRES.make(self.manoeuvre, **si(self.settings))
        car, noise = load(self.vehicle), suite(self.sensors)
        draw = stream(seed, f"cell/{self.name}")
        ranges = (randomise.speed, randomise.steer, randomise.friction)
        speed, steer, friction = (draw.uniform(-r, r) for r in ranges)
        mass, stiffness = draw.uniform(*randomise.mass), draw.uniform(*randomise.stiffness)
        side = draw.choice([-1.0, 1.0]) if randomise.steer else 1.0
        changes: dict[str, Any] = {"speed": written.speed + speed, "friction": _icy(written.friction + friction)}
        known = {f.name for f in fields(written)}
        if "side" in known:
            changes["side"] = written.side * side
        if "amplitude" in known and written.amplitude is not None:
            changes["amplitude"] = written.amplitude * side * (1 + steer)
        if "friction_after" in known and written.friction_after is not None:
            changes["friction_after"] = _icy(written.friction_after + friction)
        if "jump" in known:  # where it lies does not depend on the speed that was drawn
            changes["jump"] = written.jump * written.speed / changes["speed"]
        told = Nominal(car, noise.sheet, written.speed)
        # Drawn last, so that what was drawn before these conditions existed stays as it was.
        conditions = [randomise.steering_offset, *4 * [randomise.radius_error], randomise.slope, randomise.bank]
        offset, *radius_errors, slope, bank = (draw.uniform(-r, r) for r in conditions)
        changes |= {"slope": written.slope + slope, "bank": written.bank + bank}
        driven = _changed(car, mass, stiffness)._replace(steering_offset=offset, radius_error=PerWheel(*radius_errors))
        return Scenario(replace(written, **changes), driven, noise, told, integrator=fitting_integrator(driven))


def _icy(friction: float) -> float:
    """No road is smoother than wet ice, whatever was drawn."""
    return max(0.05, friction)


def _changed(car: Vehicle, mass: float, stiffness: float) -> Vehicle:
    tyres = {
        axle: tyre._replace(cornering_stiffness=tyre.cornering_stiffness * stiffness)
        for axle, tyre in (("front_tyre", car.front_tyre), ("rear_tyre", car.rear_tyre))
    }
    return car._replace(mass=car.mass * mass, **tyres)


@dataclass(frozen=True)
class Study:
    """Cells, how they are drawn, and who is judged.

    Raises:
        ValueError: If there are no seeds.
    """

    name: str
    version: int
    cells: tuple[Cell, ...]
    seeds: int = 10
    first_seed: int = 0  # tuning and reporting never share seeds
    estimators: tuple[str, ...] = ()  # empty: all there are
    randomise: Randomise = field(default_factory=Randomise)

    def __post_init__(self) -> None:
        if not self.seeds >= 1:
            raise ValueError(f"study {self.name!r}: seeds must be at least 1, not {self.seeds}")

    @classmethod
    def load(cls, name: str | Path) -> "Study":
        """A study by its name, or from a TOML file.

        Raises:
            UnknownNameError: If there is no such study; the message names those that exist.
            ValueError, TypeError: If the file says something that a study does not know.
        """
        path = Path(name) if str(name).endswith(".toml") else STUDIES / f"{name}.toml"
        if not path.is_file():
            known = ", ".join(study_names())
            raise UnknownNameError(f"no study named {str(name)!r}; known: {known}, or the path of a .toml file")
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        draw: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in si(table.pop("randomise", {})).items()
        }
        cells = tuple(Cell(**cell) for cell in table.pop("cell", ()))
        if not cells:
            raise ValueError(f"{path.name}: a study needs at least one [[cell]]")
        if len({c.name for c in cells}) < len(cells):
            raise ValueError(f"{path.name}: two cells have the same name")
        estimators = tuple(table.pop("estimators", ()))
        return cls(path.stem, cells=cells, estimators=estimators, randomise=Randomise(**draw), **table)


def _studies_folder() -> Path:
    installed = Path(__file__).parent / "studies"  # where the wheel carries them
    return installed if installed.is_dir() else Path(__file__).parent.parent / "benchmarks" / "studies"


STUDIES = _studies_folder()


def study_names() -> list[str]:
    """The studies that come with the package."""
    return sorted(path.stem for path in STUDIES.glob("*.toml"))


Judged = Sequence[str | Estimator] | Mapping[str, str | Estimator]


def judged(estimators: Judged) -> dict[str, Estimator]:
    """Estimators by the name of their row: a name of the catalogue, or of the class of an instance.

    Raises:
        UnknownNameError: If a name is not known.
        ValueError: If two rows would have the same name, or one that of the car without control.
    """
    if isinstance(estimators, Mapping):
        rows = {name: ESTIMATORS.make(e) for name, e in estimators.items()}
    else:
        rows = {}
        for e in estimators:
            name = e if isinstance(e, str) else type(e).__name__
            if name in rows:
                raise ValueError(f"two estimators named {name!r}: hand in a mapping from names to estimators")
            rows[name] = ESTIMATORS.make(e)
    if POTENTIAL in rows:
        raise ValueError(f"{POTENTIAL!r} is the row of the car without stability control: name the estimator otherwise")
    return rows


def run_study(
    study: Study, estimators: Judged | None = None, seeds: int | None = None, jobs: int = 1
) -> Iterator[list[dict[str, Any]]]:
    """Rows as they come, all those of one cell and seed together; every (cell, seed) once, in no order."""
    if seeds is not None and seeds < 1:
        raise ValueError(f"seeds must be at least 1, not {seeds}")
    rows = judged(estimators if estimators is not None else study.estimators or tuple(ESTIMATORS))
    numbers = range(study.first_seed, study.first_seed + (seeds or study.seeds))
    tasks = [(cell, seed) for seed in numbers for cell in study.cells]
    work = Parallel(n_jobs=jobs, return_as="generator_unordered")
    yield from work(delayed(run_cell)(study, cell, seed, rows) for cell, seed in tasks)


def evaluate(
    study: Study | str, estimators: Judged | None = None, seeds: int | None = None, jobs: int = 1
) -> "polars.DataFrame":
    """One row per cell, seed and estimator, sorted; columns ``loop_*`` and ``shadow_*``, see :mod:`vse_gym.metrics`.

    Args:
        study: A study or its name.
        estimators: Names, instances, or a mapping from row names to either; None: the study's own.
        seeds: How many, from the study's first on; None: the study's own.
        jobs: Processes.
    """
    study = Study.load(study) if isinstance(study, str) else study
    return table([row for part in run_study(study, estimators, seeds, jobs) for row in part])


def table(rows: Sequence[Mapping[str, Any]]) -> "polars.DataFrame":
    """Rows as a table in an order that does not depend on who finished first."""
    import polars

    return polars.DataFrame(list(rows), infer_schema_length=None).sort("cell", "seed", "estimator")


def run_cell(study: Study, cell: Cell, seed: int, estimators: Mapping[str, Estimator]) -> list[dict[str, Any]]:
    """All rows of one cell at one seed. A seed whose truth drive ends badly is replaced, and that is counted."""
    for replaced in range(MOST_REPLACED):
        used = seed + 1_000_000 * replaced
        scenario = cell.scenario(study.randomise, used)
        truth = rollout(scenario, "truth", cell.controller, used)
        if not truth.ended:
            break
    else:
        why = f"with true states {cell.controller} ends badly ({truth.ended}) at every seed"
        raise ValueError(f"cell {cell.name!r}: {why}")
    head = {
        "study": study.name,
        "version": study.version,
        "cell": cell.name,
        "manoeuvre": cell.manoeuvre,
        "vehicle": cell.vehicle,
        "controller": cell.controller,
        "sensors": cell.sensors,
        "benign": cell.benign,
        "seed": seed,
        "replaced": replaced,
    }
    alone = rollout(scenario, "truth", "none", used)
    rows = [head | {"estimator": POTENTIAL} | _loop(scenario, cell, alone, truth)]
    for name, estimator in estimators.items():
        heard = shadow(truth, estimator, scenario.nominal, used)
        e = metrics.errors(truth.truth, heard.estimate, heard.cov, heard.nis, heard.effective_size)
        direct: dict[str, Any] = {f"shadow_{k}": v for k, v in metrics.direct(e).items()}
        if heard.ended:  # errors of the part that it survived would flatter it
            direct = {k: None if isinstance(v, float) else True for k, v in direct.items()}
        direct |= {"shadow_update_us": 1e6 * heard.seconds, "shadow_ended": heard.ended}
        log = rollout(scenario, estimator, cell.controller, used)
        rows.append(head | {"estimator": name} | _loop(scenario, cell, log, truth) | direct)
    return rows


def _loop(scenario: Scenario, cell: Cell, log: Log, truth: Log) -> dict[str, Any]:
    """Columns of a closed-loop drive."""
    out: dict[str, Any] = {"loop_ended": log.ended, "loop_filled": " ".join(log.filled), "loop_passed": False}
    if not len(log.time):  # an estimator that raises on the first reading has no drive to measure
        return out | _regret(metrics.ENDED_BADLY)
    out["loop_passed"] = scenario.manoeuvre.judge(log, scenario.nominal).passed
    for name, metric in metrics.METRICS.items():
        value, reference = metric(log), metric(truth)
        out |= {f"loop_{name}": value, f"loop_{name}_diff": value - reference}
        out |= {f"loop_{name}_absdiff": abs(value - reference)}
    heading = metrics.heading_difference_deg(log, truth)
    out |= {"loop_heading_diff_deg": heading, "loop_heading_absdiff_deg": abs(heading)}
    out |= {"loop_path_deviation_m": metrics.path_deviation_m(log, truth)}
    unknown = np.full(len(log.time), math.nan)
    e = metrics.errors(log.truth, log.estimate, log.cov, log.nis, unknown)
    own: dict[str, Any] = {k: v for k, v in metrics.direct(e).items() if k != "effective_size"}
    own["update_us"] = 1e6 * float(np.median(log.seconds))
    return out | {f"loop_{k}": v for k, v in own.items()} | _regret(metrics.regret(log, truth, cell.benign))


def _regret(regret: metrics.Regret) -> dict[str, float]:
    return {"regret": regret.total} | {f"regret_{k}": v for k, v in regret._asdict().items()}
