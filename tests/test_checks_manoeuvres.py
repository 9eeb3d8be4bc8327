"""Every manoeuvre of the catalogue keeps the published promises, and the checks catch who does not."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from vse_gym import testing
from vse_gym.catalogue import MANOEUVRES
from vse_gym.manoeuvres.base import Criterion, Manoeuvre, Verdict
from vse_gym.manoeuvres.path import Line
from vse_gym.manoeuvres.script import FOLLOW, TURN_TO, ramp, script_of
from vse_gym.manoeuvres.scripted import Bounds, Scripted
from vse_gym.physics import parameters as p
from vse_gym.physics.parameters import Road
from vse_gym.testing import MANOEUVRE_CHECKS
from vse_gym.types import Driver


def name_of(check):
    return check.__name__


@pytest.mark.parametrize("check", MANOEUVRE_CHECKS, ids=name_of)
@pytest.mark.parametrize("name", MANOEUVRES)
def test_a_manoeuvre_keeps_its_promises(name, check, nominal, drive):
    check(MANOEUVRES.make(name), nominal, drive.times, drive.cars)


# -- who breaks a promise is caught ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Swerve(Manoeuvre):
    """Keeps every promise: steers towards a line beside the lane. Those below each break one."""

    duration: float = 1.5
    amplitude: float = 1.0  # of the hand wheel; positive: to the left [rad]

    def init(self, nominal):
        return np.zeros(2)

    def drive(self, state, time, car):
        angle = self.amplitude * math.tanh(math.copysign(1.0, self.amplitude) * 2.0 - car.y) * math.tanh(5 * time)
        return Driver(angle * math.copysign(1.0, self.amplitude)), np.array([time, angle])

    def verdict(self, log, nominal):
        return Verdict((Criterion("went aside", float(np.max(np.abs(log.truth[:, p.Y]))), 0.1, "m", at_least=True),))


class Crashes(Swerve):
    def drive(self, state, time, car):
        return Driver(1 / (time - 0.5)), state


class GivesUp(Swerve):
    def drive(self, state, time, car):
        return Driver(math.nan if time > 1 else 0.0), state


class BeginsBesideTheRoad(Swerve):
    def off_course(self, car, vehicle):
        return True


class DividesBySpeed(Swerve):
    def drive(self, state, time, car):
        return Driver(car.y / np.float64(car.vx) if car.vx else math.inf), state


class ReadsASquareRoot(Swerve):
    def drive(self, state, time, car):
        return Driver(math.sqrt(car.vx) if car.vx > 0 else math.nan), state


class DrivesWithOneTorque(Swerve):
    def drive(self, state, time, car):
        return Driver(0.0, np.zeros(4), 100.0), state


class HandsOutATuple(Swerve):
    def drive(self, state, time, car):
        return (0.0, np.zeros(4), np.zeros(4)), state


class PushesWithTheBrakes(Swerve):
    def drive(self, state, time, car):
        return Driver(0.0, np.zeros(4), np.full(4, -1.0)), state


class PullsToTheLeft(Swerve):
    def drive(self, state, time, car):
        driver, state = super().drive(state, time, car)
        return driver._replace(hand_wheel=driver.hand_wheel + 0.1), state


class JudgesTheLeftOnly(Swerve):
    def verdict(self, log, nominal):
        return Verdict((Criterion("went aside", float(log.truth[-1, p.Y]), 0.1, "m", at_least=True),))


class EditsItsState(Swerve):
    def drive(self, state, time, car):
        state[0] = time
        return Driver(0.1 * time), state


class EditsTheCar(Swerve):
    def drive(self, state, time, car):
        car.state[p.YAW] %= math.pi
        car.state[p.Y] += 0.1
        return Driver(0.1 * time), state


class CountsInItself(Swerve):
    def __post_init__(self):
        object.__setattr__(self, "calls", [])

    def drive(self, state, time, car):
        self.calls.append(time)
        return Driver(0.1 * time), state


class RollsDice(Swerve):
    def drive(self, state, time, car):
        return Driver(float(np.random.default_rng().standard_normal())), state


class CannotBeSaved(Swerve):
    def init(self, nominal):
        return (angle for angle in (0.1, 0.2))

    def drive(self, state, time, car):
        return Driver(0.1 * time), state


class RoadFromAnywhere(Swerve):
    def road(self):
        return super().road()._replace(start=np.array([10.0]))


class IceBeyondImagination(Swerve):
    def road(self):
        return super().road()._replace(friction_right=np.array([0.0]))


class RoadOfTwoLengths(Swerve):
    def road(self):
        return Road(np.zeros(1), np.ones(2), np.ones(2), np.zeros(2), np.zeros(2))


class RoadInDegrees(Swerve):
    def road(self):
        return super().road()._replace(bank=np.array([5.0]))


class AnotherRoadEachTime(Swerve):
    def road(self):
        return super().road()._replace(slope=np.random.default_rng().normal(0, 0.01, 1))


class JudgesTheLastInstant(Swerve):
    def verdict(self, log, nominal):
        k = int(np.nonzero(log.time > 1)[0][0])
        return Verdict((Criterion("went aside", float(log.truth[k, p.Y]), 0.1, "m", at_least=True),))


class PraisesWhoEndedEarly(Swerve):
    def judge(self, log, nominal):
        return Verdict((Criterion("took part", 1.0, 1.0, "-"),))


class RefusesNothing(Swerve):
    def __post_init__(self):
        pass


class RefusesWithoutAName(Swerve):
    def __post_init__(self):
        if not (self.amplitude < 10 and 0 < self.speed < 100 and 0 < self.duration < 100 and 0 < self.friction < 2):
            raise ValueError("something is wrong")


class JudgesNothing(Swerve):
    def verdict(self, log, nominal):
        return Verdict(super().verdict(log, nominal).criteria[:0])


class SaysTwoThingsOfOneName(Swerve):
    def verdict(self, log, nominal):
        return Verdict(2 * super().verdict(log, nominal).criteria)


class HandsOutABoolean(Swerve):
    def verdict(self, log, nominal):
        return True

    def judge(self, log, nominal):
        return len(log.time) > 100


class EditsTheLog(Swerve):
    def verdict(self, log, nominal):
        log.truth[:, p.Y] -= log.truth[0, p.Y] - 1e-3
        return super().verdict(log, nominal)


class EndsBeforeItIsJudged(Swerve):
    def verdict(self, log, nominal):
        shift = float(np.interp(2.0, log.time, log.truth[:, p.Y], right=np.nan))
        return Verdict((Criterion("went aside", shift, 0.1, "m", at_least=True),))


@dataclass(frozen=True)
class HoldsAList(Swerve):
    cones: list = field(default_factory=list)

    def __post_init__(self):
        pass


class IsNoLongerFrozen(Swerve):
    def __setattr__(self, name, value):
        object.__setattr__(self, name, value)


class NeverTheSame(Swerve):
    def __hash__(self):
        return id(self)


BROKEN_MANOEUVRES = [
    (Crashes, "can_be_driven", "ZeroDivisionError"),
    (GivesUp, "can_be_driven", "four finite numbers|finite"),
    (BeginsBesideTheRoad, "can_be_driven", "begin on the course"),
    (DividesBySpeed, "answers_any_car", "one finite number"),
    (ReadsASquareRoot, "answers_any_car", "one finite number"),
    (DrivesWithOneTorque, "answers_any_car", "arrays of four"),
    (HandsOutATuple, "answers_any_car", "expected a Driver"),
    (PushesWithTheBrakes, "answers_any_car", "no negative brake"),
    (PullsToTheLeft, "is_the_same_to_either_side", "hand_wheel to the other side"),
    (JudgesTheLeftOnly, "is_the_same_to_either_side", "verdicts of both sides"),
    (EditsItsState, "edits_nothing", "an old state"),
    (EditsTheCar, "edits_nothing", "what it was given"),
    (CountsInItself, "keeps_itself", "changed itself in use"),
    (RollsDice, "repeats_itself", "two results"),
    (CannotBeSaved, "can_be_saved", "keep plain data"),
    (RoadFromAnywhere, "road", "start at 0 m"),
    (IceBeyondImagination, "road", r"friction in \(0, 2\]"),
    (RoadOfTwoLengths, "road", "five arrays"),
    (RoadInDegrees, "road", "below 90 deg"),
    (AnotherRoadEachTime, "road", "settings alone"),
    (JudgesTheLastInstant, "judges_any_drive", "verdict raised IndexError"),
    (PraisesWhoEndedEarly, "judges_any_drive", "expected that it fails"),
    (JudgesNothing, "judges_any_drive", "judges nothing"),
    (SaysTwoThingsOfOneName, "judges_any_drive", "have one name"),
    (HandsOutABoolean, "judges_any_drive", "expected a Verdict"),
    (EditsTheLog, "judges_any_drive", "edited the log"),
    (EndsBeforeItIsJudged, "lasts_long_enough", "drive on longer"),
    (RefusesNothing, "refuses_what_cannot_be", "is accepted"),
    (RefusesWithoutAName, "refuses_what_cannot_be", "names speed"),
    (HoldsAList, "is_plain_tunings", "unhashable"),
    (IsNoLongerFrozen, "is_plain_tunings", "can be set"),
    (NeverTheSame, "is_plain_tunings", "is another one"),
]


@dataclass(frozen=True)
class Settles(Scripted):
    """Keeps every promise in compiled code: turns the hand wheel and lets go, then follows a line beside the lane."""

    duration: float = 2.5
    amplitude: float = 0.3  # of the hand wheel; positive: to the left [rad]

    def script(self, times):
        hands = np.where(times < 0.5, TURN_TO, FOLLOW)
        return script_of(times, hands, ramp(times, self.amplitude, 2.0, 0.1), self.speed)

    def path(self, vehicle):
        return Line(((10.0, 30.0, math.copysign(1.0, self.amplitude)),))

    def bounds(self, vehicle):
        return Bounds(self.path(vehicle), 3.0)

    verdict = Swerve.verdict


@pytest.mark.parametrize("check", MANOEUVRE_CHECKS, ids=name_of)
@pytest.mark.parametrize("honest", [Swerve(), Settles()], ids=["by Python", "by script"])
def test_an_honest_manoeuvre_from_outside_passes(honest, check, nominal, drive):
    check(honest, nominal, drive.times, drive.cars)


@pytest.mark.parametrize(
    ("broken", "promise", "told"), BROKEN_MANOEUVRES, ids=[b[0].__name__ for b in BROKEN_MANOEUVRES]
)
def test_a_check_catches_a_manoeuvre_that(broken, promise, told):
    own = testing.example_drive(seed=2)  # some of them edit what they are given
    check = getattr(testing, f"check_{promise}")
    assert check in MANOEUVRE_CHECKS
    with pytest.raises(AssertionError, match=told) as caught:
        check(broken(), own.nominal, own.times, own.cars)
    assert broken.__name__ in str(caught.value)


def test_every_check_of_a_manoeuvre_is_seen_to_catch_somebody():
    assert {f"check_{promise}" for _, promise, _ in BROKEN_MANOEUVRES} == set(map(name_of, MANOEUVRE_CHECKS))


def test_who_has_no_side_is_exempt_from_the_mirror(nominal, drive):
    class StraightOn(PullsToTheLeft):
        amplitude = 0.0

    testing.check_is_the_same_to_either_side(StraightOn(amplitude=0.0), nominal, drive.times, drive.cars)
