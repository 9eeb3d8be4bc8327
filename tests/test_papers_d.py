"""The drives of system D have what the print says of them."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from vse_gym.simulation import rollout
from vse_gym.types import Y_YAW_RATE

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
drives = import_module("papers_d_drives")


def test_the_gyros_outliers_reach_their_heights():
    noise = drives.SENSORS.record(1000, 0.01, seed=0).added[:, Y_YAW_RATE]
    assert noise[200] == 0.47 and noise[700] == 0.84
    assert np.sort(np.abs(noise))[-7] < np.radians(5)  # three readings each, the rest is noise of 1 deg/s


def test_the_other_draws_stay_as_they_are():
    mine, plain = (sensors.record(1000, 0.01, seed=0) for sensors in (drives.SENSORS, drives.Sensors(drives.LOUD)))
    changed = np.any(mine.added != plain.added, axis=1)
    assert set(np.nonzero(changed)[0]) == {200, 201, 202, 700, 701, 702}


@pytest.mark.parametrize(("drive", "grip"), [("low", 0.35 * 9.81), ("high", 0.85 * 9.81)])
def test_the_accelerating_drives_stay_on_the_road_and_get_faster(drive, grip):
    setting = getattr(drives, drive)(0)
    log = rollout(setting, "truth", "none", 0)
    assert not log.ended
    assert log.truth[0, 3] == pytest.approx(12.5)
    assert log.truth[-1, 3] > 18.0
    ay = np.abs(log.truth[:, 23])
    assert 0.5 * grip < ay.max() < grip
    if drive == "low":
        assert ay[800:1750].max() < 1.0  # weak steering between 7 and 18 s
