"""Conformance checks: what every estimator and every controller promises, for our tests and for other packages'.

    @pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=lambda check: check.__name__)
    def test_my_estimator_keeps_its_promises(check):
        drive = example_drive()
        check(MyEstimator(), drive.nominal, drive.readings)

A check returns nothing, or raises an AssertionError that says what was expected and what to do about it. Those of an
estimator take (estimator, nominal, readings), those of a controller (controller, nominal, estimates, readings), and
those of both the one or the other.
"""

import copy
import itertools
import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vse_gym.catalogue import CONTROLLERS
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.probing import Block, contents, differences, global_generators, mirror, require, who
from vse_gym.sensors import Sensors
from vse_gym.simulation import Simulation, scenario
from vse_gym.types import (
    CHANNELS,
    U_BRAKE,
    WHEELS,
    Y_AX,
    Y_AY,
    Y_YAW_RATE,
    BrakeDemand,
    Estimate,
    Reading,
)


class Drive(NamedTuple):
    """What the checks are run on."""

    nominal: Nominal
    readings: tuple[Reading, ...]
    estimates: tuple[Estimate, ...]  # of one who knows the truth, for controllers


def example_drive(seed: int = 0, sensors: str | Sensors = "dropout") -> Drive:
    """A sine with dwell under a stability control that sees the truth: swerving, braking, silent sensors."""
    setting = scenario("sine_with_dwell", sensors=sensors)
    simulation, law = Simulation(setting, "truth"), CONTROLLERS.make("esc")
    state, frames = law.init(setting.nominal), [simulation.reset(seed)]
    while not simulation.done:
        demand, state = law.act(state, frames[-1].estimate, frames[-1].reading)
        frames.append(simulation.step(demand))
    return Drive(setting.nominal, tuple(f.reading for f in frames), tuple(f.estimate for f in frames))


# -- promises of estimators and controllers alike -------------------------------------------------------------------


def check_edits_nothing(owner: Estimator | Controller, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """Every earlier state, the readings, the estimates and ``nominal`` stay as they were."""
    block, rng, kept = Block(owner, nominal, heard), np.random.default_rng(0), []
    before = contents(nominal, "nominal") | contents(block.items, "heard")
    state = block.init(rng)
    for k, item in enumerate(block.items):
        kept.append((k, state, contents(state, "state")))
        state, _ = block.step(state, item, rng)
    edited = differences(before, contents(nominal, "nominal") | contents(block.items, "heard"))
    require(not edited, f"{who(owner)} edited what it was given ({edited}): work on a copy.")
    for k, old, facts in kept:
        edited = differences(facts, contents(old, "state"))
        advice = "hand back a new state, with copies of the arrays that change"
        require(not edited, f"{who(owner)} edited an old state, the one before reading {k} ({edited}): {advice}.")


def check_keeps_itself(owner: Estimator | Controller, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """The instance is the same after use as before, and two drives at once do not disturb each other."""
    block, before = Block(owner, nominal, heard), contents(owner, "self")
    alone = block.drive()
    edited = differences(before, contents(owner, "self"))
    advice = "an instance is a frozen set of tunings; what changes over time travels in the state"
    require(not edited, f"{who(owner)} changed itself in use ({edited}): {advice}.")
    generators, together = [np.random.default_rng(0), np.random.default_rng(1)], []
    states = [block.init(rng) for rng in generators]
    for item, other in zip(block.items, map(mirror, block.items), strict=True):
        states[0], output = block.step(states[0], item, generators[0])
        states[1], _ = block.step(states[1], other, generators[1])
        together.append(output)
    differ = differences(contents(alone, "output"), contents(together, "output"))
    require(not differ, f"{who(owner)} mixes two drives that go on at once ({differ}): {advice}.")


def check_repeats_itself(owner: Estimator | Controller, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """The same drive and the same seed of ``rng`` give the same bits; global generators are left alone."""
    block = Block(owner, nominal, heard)
    before = global_generators()
    differ = differences(contents(block.drive(), "output"), contents(block.drive(), "output"))
    advice = "draw random numbers from rng alone"
    require(not differ, f"{who(owner)} gave two results for one drive and one seed ({differ}): {advice}.")
    differ = differences(before, global_generators())
    require(not differ, f"{who(owner)} drew from a global generator, or seeded it: {advice}.")


def check_can_be_saved(owner: Estimator | Controller, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """A state that went through ``pickle`` or ``copy.deepcopy`` goes on bit by bit like the original."""
    block, rng = Block(owner, nominal, heard), np.random.default_rng(0)
    state, half = block.init(rng), len(block.items) // 2
    for item in block.items[:half]:
        state, _ = block.step(state, item, rng)
    for way in (copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))):
        try:
            again = way(state)
        except Exception as error:
            raise AssertionError(
                f"{who(owner)}: its state cannot be copied ({error}): keep plain data in it"
            ) from error
        futures = [block.go_on(s, block.items[half:], copy.deepcopy(rng)) for s in (state, again)]
        differ = differences(*(contents(outputs, "output") for outputs in futures))
        advice = "all that the next step needs must be in the state"
        require(not differ, f"{who(owner)} goes on differently from a copy of its state ({differ}): {advice}.")


def check_is_symmetric(owner: Estimator | Controller, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """A mirrored drive has the mirrored result. Who draws random numbers is exempt: the draws are not mirrored.

    To 1e-6: the same sums in another order differ by 1e-16, enlarged to 1e-10 by difference quotients and a little
    more by a car near its limit.
    """
    block, rng = Block(owner, nominal, heard), np.random.default_rng(0)
    fresh = contents(rng)
    outputs = block.drive(rng=rng)
    if contents(rng) != fresh:
        return
    advice = "look for a wrong sign, or for a left wheel where the right one is meant"
    for k, (output, other) in enumerate(zip(outputs, block.drive([mirror(i) for i in block.items]), strict=True)):
        for name, wanted, got in zip(output._fields, mirror(output), other, strict=True):
            same = np.allclose(got, wanted, rtol=1e-6, atol=1e-6, equal_nan=True)
            require(
                same, f"{who(owner)}, reading {k}: {name} of the mirrored drive is {got}, expected {wanted}: {advice}."
            )


COMMON_CHECKS: tuple[Callable[..., None], ...] = (
    check_edits_nothing,
    check_keeps_itself,
    check_repeats_itself,
    check_can_be_saved,
    check_is_symmetric,
)


# -- promises of estimators -----------------------------------------------------------------------------------------


def check_follows_a_drive(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """After every reading of a drive there is an Estimate, and its vx and vy are finite."""
    _stays_finite(estimator, nominal, readings, "on an ordinary drive")


def check_survives_silence(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """With every sensor silent for 1 s, from the first reading on or amid a drive, the estimate stays finite."""
    for begin in (0, len(readings) // 4):
        silent = copy.deepcopy(list(readings))
        for reading in silent[begin : begin + round(1 / nominal.dt)]:
            reading.y[:] = np.nan
        _stays_finite(estimator, nominal, silent, f"with all sensors silent from reading {begin} on")


def check_survives_a_dropout(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """With any one sensor silent for 0.2 s, from the first reading on and amid a drive, the estimate stays finite."""
    length = round(0.2 / nominal.dt)
    for channel, name in enumerate(CHANNELS):
        partly = copy.deepcopy(list(readings[: len(readings) // 2]))
        for reading in partly[:length] + partly[len(partly) // 2 :][:length]:
            reading.y[channel] = np.nan
        _stays_finite(estimator, nominal, partly, f"with {name} silent for {length} readings")


def check_survives_outliers(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """Readings of 20 m/s2, 100 deg/s and locked wheels, one alone and 0.5 s long, leave the estimate finite."""
    wild = copy.deepcopy(list(readings))
    length, middle = round(0.5 / nominal.dt), len(wild) // 4
    for k in (middle // 2, *range(middle, middle + length)):
        sign = 1.0 if k // 10 % 2 == 0 else -1.0
        wild[k].y[[Y_AX, Y_AY, Y_YAW_RATE]] = -20.0 * sign, 20.0 * sign, math.radians(100) * sign
        wild[k].y[WHEELS] = 0.0
        wild[k].inputs[U_BRAKE : U_BRAKE + 4] = nominal.vehicle.brake_caps
    _stays_finite(estimator, nominal, wild, "after wild outliers")


def check_stands_still(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """A car that stands, its brakes off and on, every reading zero, has a finite estimate."""
    still = [r._replace(inputs=np.zeros_like(r.inputs), y=np.zeros_like(r.y)) for r in readings]
    for reading in still[len(still) // 2 :]:
        reading.inputs[U_BRAKE : U_BRAKE + 4] = nominal.vehicle.brake_caps
    _stays_finite(estimator, replace(nominal, speed=0.0), still, "of a standing car")


def _stays_finite(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading], when: str) -> None:
    for k, estimate in enumerate(Block(estimator, nominal, [readings]).drive()):
        told = f"{who(estimator)} {when}, after reading {k}: {estimate!s:.300}"
        require(isinstance(estimate, Estimate), f"{told}, expected an Estimate.")
        numbers = [value for name, value in estimate._asdict().items() if name != "cov"]
        require(all(np.ndim(value) == 0 for value in numbers), f"{told}, expected plain floats beside cov.")
        advice = "leave silent channels out, and divide by nothing that may be zero"
        finite = math.isfinite(estimate.vx) and math.isfinite(estimate.vy)
        require(finite, f"{told}, expected finite vx and vy: {advice}.")
        require(not any(math.isinf(v) for v in numbers), f"{told}, expected no infinity; unknown is NaN: {advice}.")


def check_covariance(estimator: Estimator, nominal: Nominal, readings: Sequence[Reading]) -> None:
    """``cov`` is (3, 3) and, where it is not NaN, symmetric and positive semi-definite, to rounding (1e-9)."""
    for k, estimate in enumerate(Block(estimator, nominal, [readings]).drive()):
        told = f"{who(estimator)}, after reading {k}: cov of vx, vy, yaw_rate is {np.asarray(estimate.cov).tolist()}"
        require(np.shape(estimate.cov) == (3, 3), f"{told}, expected shape (3, 3), NaN where unknown.")
        known = ~np.isnan(np.diag(estimate.cov))
        cov = estimate.cov[np.ix_(known, known)]
        small = 1e-9 * np.max(np.abs(cov), initial=0.0)
        require(bool(np.all(np.isfinite(cov))), f"{told}, expected finite numbers beside a finite variance.")
        require(bool(np.all(np.abs(cov - cov.T) <= small)), f"{told}, expected symmetry: hand out (P + P^T)/2.")
        lowest = np.min(np.linalg.eigvalsh(cov), initial=0.0)
        require(bool(lowest >= -small), f"{told}, expected no negative eigenvalue, not {lowest}: use Joseph's form.")


ESTIMATOR_CHECKS: tuple[Callable[..., None], ...] = (
    check_follows_a_drive,
    check_survives_silence,
    check_survives_a_dropout,
    check_survives_outliers,
    check_stands_still,
    check_covariance,
    *COMMON_CHECKS,
)


# -- promises of controllers ----------------------------------------------------------------------------------------


def check_demand_is_feasible(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    """On a drive ``added`` lies between 0 and the brakes' caps, and ``release`` in [0, 1], as float arrays (4,)."""
    _is_feasible(controller, nominal, estimates, readings)


def check_answers_any_estimate(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    """The demand stays feasible for every finite estimate, however wild: standing, backwards, spinning."""
    extremes = itertools.product((0.0, -5.0, 1e-9, 80.0), (0.0, 40.0, -40.0), (0.0, 5.0, -5.0), (0.0, 30.0, -30.0))
    wild = [Estimate(vx, vy, yaw_rate, 0.0, ay) for vx, vy, yaw_rate, ay in extremes]
    _is_feasible(controller, nominal, wild, list(itertools.islice(itertools.cycle(readings), len(wild))))


def _is_feasible(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    for k, demand in enumerate(Block(controller, nominal, [estimates, readings]).drive()):
        told = f"{who(controller)}, for vx, vy, yaw_rate, ax, ay = {estimates[k][:5]}: {demand}"
        require(isinstance(demand, BrakeDemand), f"{told}, expected a BrakeDemand.")
        for array in demand:
            shaped = isinstance(array, np.ndarray) and array.shape == (4,) and array.dtype == np.float64
            require(shaped, f"{told}, expected arrays of four floats.")
        caps = nominal.vehicle.brake_caps
        within = bool(np.all((demand.added >= 0) & (demand.added <= caps * (1 + 1e-12))))
        require(within, f"{told}, expected added between 0 and the caps {caps}: clip it.")
        within = bool(np.all((demand.release >= 0) & (demand.release <= 1)))
        require(within, f"{told}, expected release in [0, 1]: clip it.")


def check_leaves_straight_driving_alone(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    """Going straight at any speed, undisturbed, nothing is braked and nothing released."""
    for speed in (0.0, 1.0, 10.0, nominal.speed, 60.0):
        y = np.zeros(len(CHANNELS))
        y[WHEELS] = speed / nominal.vehicle.wheel_radius
        straight = [Reading(k * nominal.dt, np.zeros(9), y) for k in range(round(2 / nominal.dt))]
        seen = [Estimate(speed, 0.0, 0.0, 0.0, 0.0)] * len(straight)
        for demand in Block(controller, nominal, [seen, straight]).drive():
            told = f"{who(controller)} asks for {demand} going straight at {speed} m/s"
            require(not (demand.added.any() or demand.release.any()), f"{told}, expected nothing: add a dead band.")


CONTROLLER_CHECKS: tuple[Callable[..., None], ...] = (
    check_demand_is_feasible,
    check_answers_any_estimate,
    check_leaves_straight_driving_alone,
    *COMMON_CHECKS,
)
