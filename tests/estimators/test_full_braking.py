"""All four wheels at their caps: the speed that the slip limiter lives on must not be lost."""

from dataclasses import dataclass

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.controllers.base import Controller
from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import NO_TORQUE, BrakeDemand


@dataclass(frozen=True)
class FullBraking(Controller):
    """Asks for everything, always."""

    def init(self, nominal):
        return nominal.vehicle.brake_caps

    def act(self, state, estimate, reading):
        return BrakeDemand(state, NO_TORQUE), state


# An autoregression of the speed knows of no brake, and locking wheels are no speedometer: it believes the car 4 to 9
# m/s too fast. mapf_physics has the brakes in its transition and keeps the speed.
BLIND = pytest.mark.xfail(reason="the published transition has no brakes in it", strict=True)


# At the edge of what it was trained on the net drifts to 2.00 to 2.01 m/s within the two seconds: on the limit itself.
DRIFTS = pytest.mark.xfail(reason="gru loses the speed slowly on friction 0.2", strict=False)


def marks(estimator, friction):
    return {"mapf": [BLIND], "gru": [DRIFTS] if friction == 0.2 else []}.get(estimator, [])


@pytest.mark.parametrize(
    ("estimator", "friction"),
    [pytest.param(e, friction, marks=marks(e, friction)) for friction in (0.9, 0.4, 0.2) for e in ESTIMATORS],
)
def test_speed_is_kept_while_all_wheels_brake(estimator, friction):
    drive = scenario("straight_driving", friction=friction, duration=2.0)
    log = rollout(drive, estimator, FullBraking(), seed=0)
    moving = log.truth[:, p.VX] > 3
    # The wheels tell the speed between two dips of the limiter only, at some 5 % of slip: 1 m/s; twice that is lost.
    assert np.abs(log.estimate[:, 0] - log.truth[:, p.VX])[moving].max() < 2
    assert not log.ended


@pytest.mark.parametrize("estimator", ["ekf", "ukf", "pf", "zero"])
def test_the_car_stops_about_as_well_as_with_the_true_speed(estimator):
    drive = scenario("straight_driving", friction=0.4, duration=2.0)
    lost = [rollout(drive, who, FullBraking(), seed=0).truth[-1, p.VX] for who in (estimator, "truth")]
    assert lost[0] == pytest.approx(lost[1], abs=1.0)
