"""What tests of the plant share: a car that is driven by hand."""

import numpy as np
import pytest

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import rolling_start

DRY = p.road((0.0, 0.9))


@pytest.fixture(scope="session")
def driven():
    """States every 10 ms of a car with a body that may roll, under the inputs of each instant."""

    def states_of(vehicle, integrator, inputs, seconds, h=1e-3, speed=80 / 3.6, road=DRY, roll=0.0):
        x = rolling_start(vehicle, speed)
        x[p.ROLL] = roll
        states = [x]
        for k in range(round(100 * seconds)):
            states.append(integrator(vehicle, road, states[-1], inputs(0.01 * k), round(0.01 / h), h))
        return np.array(states)

    return states_of
