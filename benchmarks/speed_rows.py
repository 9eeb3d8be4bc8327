"""The groups of rows that speed.py measures."""

import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from speed_table import ROOT, Peers, Row, spread
from speed_vector import collected, stepped

import vse_gym  # noqa: F401  (registers the environments)
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.compiled import compiled
from vse_gym.inference.gaussian import filter_drive
from vse_gym.inference.linear import kalman_drive
from vse_gym.physics.double_track import CONTACT, advance, rolling_start
from vse_gym.physics.parameters import STATE_SIZE, Inputs
from vse_gym.physics.reference import DERIVATIVES, derivative
from vse_gym.scenarios import scenario
from vse_gym.sensors import stream
from vse_gym.simulation import rollout
from vse_gym.types import Estimate, Reading

GROUPS = ("env", "vector", "filterpy", "particles", "plant", "drive", "start", "blocks")
SAME = 1e-6  # largest difference between estimates that are called the same [SI]
GENTLE = np.radians(50)  # of the hand wheel, for a car that shall not slide
CHEAP = 60.0  # most that an update may cost [us]; others by name
LIMITS = {"pf": 500.0, "pf_cauchy_gaussian": 500.0, "mapf": 500.0, "mapf_physics": 500.0}
LIMITS |= {"acpf": 2000.0, "upf": 3000.0, "mhe": 1000.0, "switching": 20.0}
ENV_SECONDS, CHUNK = 0.3, 16  # of one repeat of an environment, and steps between looks at the clock


class Bench:
    """A recorded drive, and the groups of rows that are measured on it; each group is a method of its name."""

    def __init__(self, repeats: int, folder: Path):
        self.repeats = repeats
        self.notes: list[str] = []
        self.scenario = scenario("sine_with_dwell")
        self.log = log = rollout(self.scenario, "ekf", "esc", seed=0)
        self.readings = [Reading(*row) for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True)]
        self.estimates = [Estimate(*row, cov) for row, cov in zip(log.estimate.tolist(), log.cov, strict=True)]
        models = [ESTIMATORS.make(e).init(self.scenario.nominal, stream(0, "estimator")).model for e in ("ekf", "kf")]
        models[1] = models[1]._replace(memory=models[1].car.memory)  # without the gate's
        self.road, self.steered = self.scenario.manoeuvre.road(), Inputs(0.02, np.zeros(4), np.zeros(4))
        drive = folder / "drive.pickle"
        drive.write_bytes(pickle.dumps((*models, log.inputs, log.readings)))
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

    def vector(self) -> Iterator[Row]:
        """The native vector environment, in two threads: times by the clock on the wall."""
        yield from stepped(self.repeats)
        try:
            yield from collected(self.repeats)
        except ModuleNotFoundError as error:
            self.notes.append(f"no row of stable-baselines3: {error}")

    def filterpy(self) -> Iterator[Row]:
        """A filter's step, with the loop inside compiled code and called from Python, beside filterpy's."""
        limits = {"kf": 3, "ekf": 8, "ukf": 15, "ckf": 15, "sr_ukf": 15}
        for name, limit in limits.items():
            estimator = ESTIMATORS.make(name)
            rule, m = estimator.init(self.scenario.nominal, stream(0, "estimator")).constants.value
            whole = kalman_drive if name == "kf" else filter_drive
            arguments = (rule, m, m.prior_mean, m.prior_cov, m.memory, self.log.inputs, self.log.readings)
            ours, theirs = whole(*arguments), self.peers.ask("drive", name)
            worst = max(float(np.abs(a - b).max()) for a, b in zip(ours, theirs, strict=True))
            _same(worst, f"{name} and filterpy's")
            self.notes.append(f"{name} and filterpy's: means and covariances of a whole drive agree to {worst:.0e}")
            times = 20 * len(self.readings)
            inside, update, peer = self.by_turns(
                lambda f=whole, a=arguments, n=times: _seconds(lambda: [f(*a) for _ in range(20)]) / n,
                lambda e=estimator: self.update(e),
                lambda n=name: self.peers.ask("seconds_per_update", n),
                unit=1e6,
            )
            theirs = (f"filterpy {'ukf' if name == 'sr_ukf' else name}", peer)
            yield Row(f"{name}: a step of a whole drive in one call", "us", inside, *theirs, 1 / 15, of_ratio=True)
            yield Row(f"{name}: Estimator.update", "us", update, *theirs, 1 / limit, of_ratio=True)
        yield self._ensemble()
        self.notes.append(
            "filterpy is handed the compiled model in two calls a step: ekf, advance with its Jacobian, then attend "
            "and observe with its Jacobian; ukf, ckf and enkf, all points at once each way; kf, all matrices in one. "
            "The algebra is its own. It has no square-root unscented filter: sr_ukf stands beside its ukf"
        )

    def _ensemble(self) -> Row:
        estimator = ESTIMATORS.make("enkf")
        rng, means = stream(0, "estimator"), []
        state = estimator.init(self.scenario.nominal, rng)
        for reading in self.readings:
            state = estimator.update(state, reading, rng)
            means.append(state.output[:3])
        theirs, covs = map(np.array, self.peers.ask("drive", "enkf", estimator.size))
        apart = np.sqrt(np.mean((np.array(means) - theirs) ** 2 / np.diagonal(covs, axis1=1, axis2=2)))
        if not apart < 1:  # two ensembles of a hundred differ by 0.14 of a standard deviation at each draw
            raise RuntimeError(f"enkf and filterpy's differ by {apart:.2g} standard deviations: nothing to compare")
        self.notes.append(
            f"enkf and filterpy's, of {estimator.size} members: apart by {apart:.2f} of a deviation (RMS)"
        )
        peer = lambda: self.peers.ask("seconds_per_update", "enkf", estimator.size)  # noqa: E731
        ours, other = self.by_turns(lambda: self.update(estimator), peer, unit=1e6)
        return Row("enkf: Estimator.update", "us", ours, "filterpy enkf", other, 1 / 5, of_ratio=True)

    def plant(self) -> Iterator[Row]:
        """The plant's step beside a bare loop over its derivative, and whole drives beside the time they last."""
        step, bare = self.by_turns(
            lambda: _seconds(lambda: [plant_steps(self, 1000) for _ in range(20)]) / 20_000,
            lambda: _seconds(lambda: [bare_steps(self, 1000) for _ in range(20)]) / 20_000,
            unit=1e6,
        )
        yield Row("plant: a semi-implicit step of 1 ms", "us", step, "derivative", bare, 1.3, of_ratio=True)
        try:
            heavy = scenario("sine_with_dwell", "bmw_320i", plant="commonroad_mb", amplitude=GENTLE)
            rollout(heavy, "truth", "none", seed=1)
        except ImportError as error:
            self.notes.append(f"no row of the multi-body plant: {error}")
            return
        took = [
            _seconds(lambda: rollout(heavy, "truth", "none", seed=1)) / heavy.manoeuvre.duration
            for _ in range(min(3, self.repeats))
        ]
        yield Row("multi-body plant: time of a drive over what it lasts", "s/s", took, target=1 / 15)

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
        self.notes.append(f"processor time until the first step of vse-gym run: {spread(busy)} s")
        beside = ("bare interpreter", bare)
        yield Row("import vse_gym, less the bare interpreter", "s", net, *beside, 0.6)
        yield Row("vse-gym run: from start to the first step", "s", first, *beside, 2.0)

    def blocks(self) -> Iterator[Row]:
        """Every registered estimator's update with what it may cost, and controller's act for information."""
        for name in ESTIMATORS:
            estimator = ESTIMATORS.make(name)
            limit = LIMITS.get(name, CHEAP)
            yield self._block(f"{name}: Estimator.update", lambda e=estimator: self.update(e), limit)
        for name in CONTROLLERS:
            law = CONTROLLERS.make(name)
            try:
                yield self._block(f"{name}: Controller.act", lambda c=law: self.act(c))
            except ModuleNotFoundError as error:
                self.notes.append(f"no row of {name}: {error}")

    def _block(self, what: str, measure: Callable[[], float], limit: float | None = None) -> Row:
        measure()
        affordable = round(1.0 / (measure() * len(self.readings)))  # a second each
        (took,) = self.by_turns(measure, repeats=max(3, min(self.repeats, affordable)), unit=1e6)
        return Row(what, "us", took, target=limit)


@compiled
def derivatives(vehicle, road, x, inputs, steps, out):
    """The derivative at a state so many times over, each nudging the next: what the tyres alone cost."""
    direction, wheels, dx = np.ones(4), np.empty((4, CONTACT)), np.empty(STATE_SIZE)
    for _ in range(steps):
        derivative(vehicle, road, x, inputs, direction, wheels, dx)
        for i in range(DERIVATIVES):
            out[i] = x[i] + 1e-3 * dx[i]
            x[i] = out[i]


def plant_steps(bench: Bench, steps: int) -> None:
    """So many steps of the plant from a rolling start."""
    car = bench.scenario.vehicle
    advance(car, bench.road, rolling_start(car, 22.0), bench.steered, steps, 1e-3)


def bare_steps(bench: Bench, steps: int) -> None:
    """As many evaluations of its derivative, with Euler's step."""
    car = bench.scenario.vehicle
    derivatives(car, bench.road, rolling_start(car, 22.0), bench.steered, steps, np.empty(STATE_SIZE))


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
