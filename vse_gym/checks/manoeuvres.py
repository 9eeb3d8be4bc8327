"""What every manoeuvre promises."""

import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from typing import Any

import numpy as np

from vse_gym.checks.blocks import COMMON_CHECKS
from vse_gym.manoeuvres.base import Criterion, Manoeuvre, Verdict
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.parameters import Road
from vse_gym.probing import Block, contents, differences, mirror, require, who
from vse_gym.scenarios import Scenario
from vse_gym.sensors import SUITES
from vse_gym.simulation import rollout
from vse_gym.types import Car, Driver, Log

SIDES = ("side", "amplitude", "rate")  # settings whose sign may be the side; the first that may be negative is
CARS = 200  # that a driver is shown who has gone astray
BEYOND = {p.X: 500.0, p.Y: 50.0, p.YAW: 7.0, p.VX: 60.0, p.VY: 30.0, p.YAW_RATE: 5.0, p.AX: 15.0, p.AY: 15.0}  # +/-


def _driven(manoeuvre: Manoeuvre, nominal: Nominal) -> Log:
    """A whole drive with true states under stability control."""
    told = replace(nominal, speed=manoeuvre.speed)
    try:
        return rollout(Scenario(manoeuvre, nominal.vehicle, SUITES["clean"], told), "truth", "esc", 0)
    except Exception as error:
        raise AssertionError(f"{who(manoeuvre)} cannot be driven: {type(error).__name__}: {error}") from error


def check_can_be_driven(manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]) -> None:
    """A drive with true states under stability control goes to its end, or ends in a spin or off the course."""
    log = _driven(manoeuvre, nominal)
    require(len(log.time) > 1, f"{who(manoeuvre)} is over at its start ({log.ended}): begin on the course.")
    told = f"{who(manoeuvre)} ended after {log.time[-1]:.2f} s ({log.ended})"
    require(log.ended in ("", "spin", "off course"), f"{told}, expected a drive to the end, a spin or off course.")
    require(bool(np.all(np.isfinite(log.hand_wheel))), f"{who(manoeuvre)}: the hand wheel's angle is not finite.")


def check_answers_any_car(manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]) -> None:
    """For every finite state of the car, standing, backwards, spinning, far away, what the driver does is finite."""
    draw, wild = np.random.default_rng(0), [np.zeros(p.STATE_SIZE)]
    for _ in range(CARS):
        state = np.zeros(p.STATE_SIZE)
        state[list(BEYOND)] = draw.uniform(-1.0, 1.0, len(BEYOND)) * list(BEYOND.values())
        state[p.DISTANCE] = draw.uniform(0.0, 1000.0)
        state[p.WHEEL_SPEEDS] = draw.uniform(-10.0, 200.0, 4)
        wild.append(state)
    when = np.linspace(0.0, manoeuvre.duration, len(wild)).tolist()
    seen = [*cars, *map(Car, wild)]
    for k, driver in enumerate(Block(manoeuvre, nominal, [[*times, *when], seen]).drive()):
        place = f"vx, vy, yaw_rate = {seen[k].state[p.VX : p.YAW_RATE + 1].tolist()} at x, y = {seen[k].x}, {seen[k].y}"
        told = f"{who(manoeuvre)}, for {place}: {driver}"
        require(isinstance(driver, Driver), f"{told}, expected a Driver.")
        angle = np.ndim(driver.hand_wheel) == 0 and math.isfinite(driver.hand_wheel)
        require(angle, f"{told}, expected the hand wheel's angle as one finite number.")
        for torque in (driver.drive, driver.brake):
            shaped = isinstance(torque, np.ndarray) and torque.shape == (4,) and bool(np.all(np.isfinite(torque)))
            require(shaped, f"{told}, expected drive and brake torques as arrays of four finite numbers.")
        require(bool(np.all(driver.brake >= 0)), f"{told}, expected no negative brake torque.")


def check_is_the_same_to_either_side(
    manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]
) -> None:
    """With its side exchanged, the driver of a mirrored car does the mirror image, and the verdict stays.

    The side is the sign of the first setting of side, amplitude, rate that may be negative; who has none is exempt.
    """
    other = _other_side(manoeuvre)
    if other is None:
        return
    advice = "look for a wrong sign; a setting that is no side should refuse to be negative"
    drivers = Block(manoeuvre, nominal, [times, cars]).drive()
    mirrored = Block(other, nominal, [times, list(map(mirror, cars))]).drive()
    for k, (driver, got) in enumerate(zip(drivers, mirrored, strict=True)):
        for name, wanted, value in zip(Driver._fields, mirror(driver), got, strict=True):
            same = np.allclose(value, wanted, rtol=1e-9, atol=1e-9)  # the same sums, but for rounding
            told = f"{who(manoeuvre)} at {times[k]} s: {name} to the other side is {value}, expected {wanted}"
            require(same, f"{told}: {advice}.")
    kept = [_kept(m, nominal) for m in (manoeuvre, other)]
    require(
        kept[0] == kept[1], f"{who(manoeuvre)}: the verdicts of both sides differ, {kept[0]} and {kept[1]}: {advice}."
    )


def _other_side(manoeuvre: Manoeuvre) -> Manoeuvre | None:
    for name in SIDES:
        value = getattr(manoeuvre, name, None)
        if isinstance(value, int | float) and value:
            try:
                return replace(manoeuvre, **{name: -value})
            except ValueError:
                continue
    return None


def _kept(manoeuvre: Manoeuvre, nominal: Nominal) -> dict[str, bool]:
    return {c.name: c.passed for c in manoeuvre.judge(_driven(manoeuvre, nominal), nominal).criteria}


def check_road(manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]) -> None:
    """The road's segments begin at 0 m and increase; friction lies in (0, 2], slope and bank are angles."""
    road = manoeuvre.road()
    told = f"{who(manoeuvre)}.road() is {road}"
    require(isinstance(road, Road), f"{told}, expected a Road: see vse_gym.physics.parameters.road.")
    shapes = {np.shape(column) for column in road}
    require(len(shapes) == 1 and len(shapes.pop()) == 1, f"{told}, expected five arrays (segments,).")
    require(all(c.dtype == np.float64 for c in road), f"{told}, expected arrays of floats.")
    rising = road.start.size > 0 and road.start[0] == 0 and bool(np.all(np.diff(road.start) > 0))
    require(rising, f"{told}, expected segments that start at 0 m and increase.")
    for friction in (road.friction_left, road.friction_right):
        require(bool(np.all((friction > 0) & (friction <= 2))), f"{told}, expected friction in (0, 2].")
    steep = np.abs([road.slope, road.bank])
    require(bool(np.all(steep < math.pi / 2)), f"{told}, expected slope and bank as angles below 90 deg [rad].")
    again = differences(contents(road), contents(manoeuvre.road()))
    require(not again, f"{who(manoeuvre)}.road() is another one when asked again ({again}): depend on settings alone.")


def check_judges_any_drive(manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]) -> None:
    """A drive is judged however short it was; one that ended early fails, also where its last state is not finite."""
    whole = _driven(manoeuvre, nominal)
    before = contents(whole, "log")
    lost = _cut(whole, 5, "state not finite")
    lost.truth[-1] = np.nan
    drives = [
        whole,
        *(_cut(whole, rows, end) for rows in (1, 2, 10, len(whole.time) // 2) for end in ("", "spin")),
        lost,
    ]
    for log in [*drives, _cut(whole, 0, "the estimator raised")]:
        told = (
            f"{who(manoeuvre)}, a drive of {len(log.time)} instants{log.ended and f' that ended early ({log.ended})'}"
        )
        try:
            verdict = manoeuvre.judge(log, nominal)
        except Exception as error:
            advice = "give NaN for what a short drive does not show"
            raise AssertionError(f"{told}: verdict raised {type(error).__name__}: {error}; {advice}.") from error
        criteria = isinstance(verdict, Verdict) and all(isinstance(c, Criterion) for c in verdict.criteria)
        require(criteria, f"{told}, expected a Verdict of criteria, not {verdict!r:.200}")
        numbers = all(isinstance(x, int | float | np.floating) for c in verdict.criteria for x in (c.figure, c.limit))
        require(numbers, f"{told}: {verdict}, expected plain numbers as figures and limits.")
        require(not (log.ended and verdict.passed), f"{told} passes: {verdict}, expected that it fails.")
        names = [c.name for c in verdict.criteria]
        require(len(set(names)) == len(names), f"{told}: two criteria have one name, {names}.")
    require(any(c.judged for c in manoeuvre.verdict(whole, nominal).criteria), f"{who(manoeuvre)} judges nothing.")
    edited = differences(before, contents(whole, "log"))
    require(not edited, f"{who(manoeuvre)}.verdict edited the log ({edited}): work on a copy.")


def _cut(log: Log, rows: int, ended: str) -> Log:
    """The first rows of a drive, as if it had ended there."""
    arrays: dict[str, Any] = {k: v[:rows].copy() for k, v in log._asdict().items() if isinstance(v, np.ndarray)}
    return log._replace(**arrays, ended=ended)


def check_lasts_long_enough(
    manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]
) -> None:
    """A drive to the end has a figure for every criterion that is judged."""
    log = _driven(manoeuvre, nominal)
    if log.ended:
        return
    for criterion in manoeuvre.verdict(log, nominal).criteria:
        told = f"{who(manoeuvre)}, driven to its end at {log.time[-1]:.2f} s: {criterion}"
        require(not (criterion.judged and math.isnan(criterion.figure)), f"{told}, expected a figure: drive on longer.")


def check_refuses_what_cannot_be(
    manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]
) -> None:
    """A setting that is not finite, no speed, no duration, or a friction outside (0, 2] is a ValueError naming it."""
    wrong: list[tuple[str, float]] = [("speed", 0.0), ("speed", -1.0), ("duration", 0.0), ("friction", 0.0)]
    wrong += [("friction", 2.1)]
    for field in fields(manoeuvre):
        value = getattr(manoeuvre, field.name)
        if field.init and isinstance(value, int | float) and not isinstance(value, bool):
            wrong += [(field.name, math.nan), (field.name, math.inf)]
    for name, value in wrong:
        told, advice = f"{who(manoeuvre)}({name}={value})", "call super().__post_init__() and check your own settings"
        try:
            replace(manoeuvre, **{name: value})
        except ValueError as error:
            require(name in str(error), f"{told}: {error}, expected a sentence that names {name}: {advice}.")
        except Exception as error:
            raise AssertionError(f"{told} raises {type(error).__name__}, expected a ValueError: {advice}.") from error
        else:
            raise AssertionError(f"{told} is accepted, expected a ValueError: {advice}.")


def check_is_plain_tunings(manoeuvre: Manoeuvre, nominal: Nominal, times: Sequence[float], cars: Sequence[Car]) -> None:
    """A frozen dataclass of plain settings: hashable, equal to its copy from ``pickle``, made anew by ``replace``."""
    me, advice = who(manoeuvre), "keep numbers, strings and tuples as settings of a @dataclass(frozen=True)"
    require(is_dataclass(manoeuvre), f"{me} is no dataclass: {advice}.")
    makers: dict[str, Callable[[], Any]] = {
        "copied by pickle": lambda: pickle.loads(pickle.dumps(manoeuvre)),
        "made anew by dataclasses.replace": lambda: replace(manoeuvre),
    }
    for how, make in makers.items():
        try:
            same = make() == manoeuvre and hash(make()) == hash(manoeuvre)
        except Exception as error:
            raise AssertionError(f"{me} cannot be {how} and hashed ({error}): {advice}.") from error
        require(same, f"{me} {how} is another one: {advice}.")
    try:
        setattr(manoeuvre, "speed", manoeuvre.speed)  # noqa: B010 - to see that it cannot be set
    except FrozenInstanceError:
        return
    raise AssertionError(f"{me}.speed can be set after it was made: {advice}.")


MANOEUVRE_CHECKS: tuple[Callable[..., None], ...] = (
    check_is_plain_tunings,
    check_refuses_what_cannot_be,
    check_road,
    check_can_be_driven,
    check_lasts_long_enough,
    check_answers_any_car,
    check_judges_any_drive,
    check_is_the_same_to_either_side,
    *COMMON_CHECKS,
)
