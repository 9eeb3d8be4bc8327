"""A study that is driven in a second."""

import pytest

from vse_gym.evaluation import Cell, Randomise, Study

RANDOM = Randomise(speed=1.0, steer=0.1, friction=0.03, mass=(1.0, 1.25), stiffness=(0.75, 1.0))


@pytest.fixture(scope="session")
def short():
    settings = {"speed_kmh": 80, "amplitude_deg": 120, "friction": 0.5, "duration": 1.5}
    cell = Cell("short", "sine_with_dwell", sensors="outliers", controller="sideslip_esc", settings=settings)
    gentle = Cell("Gentle, 90", "straight_driving", benign=True, settings={"duration": 1.0})
    return Study("short", 1, (cell, gentle), seeds=2, estimators=("truth", "ekf"), randomise=RANDOM)
