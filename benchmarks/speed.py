"""How fast this package is, beside its peers: one table, measured in one run.

    python benchmarks/speed.py                     everything
    python benchmarks/speed.py --only filterpy     one group of rows: env, plant, filterpy, particles, drive, start,
                                                   blocks

A figure is the median of repeats, with the least and the greatest beside it. Here and peer take turns, and a ratio is
the median of the repeats' own ratios, so that a machine that slows down for a while slows both sides; one repeat more
than asked for is made first and thrown away. Times are processor time, which waiting for other people's processes does
not lengthen; only the starts of processes are timed by the clock on the wall. Everything runs in one thread.

Peers run in a virtual environment of their own, .venv-peers, made when missing, on the same readings with the same
compiled model; that they give the same estimates is checked before.
"""

import json
import os
import pickle
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from itertools import cycle, islice
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

import vse_gym  # noqa: F401  (registers the environments)
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.compiled import compiled
from vse_gym.inference.gaussian import filter_drive
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import CONTACT, advance, rolling_start
from vse_gym.physics.reference import DERIVATIVES, derivative
from vse_gym.sensors import stream
from vse_gym.simulation import rollout, scenario
from vse_gym.types import NO_TORQUE, Estimate, Reading
from vse_gym.vehicles import load

ROOT = Path(__file__).resolve().parent.parent
REQUIREMENTS, PEERS = ROOT / "benchmarks" / "peers-requirements.txt", ROOT / ".venv-peers"
GROUPS = ("env", "plant", "filterpy", "particles", "drive", "start", "blocks")
SAME = 1e-6  # largest difference between estimates that are called the same [SI]
ENV_SECONDS, CHUNK = 0.3, 16  # of one repeat of an environment, and steps between looks at the clock
PLANT_STEPS = 2000  # of one repeat of the plant


@dataclass
class Row:
    """One line of the table: of a rate, more is better; of anything else, less."""

    what: str
    unit: str
    here: list[float]
    peer: str = ""
    theirs: list[float] = field(default_factory=list)
    target: float | None = None
    of_ratio: bool = False  # the target is for here over peer, not for the figure here

    @property
    def ratio(self) -> float | None:
        """Median of here over peer, repeat by repeat; None without a peer."""
        ratios = [a / b for a, b in zip(self.here, self.theirs, strict=False)]
        return statistics.median(ratios) if ratios else None

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None if there is none."""
        value = self.ratio if self.of_ratio else statistics.median(self.here)
        if self.target is None or value is None:
            return None
        return value >= self.target if self.unit == "steps/s" else value <= self.target

    def cells(self) -> list[str]:
        """The line as printed."""
        target = ""
        if self.target is not None:
            sign = ">=" if self.unit == "steps/s" else "<="
            target = f"{sign} {_ratio(self.target) if self.of_ratio else f'{self.target:,g} {self.unit}'}"
        peer = f"{self.peer}: {_spread(self.theirs)}" if self.theirs else ""
        verdict = {True: "[green]yes", False: "[bold red]no", None: ""}[self.reached]
        ratio = "" if self.ratio is None else _ratio(self.ratio)
        return [self.what, f"{_spread(self.here)} {self.unit}", peer, ratio, target, verdict]


def _spread(values: Sequence[float]) -> str:
    figures = statistics.median(values), min(values), max(values)
    middle, *ends = (f"{v:,.3g}" if v < 1000 else f"{v:,.0f}" for v in figures)
    return f"{middle} ({' - '.join(ends)})"


def _ratio(ratio: float) -> str:
    return f"1/{1 / ratio:.3g}" if ratio < 1 else f"{ratio:,.3g}"


class Peers:
    """The process that peers.py runs in; started when first asked."""

    process: "subprocess.Popen[str] | None" = None

    def __init__(self, drive: Path):
        self.drive = drive

    def ask(self, request: str, *arguments: Any) -> Any:
        """The answer to one request of peers.py.

        Raises:
            RuntimeError: If the process ended; what it said stands above.
        """
        self.process = self.process or self._start()
        print(json.dumps([request, *arguments]), file=self.process.stdin, flush=True)
        if not (answer := self.process.stdout.readline()):
            raise RuntimeError(f"peers.py ended over {request}")
        return json.loads(answer)

    def _start(self) -> "subprocess.Popen[str]":
        python, installed = PEERS / "bin" / "python", PEERS / REQUIREMENTS.name
        if not installed.exists() or installed.read_text() != REQUIREMENTS.read_text():
            subprocess.run([sys.executable, "-m", "venv", PEERS], check=True)
            subprocess.run([python, "-m", "pip", "install", "--quiet", "-r", REQUIREMENTS], check=True)
            installed.write_text(REQUIREMENTS.read_text())
        settings = {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore", "SDL_VIDEODRIVER": "dummy"}
        settings["OPENBLAS_NUM_THREADS"] = "1"  # one thread on either side
        command = [python, ROOT / "benchmarks" / "peers.py", self.drive]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        return subprocess.Popen(command, env=os.environ | settings, text=True, **pipes)

    def close(self) -> None:
        """End the process."""
        if self.process:
            self.process.communicate()


class Bench:
    """A recorded drive, and the groups of rows that are measured on it; each group is a method of its name."""

    def __init__(self, repeats: int, folder: Path):
        self.repeats = repeats
        self.notes: list[str] = []
        self.scenario = scenario("sine_with_dwell")
        self.log = log = rollout(self.scenario, "ekf", "esc", seed=0)
        self.readings = [Reading(*row) for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True)]
        self.estimates = [Estimate(*row, cov) for row, cov in zip(log.estimate.tolist(), log.cov, strict=True)]
        self.model = ESTIMATORS.make("ekf").init(self.scenario.nominal, stream(0, "estimator")).model
        drive = folder / "drive.pickle"
        drive.write_bytes(pickle.dumps((self.model, log.inputs, log.readings)))
        self.peers = Peers(drive)

    def by_turns(self, *measures: Callable[[], float], repeats: int = 0, unit: float = 1.0) -> list[list[float]]:
        """Samples of each measure times ``unit``; the first round is a warm-up."""
        rounds = [[unit * measure() for measure in measures] for _ in range(1 + (repeats or self.repeats))]
        return [list(samples) for samples in zip(*rounds[1:], strict=True)]

    def update(self, estimator: Any) -> float:
        """Seconds per update over the recorded drive, called from Python."""
        rng = stream(0, "estimator")
        state = estimator.init(self.scenario.nominal, rng)
        start = time.process_time()
        for reading in self.readings:
            state = estimator.update(state, reading, rng)
        return (time.process_time() - start) / len(self.readings)

    def act(self, law: Any) -> float:
        """Seconds per decision of a controller over the recorded drive, called from Python."""
        state = law.init(self.scenario.nominal)
        start = time.process_time()
        for estimate, reading in zip(self.estimates, self.readings, strict=True):
            _, state = law.act(state, estimate, reading)
        return (time.process_time() - start) / len(self.readings)

    def env(self) -> Iterator[Row]:
        """Steps per second in one process: gymnasium.make, random actions, the resets that come up included."""
        settings = {"controller": "esc", "action": "brakes"}
        ours = [gymnasium.make("vse_gym/SineWithDwell-v0", estimator=e, **settings) for e in ("ekf", "truth")]
        names = ("CartPole-v1", "lane-keeping-v0", "racetrack-v0")
        peers = [lambda n=name: self.peers.ask("steps_per_second", n, ENV_SECONDS, CHUNK) for name in names]
        ekf, truth, *rates = self.by_turns(*map(_stepper, ours), *peers)
        self.notes.append("environments take random actions, drawn beforehand; the resets that come up are included")
        what = "env.step: sensors, ekf, esc"
        yield Row(what, "steps/s", ekf, target=15_000)
        yield Row("env.step: sensors, truth, esc", "steps/s", truth, target=25_000)
        yield from (Row(what, "steps/s", ekf, name, rate) for name, rate in zip(names, rates, strict=True))

    def plant(self) -> Iterator[Row]:
        """A control step of the plant beside as many bare evaluations of its derivative, on one car of each tyre."""
        for car in ("qin2014_understeer", "chen2024_c_class", "tian2018_electric"):
            vehicle, road = load(car), p.road((0.0, 0.9))
            inputs = p.Inputs(0.03, NO_TORQUE, np.full(4, 50.0))
            state = advance(vehicle, road, rolling_start(vehicle, 22.0), inputs, 300, 1e-3)  # in a turn of 0.4 g
            step, bare = self.by_turns(
                lambda a=(vehicle, road, state, inputs): _seconds(lambda: _many_steps(*a, PLANT_STEPS)) / PLANT_STEPS,
                lambda a=(vehicle, road, state, inputs): (
                    _seconds(lambda: _many_bare_loops(*a, PLANT_STEPS)) / PLANT_STEPS
                ),
                unit=1e6,
            )
            peer = ("10 derivatives and Euler steps, compiled", bare)
            yield Row(f"plant: 10 substeps, {car}", "us", step, *peer, 1.3, of_ratio=True)

    def filterpy(self) -> Iterator[Row]:
        """A filter's step, with the loop inside compiled code and called from Python, beside filterpy's."""
        for name, limit in (("ekf", 8), ("ukf", 15)):
            estimator, m = ESTIMATORS.make(name), self.model
            arguments = (estimator.rule, m, m.prior_mean, m.prior_cov, m.memory, self.log.inputs, self.log.readings)
            ours, theirs = filter_drive(*arguments), self.peers.ask("drive", name)
            worst = max(float(np.abs(a - b).max()) for a, b in zip(ours, theirs, strict=True))
            _same(worst, f"{name} and filterpy's")
            self.notes.append(f"{name} and filterpy's: means and covariances of a whole drive agree to {worst:.0e}")
            times = 20 * len(self.readings)
            inside, update, peer = self.by_turns(
                lambda a=arguments, n=times: _seconds(lambda: [filter_drive(*a) for _ in range(20)]) / n,
                lambda e=estimator: self.update(e),
                lambda n=name: self.peers.ask("seconds_per_update", n),
                unit=1e6,
            )
            theirs = (f"filterpy {name}", peer)
            yield Row(f"{name}: a step of a whole drive in one call", "us", inside, *theirs, 1 / 15, of_ratio=True)
            yield Row(f"{name}: Estimator.update", "us", update, *theirs, 1 / limit, of_ratio=True)
        self.notes.append(
            "filterpy is handed the compiled model in two calls a step: ekf, advance with its Jacobian, then attend "
            "and observe with its Jacobian; ukf, all sigma points at once each way. The algebra is its own"
        )

    def particles(self) -> Iterator[Row]:
        """A bootstrap filter's update beside the same in NumPy with filterpy's resampler."""
        worst = self.peers.ask("particle_model_error")
        _same(worst, "the model in NumPy and the compiled one")
        self.notes.append(f"the particle filter's model in NumPy agrees with the compiled one to {worst:.0e}")
        estimator = ESTIMATORS.make("pf", size=1000)
        peer = lambda: self.peers.ask("seconds_per_update", "pf", 1000)  # noqa: E731
        ours, theirs = self.by_turns(lambda: self.update(estimator), peer, unit=1e6)
        yield Row("pf, 1000 particles: Estimator.update", "us", ours, "NumPy", theirs, 1 / 3, of_ratio=True)

    def drive(self) -> Iterator[Row]:
        """The whole closed loop of a 6 s sine with dwell, with its log."""
        for name, target in (("ekf", 60.0), ("truth", None)):
            work = lambda n=name: rollout(self.scenario, n, "esc", seed=1)  # noqa: E731
            (took,) = self.by_turns(lambda w=work: _seconds(w), repeats=10, unit=1e3)
            yield Row(f"rollout: 6 s sine with dwell, {name}, esc", "ms", took, target=target)

    def start(self) -> Iterator[Row]:
        """From before a process is started until it has done its work, with machine code cached by earlier ones."""
        codes = (SAY, f"import vse_gym\n{SAY}", FIRST_STEP)
        rounds = [[_fresh(code) for code in codes] for _ in range(6)]
        (bare, _), (imported, _), (first, busy) = (
            zip(*samples, strict=True) for samples in zip(*rounds[1:], strict=True)
        )
        bare, first, net = list(bare), list(first), [a - b for a, b in zip(imported, bare, strict=True)]
        self.notes.append(f"processor time until the first step of vse-gym run: {_spread(busy)} s")
        beside = ("bare interpreter", bare)
        yield Row("import vse_gym, less the bare interpreter", "s", net, *beside, 0.6)
        yield Row("vse-gym run: from start to the first step", "s", first, *beside, 2.0)

    def blocks(self) -> Iterator[Row]:
        """Every registered estimator's update and controller's act, called from Python: for information."""
        for name in ESTIMATORS:
            estimator = ESTIMATORS.make(name)
            yield self._block(f"{name}: Estimator.update", lambda e=estimator: self.update(e))
        for name in CONTROLLERS:
            law = CONTROLLERS.make(name)
            yield self._block(f"{name}: Controller.act", lambda c=law: self.act(c))

    def _block(self, what: str, measure: Callable[[], float]) -> Row:
        measure()
        affordable = round(1.0 / (measure() * len(self.readings)))  # a second each
        return Row(what, "us", *self.by_turns(measure, repeats=max(3, min(self.repeats, affordable)), unit=1e6))


SAY = "print(time.time(), time.process_time())"
FIRST_STEP = f"""
from vse_gym import cli, simulation
step = simulation.Simulation.step
def first(self, demand):
    step(self, demand)
    {SAY}
    raise SystemExit
simulation.Simulation.step = first
cli.app(["run", "sine_with_dwell", "--estimator", "ekf", "--controller", "esc"])
"""


def _fresh(code: str) -> tuple[float, float]:
    """Seconds from before a new interpreter is started until its code speaks, and its processor time until then."""
    command, start = [sys.executable, "-c", f"import time\n{code}"], time.time()
    said, busy = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    return float(said) - start, float(busy)


@compiled
def _many_steps(vehicle, road, state, inputs, n):
    total = 0.0
    for _ in range(n):
        total += advance(vehicle, road, state, inputs, 10, 1e-3)[p.VX]
    return total


@compiled
def _many_bare_loops(vehicle, road, state, inputs, n):
    dx, wheels, direction, total = np.empty(DERIVATIVES), np.empty((4, CONTACT)), np.ones(4), 0.0
    for _ in range(n):
        x = state.copy()
        for _ in range(10):
            derivative(vehicle, road, x, inputs, direction, wheels, dx)
            for j in range(DERIVATIVES):
                x[j] += 1e-3 * dx[j]
        total += x[p.VX]
    return total


def _seconds(work: Callable[[], Any]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _same(worst: float, what: str) -> None:
    if not worst < SAME:
        raise RuntimeError(f"{what} differ by {worst:.2g}: nothing to compare")


def _stepper(env: Any) -> Callable[[], float]:
    """Measures steps per second, as ``steps_per_second`` in peers.py does."""
    env.action_space.seed(0)
    actions = cycle([env.action_space.sample() for _ in range(256)])
    env.reset(seed=0)

    def rate() -> float:
        steps, start = 0, time.process_time()
        while (spent := time.process_time() - start) < ENV_SECONDS:
            for action in islice(actions, CHUNK):
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            steps += CHUNK
        return steps / spent

    return rate


def _machine() -> str:
    info = Path("/proc/cpuinfo")
    names = [line for line in info.read_text().splitlines() if line.startswith("model name")] if info.exists() else []
    processor = names[0].partition(": ")[2] if names else platform.processor()
    return f"{processor}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {platform.platform(terse=True)}"


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Of each measurement but the starts and whole drives.")] = 11,
    only: Annotated[list[str] | None, typer.Option(help=f"Groups of rows: {', '.join(GROUPS)}.")] = None,
    json_path: Annotated[Path | None, typer.Option("--json", help="Write every sample here.")] = None,
    check: Annotated[bool, typer.Option("--check", help="Exit with 1 if a target is missed.")] = False,
) -> None:
    """Measure this package beside its peers and print one table."""
    if unknown := set(only or ()) - set(GROUPS):
        raise typer.BadParameter(f"no group {', '.join(sorted(unknown))}; known: {', '.join(GROUPS)}")
    began, console, rows = time.perf_counter(), Console(), []
    table = Table("what", "here", "peer", "here/peer", "target", "reached", title="Speed: median (least - greatest)")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(repeats, Path(folder))
        for group in only or GROUPS:
            for row in getattr(bench, group)():
                rows.append(row)
                table.add_row(*row.cells())
            table.add_section()
        peers = bench.peers.ask("versions") if bench.peers.process else {}
        bench.peers.close()
    here = {"python": platform.python_version()} | {name: version(name) for name in ("numba", "numpy", "gymnasium")}
    setting = {"machine": _machine(), "here": here, "peers": peers or "not asked", "repeats": repeats}
    setting["seconds"] = round(time.perf_counter() - began)
    console.print(table)
    for note in bench.notes:
        console.print(f"- {note}", highlight=False)
    for key, value in setting.items():
        text = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value
        console.print(f"{key}: {text}", highlight=False)
    if json_path:
        results = [asdict(row) | {"ratio": row.ratio, "reached": row.reached} for row in rows]
        json_path.write_text(json.dumps({"setting": setting, "notes": bench.notes, "rows": results}, indent=1))
    if check and any(row.reached is False for row in rows):
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
