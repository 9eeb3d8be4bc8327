"""Conformance checks: what every estimator and every controller promises, for our tests and for other packages'.

    @pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=lambda check: check.__name__)
    def test_my_estimator_keeps_its_promises(check):
        drive = example_drive()
        check(MyEstimator(), drive.nominal, drive.readings)

A check returns nothing, or raises an AssertionError that says what was expected and what to do about it.
"""

import copy
import itertools
import math
import pickle
import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from vse_gym.catalogue import CONTROLLERS
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.sensors import Sensors
from vse_gym.simulation import Simulation, scenario
from vse_gym.types import CHANNELS, U_BRAKE, U_STEER, Y_AX, Y_AY, Y_WHEEL, Y_YAW_RATE, Estimate, Reading

# Mirrored and straight drives do the same sums in another order. Their rounding, 1e-16, is enlarged to 1e-10 by the
# difference quotients of an extended Kalman filter and a little more by a car near its limit.
MIRROR_TOLERANCE = 1e-6
SWAPPED = [1, 0, 3, 2]  # the wheels of a mirrored car
ODD = ("vy", "yaw_rate", "ay", "roll", "roll_rate")  # fields of an estimate that change sign in a mirror


class Drive(NamedTuple):
    """What the checks are run on."""

    nominal: Nominal
    readings: tuple[Reading, ...]
    estimates: tuple[Estimate, ...]  # of one who knows the truth, for controllers


def example_drive(seed: int = 0, sensors: str | Sensors = "dropout") -> Drive:
    """A sine with dwell under stability control that sees the truth: swerving, braking, silent sensors."""
    setting = scenario("sine_with_dwell", sensors=sensors)
    simulation, law = Simulation(setting, "truth"), CONTROLLERS.make("esc")
    state, frames = law.init(setting.nominal), [simulation.reset(seed)]
    while not simulation.done:
        demand, state = law.act(state, frames[-1].estimate, frames[-1].reading)
        frames.append(simulation.step(demand))
    return Drive(setting.nominal, tuple(f.reading for f in frames), tuple(f.estimate for f in frames))


# -- promises of estimators and controllers alike -------------------------------------------------------------------


class _Block(NamedTuple):
    """An estimator or a controller, seen alike."""

    owner: Estimator | Controller
    nominal: Nominal
    init: Callable[[np.random.Generator], Any]
    step: Callable[[Any, Any, np.random.Generator], tuple[Any, Any]]  # state, item, rng to state, output
    items: list[Any]  # fed one by one; copies, so that who edits them spoils no other check
    mirrored: list[Any]


def _estimator(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> _Block:
    def step(state: Any, reading: Reading, rng: np.random.Generator) -> tuple[Any, Estimate]:
        if estimator.told_friction:
            state = estimator.tell_friction(state, nominal.friction)
        state = estimator.update(state, reading, rng)
        return state, estimator.estimate(state)

    copies, mirrored = copy.deepcopy(list(readings)), [_mirror_reading(r) for r in readings]
    return _Block(estimator, nominal, lambda rng: estimator.init(nominal, rng), step, copies, mirrored)


def _controller(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> _Block:
    def step(state: Any, seen: tuple[Estimate, Reading], rng: np.random.Generator) -> tuple[Any, Any]:
        demand, state = controller.act(state, *seen)
        return state, demand

    pairs = list(zip(estimates, readings, strict=True))
    mirrored = [(_mirror_estimate(e), _mirror_reading(r)) for e, r in pairs]
    return _Block(controller, nominal, lambda rng: controller.init(nominal), step, copy.deepcopy(pairs), mirrored)


def _require(promised: bool, broken: str) -> None:
    if not promised:
        raise AssertionError(broken)


def _run(block: _Block, items: Sequence[Any], seed: int = 0) -> list[Any]:
    rng = np.random.default_rng(seed)
    state, outputs = block.init(rng), []
    for item in items:
        state, output = block.step(state, item, rng)
        outputs.append(output)
    return outputs


def _facts(thing: Any, where: str = "it", found: dict[str, Any] | None = None) -> dict[str, Any]:
    """Everything that an object holds, bit by bit, each with its path; walks what pickle would store."""
    facts: dict[str, Any] = {} if found is None else found
    if thing is None or isinstance(thing, type | FunctionType | BuiltinFunctionType | ModuleType):
        facts[where] = thing
    elif isinstance(thing, bool | int | float | complex | str | bytes | np.generic):
        facts[where] = repr(thing)
    elif isinstance(thing, np.ndarray) and thing.dtype != object:
        facts[where] = thing.dtype.str, thing.shape, thing.tobytes()
    elif isinstance(thing, dict):
        facts[where] = type(thing), len(thing)
        for key, value in thing.items():
            _facts(value, f"{where}[{key!r}]", facts)
    elif isinstance(thing, tuple | list):
        facts[where] = type(thing), len(thing)
        for key, value in zip(getattr(thing, "_fields", itertools.count()), thing, strict=False):
            _facts(value, f"{where}.{key}", facts)
    else:
        try:
            parts = thing.__reduce_ex__(4)
        except Exception as error:
            raise AssertionError(
                f"{where}, a {type(thing).__name__}, cannot be pickled: {error}. Keep what can."
            ) from error
        facts[where] = type(thing)
        for key, part in enumerate([parts] if isinstance(parts, str) else parts):
            if isinstance(part, dict):  # of attributes
                for name, value in part.items():
                    _facts(value, f"{where}.{name}", facts)
            elif part is not None:
                _facts(part if key < 3 else list(part), f"{where}~{key}", facts)
    return facts


def _changed(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    return sorted(path for path in before.keys() | after.keys() if before.get(path) != after.get(path))


def _edits_nothing(block: _Block) -> None:
    rng, kept = np.random.default_rng(0), []
    state = block.init(rng)
    told = _facts(block.nominal, "nominal")
    for k, item in enumerate(block.items):
        if k % 10 == 0:
            kept.append((k, state, _facts(state, "state")))
        before = _facts(item, "what it was given")
        state, output = block.step(state, item, rng)
        edited = _changed(before, _facts(item, "what it was given"))
        _require(not edited, f"{block.owner} edited {', '.join(edited)}: copy what you change.")
    _require(not _changed(told, _facts(block.nominal, "nominal")), f"{block.owner} edited nominal: copy it.")
    for k, old, facts in kept:
        edited = _changed(facts, _facts(old, "state"))
        advice = "a state that was handed over stays as it is: return a new one, with copies of the arrays you change"
        _require(not edited, f"{block.owner} later edited its state before step {k}, {', '.join(edited)}: {advice}.")


def _keeps_itself(block: _Block) -> None:
    before = _facts(block.owner, "self")
    alone = _facts(_run(block, block.items))
    edited = _changed(before, _facts(block.owner, "self"))
    advice = "tunings are frozen; what changes over time travels in the state"
    _require(not edited, f"using {block.owner} changed {', '.join(edited)}: {advice}.")
    generators = np.random.default_rng(0), np.random.default_rng(1)
    states, outputs = [block.init(rng) for rng in generators], []
    for item, other in zip(block.items, block.mirrored, strict=True):
        states[0], output = block.step(states[0], item, generators[0])
        states[1], _ = block.step(states[1], other, generators[1])
        outputs.append(output)
    differ = _changed(alone, _facts(outputs))
    _require(not differ, f"two drives at once disturb each other in {block.owner} ({differ[:1]}): {advice}.")


def _repeats_itself(block: _Block) -> None:
    ours = random.getstate(), _facts(np.random.get_state(legacy=False))
    first, second = _facts(_run(block, block.items)), _facts(_run(block, block.items))
    differ = _changed(first, second)
    advice = "draw random numbers from rng alone"
    _require(not differ, f"the same drive and seed gave {block.owner} another result ({differ[:1]}): {advice}.")
    same = ours == (random.getstate(), _facts(np.random.get_state(legacy=False)))
    _require(same, f"{block.owner} used or seeded a global generator: {advice}.")


def _can_be_saved(block: _Block) -> None:
    half = len(block.items) // 2
    rng = np.random.default_rng(0)
    state = block.init(rng)
    for item in block.items[:half]:
        state, _ = block.step(state, item, rng)
    for how, again in (("copy.deepcopy", copy.deepcopy), ("pickle", lambda thing: pickle.loads(pickle.dumps(thing)))):
        try:
            branches = [(state, copy.deepcopy(rng)), (again(state), copy.deepcopy(rng))]
        except Exception as error:
            raise AssertionError(f"{how} of the state of {block.owner} failed: {error}. Keep plain data.") from error
        futures = []
        for branch, generator in branches:
            outputs = []
            for item in block.items[half : half + 100]:
                branch, output = block.step(branch, item, generator)
                outputs.append(output)
            futures.append(_facts(outputs))
        differ = _changed(*futures)
        advice = "all that matters must be in the state"
        _require(not differ, f"after {how} {block.owner} goes on differently ({differ[:1]}): {advice}.")


# -- estimators -----------------------------------------------------------------------------------------------------


def check_estimator_follows_a_drive(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """After every reading of a drive there is an Estimate whose vx and vy are finite."""
    _stays_finite(_estimator(estimator, nominal, readings), "on an ordinary drive")


def check_estimator_edits_nothing(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """``update`` and ``estimate`` leave every earlier state, the reading and ``nominal`` as they were."""
    _edits_nothing(_estimator(estimator, nominal, readings))


def check_estimator_keeps_itself(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """The instance is the same after use as before, and two drives at once do not disturb each other."""
    _keeps_itself(_estimator(estimator, nominal, readings))


def check_estimator_repeats_itself(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """The same readings and the same seed of ``rng`` give the same bits; global generators are left alone."""
    _repeats_itself(_estimator(estimator, nominal, readings))


def check_estimator_can_be_saved(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """A state that went through ``pickle`` or ``copy.deepcopy`` goes on bit by bit like the original."""
    _can_be_saved(_estimator(estimator, nominal, readings))


def check_estimator_survives_silence(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """With every sensor silent for 1 s, from the first reading or amid a drive, the estimate stays finite."""
    second = round(1 / nominal.dt)
    for begin in (0, len(readings) // 4):
        silent = list(readings)
        for k in range(begin, min(begin + second, len(silent))):
            silent[k] = silent[k]._replace(y=np.full(len(CHANNELS), np.nan))
        _stays_finite(_estimator(estimator, nominal, silent), f"with all sensors silent from reading {begin} on")


def check_estimator_survives_a_dropout(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """With any one sensor silent for 0.2 s, from the first reading or amid a drive, the estimate stays finite."""
    length = round(0.2 / nominal.dt)
    for channel, name in enumerate(CHANNELS):
        partly = copy.deepcopy(list(readings[: len(readings) // 2]))
        for begin in (0, len(readings) // 4):
            for reading in partly[begin : begin + length]:
                reading.y[channel] = np.nan
        _stays_finite(_estimator(estimator, nominal, partly), f"with {name} silent for {length} readings")


def check_estimator_survives_outliers(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """Readings of 20 m/s2, 100 deg/s and locked wheels, one alone and 0.5 s long, leave the estimate finite."""
    wild = copy.deepcopy(list(readings))
    middle, length = len(wild) // 4, round(0.5 / nominal.dt)
    for k in (length, *range(middle, middle + length)):
        sign = 1.0 if k // 10 % 2 == 0 else -1.0
        wild[k].y[[Y_AX, Y_AY, Y_YAW_RATE]] = -20.0 * sign, 20.0 * sign, math.radians(100) * sign
        wild[k].y[Y_WHEEL:] = 0.0
        wild[k].inputs[U_BRAKE : U_BRAKE + 4] = nominal.vehicle.brake_caps
    _stays_finite(_estimator(estimator, nominal, wild), "after wild outliers")


def check_estimator_stands_still(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """A car that stands, with and without its brakes on, every reading zero, has a finite estimate."""
    standing = replace(nominal, speed=0.0)
    held = np.zeros_like(readings[0].inputs)
    held[U_BRAKE : U_BRAKE + 4] = 500.0
    still = [r._replace(inputs=np.zeros_like(r.inputs), y=np.zeros_like(r.y)) for r in readings]
    braked = [r._replace(inputs=held.copy()) for r in still]
    _stays_finite(
        _estimator(estimator, standing, (still + braked)[:: 2 if len(still) > 500 else 1]), "of a standing car"
    )


def check_estimator_covariance(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """``cov`` is (3, 3) and, where it is not NaN, symmetric and positive semi-definite."""
    block = _estimator(estimator, nominal, readings)
    for k, estimate in enumerate(_run(block, block.items)):
        cov = np.asarray(estimate.cov)
        _require(cov.shape == (3, 3), f"{estimator}: cov has shape {cov.shape}, expected (3, 3): vx, vy, yaw_rate.")
        known = ~np.isnan(np.diag(cov))
        part = cov[np.ix_(known, known)]
        small = 1e-9 * np.max(np.abs(part), initial=0.0)  # rounding of a sum that should be symmetric
        told = f"{estimator}: cov after reading {k} is {part.tolist()}"
        _require(bool(np.all(np.isfinite(part))), f"{told}, expected finite, or NaN where unknown.")
        _require(bool(np.all(np.abs(part - part.T) <= small)), f"{told}, expected symmetric: take (P + P^T)/2.")
        lowest = np.min(np.linalg.eigvalsh(part), initial=0.0)
        _require(lowest >= -small, f"{told}, eigenvalue {lowest}, expected none below zero: use Joseph's form.")


def check_estimator_is_symmetric(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """A mirrored drive has the mirrored estimate. Who draws random numbers is exempt: the draws are not mirrored."""
    block = _estimator(estimator, nominal, readings)
    rng = np.random.default_rng(0)
    fresh, state = _facts(rng), block.init(rng)
    for item in block.items[:10]:
        state, _ = block.step(state, item, rng)
    if _facts(rng) != fresh:
        return
    for k, (one, other) in enumerate(zip(_run(block, block.items), _run(block, block.mirrored), strict=True)):
        wanted = _mirror_estimate(one)
        for name in Estimate._fields:
            a, b = np.asarray(getattr(other, name)), np.asarray(getattr(wanted, name))
            same = np.allclose(a, b, rtol=MIRROR_TOLERANCE, atol=MIRROR_TOLERANCE, equal_nan=True)
            _require(same, f"{estimator}: after reading {k} of a mirrored drive {name} is {a}, expected {b}: {LOOK}.")


LOOK = "look for a wrong sign, or a left wheel where a right one is meant"


def _stays_finite(block: _Block, when: str) -> None:
    for k, estimate in enumerate(_run(block, block.items)):
        told = f"{block.owner} {when}, reading {k}"
        _require(isinstance(estimate, Estimate), f"{told}: got a {type(estimate).__name__}, expected an Estimate.")
        numbers = [value for name, value in estimate._asdict().items() if name != "cov"]
        _require(all(np.ndim(value) == 0 for value in numbers), f"{told}: {estimate}, expected plain floats.")
        finite = math.isfinite(estimate.vx) and math.isfinite(estimate.vy)
        advice = "leave silent channels out, bound what a reading may do, divide by nothing that may be zero"
        _require(finite, f"{told}: vx {estimate.vx}, vy {estimate.vy}, expected finite: {advice}.")
        _require(not any(math.isinf(v) for v in numbers), f"{told}: {estimate}, expected no infinity; NaN is unknown.")


def _mirror_reading(reading: Reading) -> Reading:
    u, y = reading.inputs.copy(), reading.y.copy()
    u[U_STEER] *= -1
    u[1:] = u[1:].reshape(2, 4)[:, SWAPPED].ravel()  # brake and drive torques
    y[[Y_AY, Y_YAW_RATE]] *= -1
    y[Y_WHEEL:] = y[Y_WHEEL:][SWAPPED]
    return Reading(reading.time, u, y)


def _mirror_estimate(estimate: Estimate) -> Estimate:
    signs = np.array([1.0, -1.0, -1.0])
    odd: dict[str, float] = {name: -getattr(estimate, name) for name in ODD}
    return estimate._replace(cov=estimate.cov * np.outer(signs, signs), **odd)  # type: ignore[arg-type]


ESTIMATOR_CHECKS: tuple[Callable[[Estimator, Nominal, Sequence[Reading]], None], ...] = (
    check_estimator_follows_a_drive,
    check_estimator_edits_nothing,
    check_estimator_keeps_itself,
    check_estimator_repeats_itself,
    check_estimator_can_be_saved,
    check_estimator_survives_silence,
    check_estimator_survives_a_dropout,
    check_estimator_survives_outliers,
    check_estimator_stands_still,
    check_estimator_covariance,
    check_estimator_is_symmetric,
)
