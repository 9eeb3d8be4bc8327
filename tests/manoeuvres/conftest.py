"""What tests of manoeuvres share: a car that the driver is told, and drives whose figures are known beforehand."""

import numpy as np
import pytest

from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.sensors import QUIET
from vse_gym.types import Log
from vse_gym.vehicles import load


@pytest.fixture(scope="session")
def nominal():
    return Nominal(load("qin2014"), QUIET, 80 / 3.6)


def _log_of(time, ended="", hand_wheel=0.0, **truth):
    rows = len(time)
    states = np.zeros((rows, p.STATE_SIZE))
    states[:, p.VX] = 20.0
    for state, values in truth.items():
        states[:, getattr(p, state)] = values
    blank = {field: np.zeros(rows) for field in Log._fields}
    blank |= {field: np.zeros((rows, 4)) for field in ("brake", "added", "release")}
    blank |= {"time": time, "truth": states, "hand_wheel": np.broadcast_to(hand_wheel, rows), "ended": ended}
    return Log(**blank | {"filled": (), "vehicle": None})


def _figure(verdict, name):
    (found,) = [criterion for criterion in verdict.criteria if criterion.name.startswith(name)]
    return found


@pytest.fixture(scope="session")
def log_of():
    """A drive of which only the named states of the car are known, the others 0 but for vx = 20 m/s."""
    return _log_of


@pytest.fixture(scope="session")
def figure():
    """The one criterion of a verdict whose name begins so."""
    return _figure
