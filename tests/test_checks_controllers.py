"""Every controller of the catalogue keeps the published promises, and the checks catch who does not."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from vse_gym import testing
from vse_gym.catalogue import CONTROLLERS
from vse_gym.controllers.base import Controller
from vse_gym.testing import CONTROLLER_CHECKS
from vse_gym.types import NO_TORQUE, BrakeDemand


def name_of(check):
    return check.__name__


@pytest.mark.parametrize("check", CONTROLLER_CHECKS, ids=name_of)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_keeps_its_promises(name, check, nominal, estimates, readings):
    check(CONTROLLERS.make(name), nominal, estimates, readings)


# -- who breaks a promise is caught ---------------------------------------------------------------------------------


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
