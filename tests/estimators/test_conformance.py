"""Every estimator and controller of the catalogue keeps the published promises, and the checks catch who does not."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from vse_gym import testing
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.testing import CONTROLLER_CHECKS, ESTIMATOR_CHECKS
from vse_gym.types import NO_TORQUE, BrakeDemand, Estimate


def name_of(check):
    return check.__name__


@pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=name_of)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_estimator_keeps_its_promises(name, check, nominal, readings):
    check(ESTIMATORS.make(name), nominal, readings)


@pytest.mark.parametrize("check", CONTROLLER_CHECKS, ids=name_of)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_keeps_its_promises(name, check, nominal, estimates, readings):
    check(CONTROLLERS.make(name), nominal, estimates, readings)


def test_every_check_says_what_it_checks_and_is_published():
    public = {check for name, check in vars(testing).items() if name.startswith("check_")}
    assert public == {*ESTIMATOR_CHECKS, *CONTROLLER_CHECKS}
    assert all(check.__doc__ for check in public)


def test_the_example_drive_swerves_brakes_and_falls_silent(drive):
    # Otherwise the checks would promise less than they say.
    assert max(abs(estimate.ay) for estimate in drive.estimates) > 5
    assert max(reading.brake.max() for reading in drive.readings) > 500
    assert np.isnan([reading.y for reading in drive.readings]).any(axis=0).all()


# -- who breaks a promise is caught ---------------------------------------------------------------------------------


class WheelSpeed(Estimator):
    """Keeps every promise: speed from the wheels, smoothed. Those below each break one."""

    def init(self, nominal, rng):
        return {"speed": nominal.speed, "radius": nominal.vehicle.wheel_radius, "past": np.zeros(3)}

    def update(self, state, reading, rng):
        heard = reading.wheel_speeds[np.isfinite(reading.wheel_speeds)]
        error = state["radius"] * heard.mean() - state["speed"] if heard.size else 0.0
        return {**state, "speed": state["speed"] + 0.5 * error}

    def estimate(self, state):
        return Estimate(vx=state["speed"])


class EditsItsState(WheelSpeed):
    def update(self, state, reading, rng):
        state["past"][0] += 1.0
        return super().update(state, reading, rng)


class EditsASharedArrayOnADropOut(WheelSpeed):
    def update(self, state, reading, rng):
        if np.isnan(reading.ay):
            state["past"][1] = reading.time
        return super().update(state, reading, rng)


class EditsTheReading(WheelSpeed):
    def update(self, state, reading, rng):
        reading.y[np.isnan(reading.y)] = 0.0
        return super().update(state, reading, rng)


class EditsNominal(WheelSpeed):
    def init(self, nominal, rng):
        object.__setattr__(nominal, "friction", 0.5)
        return super().init(nominal, rng)


class BelievesSilence(WheelSpeed):
    def update(self, state, reading, rng):
        return {**state, "speed": state["radius"] * reading.wheel_speeds.mean()}


class NeedsTheGyro(WheelSpeed):
    def update(self, state, reading, rng):
        return {**super().update(state, reading, rng), "gyro": reading.yaw_rate}

    def estimate(self, state):
        return Estimate(vx=state["speed"], vy=0.1 * state.get("gyro", 0.0))


class DividesBySpeed(WheelSpeed):
    def estimate(self, state):
        return Estimate(vx=state["speed"], vy=np.float64(1.0) / state["speed"] if state["speed"] else np.inf)


class FallsForOutliers(WheelSpeed):
    def estimate(self, state):
        return Estimate(vx=state["speed"] if state["speed"] > 3 else np.nan)


class HandsOutATuple(WheelSpeed):
    def estimate(self, state):
        return state["speed"], 0.0


class HandsOutAnArray(WheelSpeed):
    def estimate(self, state):
        return Estimate(vx=np.array([state["speed"]]))


class NegativeVariance(WheelSpeed):
    def estimate(self, state):
        return Estimate(vx=state["speed"], cov=np.diag([1.0, -0.1, np.nan]))


class LopsidedCovariance(WheelSpeed):
    def estimate(self, state):
        return Estimate(vx=state["speed"], cov=np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))


class HidesItsState(WheelSpeed):
    def __init__(self):
        self.speed = 0.0

    def update(self, state, reading, rng):
        after = super().update(state, reading, rng)
        self.speed = after["speed"]
        return after

    def estimate(self, state):
        return Estimate(vx=self.speed)


LATEST = {"speed": 0.0}


class HidesItsStateInTheModule(WheelSpeed):
    def update(self, state, reading, rng):
        LATEST["speed"] = 0.5 * (LATEST["speed"] + super().update(state, reading, rng)["speed"])
        return state

    def estimate(self, state):
        return Estimate(vx=LATEST["speed"])


class BringsItsOwnGenerator(WheelSpeed):
    def update(self, state, reading, rng):
        after = super().update(state, reading, rng)
        return {**after, "speed": after["speed"] + 0.01 * np.random.default_rng().standard_normal()}


class SeedsTheGlobalGenerator(WheelSpeed):
    def init(self, nominal, rng):
        np.random.seed(0)  # noqa: NPY002 - the promise broken here
        return super().init(nominal, rng)


class CannotBePickled(WheelSpeed):
    def init(self, nominal, rng):
        return {**super().init(nominal, rng), "log": (line for line in ())}


class Counter:
    """Forgets its count when it is copied."""

    def __init__(self, count=0):
        self.count = count

    def __reduce__(self):
        return Counter, ()


class ForgetsWhenSaved(WheelSpeed):
    def init(self, nominal, rng):
        return {**super().init(nominal, rng), "counter": Counter()}

    def update(self, state, reading, rng):
        return {**super().update(state, reading, rng), "counter": Counter(state["counter"].count + 1)}

    def estimate(self, state):
        return Estimate(vx=state["speed"], vy=float(state["counter"].count))


class KnowsOneSideOnly(WheelSpeed):
    def update(self, state, reading, rng):
        left = reading.wheel_speeds[0]
        return {**state, "speed": state["radius"] * left if np.isfinite(left) else state["speed"]}


BROKEN_ESTIMATORS = [
    (EditsItsState, "edits_nothing", "an old state"),
    (EditsASharedArrayOnADropOut, "edits_nothing", "an old state"),
    (EditsTheReading, "edits_nothing", "what it was given"),
    (EditsNominal, "edits_nothing", "what it was given"),
    (BelievesSilence, "survives_silence", "expected finite"),
    (NeedsTheGyro, "survives_a_dropout", "yaw_rate silent"),
    (DividesBySpeed, "stands_still", "standing car"),
    (FallsForOutliers, "survives_outliers", "expected finite"),
    (HandsOutATuple, "follows_a_drive", "expected an Estimate"),
    (HandsOutAnArray, "follows_a_drive", "plain floats"),
    (NegativeVariance, "covariance", "negative eigenvalue"),
    (LopsidedCovariance, "covariance", "symmetry"),
    (HidesItsState, "keeps_itself", "changed itself in use"),
    (HidesItsStateInTheModule, "keeps_itself", "mixes two drives"),
    (BringsItsOwnGenerator, "repeats_itself", "draw random numbers from rng alone"),
    (SeedsTheGlobalGenerator, "repeats_itself", "global generator"),
    (CannotBePickled, "can_be_saved", "keep plain data"),
    (ForgetsWhenSaved, "can_be_saved", "goes on differently"),
    (KnowsOneSideOnly, "is_symmetric", "mirrored drive"),
]


@pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=name_of)
def test_an_honest_estimator_from_outside_passes(check, nominal, readings):
    check(WheelSpeed(), nominal, readings)


@pytest.mark.parametrize(
    ("broken", "promise", "told"), BROKEN_ESTIMATORS, ids=[b[0].__name__ for b in BROKEN_ESTIMATORS]
)
def test_a_check_catches_an_estimator_that(broken, promise, told, drive):
    # Of its own drive: one of them edits the nominal car.
    nominal, readings, _ = testing.example_drive(seed=2) if broken is EditsNominal else drive
    check = getattr(testing, f"check_{promise}")
    assert check in ESTIMATOR_CHECKS
    with pytest.raises(AssertionError, match=told) as caught:
        check(broken(), nominal, readings)
    assert broken.__name__ in str(caught.value)  # the sentence says who


@dataclass(frozen=True)
class Damper(Controller):
    """Keeps every promise: brakes the outer front wheel against the yaw rate. Those below each break one."""

    gain: float = 1000.0

    def init(self, nominal):
        return nominal.vehicle.brake_cap_front, np.zeros(2)

    def act(self, state, estimate, reading):
        added = np.zeros(4)
        if abs(estimate.yaw_rate) > 0.1:
            added[1 if estimate.yaw_rate > 0 else 0] = min(state[0], self.gain * abs(estimate.yaw_rate))
        return BrakeDemand(added, NO_TORQUE), state


class BrakesBeyondTheCaps(Damper):
    def act(self, state, estimate, reading):
        return super().act((np.inf, state[1]), estimate, reading)[0]._replace(added=np.full(4, 1e5)), state


class PushesTheWheels(Damper):
    def act(self, state, estimate, reading):
        demand, state = super().act(state, estimate, reading)
        return demand._replace(added=-demand.added), state


class ReleasesTooMuch(Damper):
    def act(self, state, estimate, reading):
        return super().act(state, estimate, reading)[0]._replace(release=np.full(4, 1.1)), state


class HandsOutALists(Damper):
    def act(self, state, estimate, reading):
        return BrakeDemand([0.0] * 4, [0.0] * 4), state


class DividesBySpeedToo(Damper):
    def act(self, state, estimate, reading):
        added = np.full(4, np.nan if estimate.vx == 0 else 0.0)
        return BrakeDemand(added, NO_TORQUE), state


class AlwaysBrakes(Damper):
    def act(self, state, estimate, reading):
        return BrakeDemand(np.full(4, 1.0), NO_TORQUE), state


class EditsItsMemory(Damper):
    def act(self, state, estimate, reading):
        state[1][0] = estimate.yaw_rate
        return super().act(state, estimate, reading)


@dataclass(frozen=True)
class CountsInItself(Damper):
    calls: list = field(default_factory=list)

    def act(self, state, estimate, reading):
        self.calls.append(reading.time)
        return super().act(state, estimate, reading)


class DitheringBrakes(Damper):
    def act(self, state, estimate, reading):
        demand, state = super().act(state, estimate, reading)
        return demand._replace(added=demand.added * np.random.default_rng().random()), state


class BrakesTheLeftFrontOnly(Damper):
    def act(self, state, estimate, reading):
        demand, state = super().act(state, estimate, reading)
        return demand._replace(added=np.array([demand.added.sum(), 0.0, 0.0, 0.0])), state


BROKEN_CONTROLLERS = [
    (BrakesBeyondTheCaps, "demand_is_feasible", "caps"),
    (PushesTheWheels, "demand_is_feasible", "caps"),
    (ReleasesTooMuch, "demand_is_feasible", "release in"),
    (HandsOutALists, "demand_is_feasible", "four floats"),
    (DividesBySpeedToo, "answers_any_estimate", "caps"),
    (AlwaysBrakes, "leaves_straight_driving_alone", "going straight"),
    (EditsItsMemory, "edits_nothing", "an old state"),
    (CountsInItself, "keeps_itself", "changed itself in use"),
    (DitheringBrakes, "repeats_itself", "two results"),
    (BrakesTheLeftFrontOnly, "is_symmetric", "mirrored drive"),
]


@pytest.mark.parametrize("check", CONTROLLER_CHECKS, ids=name_of)
def test_an_honest_controller_from_outside_passes(check, nominal, estimates, readings):
    check(Damper(), nominal, estimates, readings)


@pytest.mark.parametrize(
    ("broken", "promise", "told"), BROKEN_CONTROLLERS, ids=[b[0].__name__ for b in BROKEN_CONTROLLERS]
)
def test_a_check_catches_a_controller_that(broken, promise, told, nominal, estimates, readings):
    check = getattr(testing, f"check_{promise}")
    assert check in CONTROLLER_CHECKS
    with pytest.raises(AssertionError, match=told) as caught:
        check(broken(), nominal, estimates, readings)
    assert broken.__name__ in str(caught.value)


@dataclass(frozen=True)
class Dithering(WheelSpeed):
    """Draws from the generator that it is handed, as it may."""

    amount: float = 0.01

    def update(self, state, reading, rng):
        after = super().update(state, reading, rng)
        return {**after, "speed": after["speed"] + self.amount * rng.standard_normal()}


@pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=name_of)
def test_who_draws_from_the_generator_it_is_handed_passes(check, nominal, readings):
    check(Dithering(), nominal, readings)
