"""Every estimator of the catalogue keeps the published promises, and the checks catch who does not."""

from dataclasses import dataclass

import numpy as np
import pytest

from vse_gym import testing
from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.testing import ESTIMATOR_CHECKS
from vse_gym.types import Estimate


def name_of(check):
    return check.__name__


@pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=name_of)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_estimator_keeps_its_promises(name, check, nominal, readings):
    check(ESTIMATORS.make(name), nominal, readings)


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
    own = testing.example_drive(seed=2) if broken is EditsNominal else drive
    check = getattr(testing, f"check_{promise}")
    assert check in ESTIMATOR_CHECKS
    with pytest.raises(AssertionError, match=told) as caught:
        check(broken(), own.nominal, own.readings)
    assert broken.__name__ in str(caught.value)  # the sentence says who


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
