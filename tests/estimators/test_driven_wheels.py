"""Wheels that are driven turn faster than they roll: a speed must not be read off them."""

from dataclasses import dataclass

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.manoeuvres.base import Manoeuvre, Verdict
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Driver


@dataclass(frozen=True)
class Accelerating(Manoeuvre):
    """Straight ahead under a drive torque."""

    duration: float = 4.0
    front: float = 800.0  # of each front wheel [N m]
    rear: float = 0.0  # [N m]

    def drive(self, state, time, car):
        return Driver(drive=np.array([self.front, self.front, self.rear, self.rear])), None

    def verdict(self, log, nominal):
        return Verdict(())


def bias(name, car, **settings):
    """Mean error of the estimated speed once it has settled [m/s]."""
    cell = scenario(Accelerating(**settings), car, "gaussian")
    log = rollout(cell, "truth", "none", 0)
    heard = shadow(log, ESTIMATORS.make(name), cell.nominal, 0)
    return float(np.mean(heard.estimate[100:, 0] - log.truth[100:, p.VX]))


@pytest.mark.parametrize("car", ["qin2014_understeer", "bmw_320i"])
@pytest.mark.parametrize("name", ["kf", "ekf", "ukf", "zero", "kinematic", "ekf_double_track", "ukf_double_track"])
def test_two_driven_wheels_leave_the_speed_alone(name, car):
    # The front wheels slip by some 2 %: half of that, 0.3 m/s and more, is the error of who takes their mean.
    assert abs(bias(name, car)) < 0.1


@pytest.mark.parametrize("name", ["ekf_double_track", "ukf_double_track"])
def test_the_double_track_knows_the_slip_of_four_driven_wheels(name):
    # The single track, which takes them for rolling, errs by 0.27 m/s here.
    assert abs(bias(name, "qin2014_understeer", front=400.0, rear=400.0)) < 0.1
