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
search = import_module("papers_d_search")
tables = import_module("papers_d_tables")


def test_the_gyros_outliers_reach_their_heights():
    noise = drives.SENSORS.record(1000, 0.01, seed=0).added[:, Y_YAW_RATE]
    assert noise[200] == 0.47 and noise[700] == 0.84
    assert np.sort(np.abs(noise))[-7] < np.radians(5)  # three readings each, the rest is noise of 1 deg/s


def test_the_other_draws_stay_as_they_are():
    mine, plain = (sensors.record(1000, 0.01, seed=0) for sensors in (drives.SENSORS, drives.Sensors(drives.LOUD)))
    changed = np.any(mine.added != plain.added, axis=1)
    assert set(np.nonzero(changed)[0]) == {200, 201, 202, 700, 701, 702}


@pytest.mark.parametrize(
    ("drive", "least", "most"),
    [("low", 0.6, 0.7), ("high", 0.6, 0.7), ("low_near", 0.85, 0.95), ("high_near", 0.85, 0.95)],
)
def test_the_accelerating_drives_stay_on_the_road_get_faster_and_use_the_grip_that_is_said(drive, least, most):
    log = rollout(getattr(drives, drive)(0), "truth", "none", 0)
    assert not log.ended
    assert log.truth[0, 3] == pytest.approx(12.5)
    assert log.truth[-1, 3] > 18.0
    (used,) = drives.grip_used(log).values()
    assert least < used < most
    if drive.startswith("low"):
        ay = np.abs(log.truth[:, 23])
        assert ay[800:1750].max() < 0.45 * ay.max()  # weak steering between 7 and 18 s


def test_shorter_lane_changes_come_near_the_limit_and_longer_ones_do_not():
    far, near = (
        list(drives.grip_used(rollout(d(0), "truth", "none", 0)).values())
        for d in (drives.lane_changes, drives.short_lane_changes)
    )
    assert len(far) == len(near) == 3
    assert far == sorted(far)  # each road is more slippery than the one before
    assert far[-1] < 0.6
    assert 0.85 < near[-1] < 1.0


def test_a_drive_without_outliers_differs_from_the_drive_in_the_gyro_alone():
    with_, without = (d.sensors.record(1000, 0.01, 0).added for d in (drives.low, drives.without_outliers(drives.low)))
    assert np.flatnonzero(np.any(with_ != without, axis=0)).tolist() == [Y_YAW_RATE]


# -- the claim that an advantage shrinks ------------------------------------------------------------------------------

SPREAD = np.linspace(-1.0, 1.0, 20)


@pytest.mark.parametrize(
    ("on_low", "on_high", "verdict"),
    [
        (-30 + SPREAD, -10 + SPREAD[::-1], "holds"),  # an advantage, and less of it
        (-10 + SPREAD, -30 + SPREAD[::-1], "fails"),  # an advantage, and more of it
        (-20 + SPREAD, -20 + SPREAD[::-1], "open"),
        (30 + SPREAD, 100 + SPREAD, "fails"),  # none that could shrink, whatever the difference
        (SPREAD, 100 + SPREAD, "open"),  # none that is sure
    ],
)
def test_only_an_advantage_can_shrink(on_low, on_high, verdict):
    claim = tables.shrinks("accelerating", on_low, on_high)
    assert claim.holds == verdict
    assert ("no advantage" in claim.here) == (np.median(on_low) > -5)


# -- tunings ----------------------------------------------------------------------------------------------------------


def test_a_search_from_another_start_keeps_the_threshold_and_ends_no_worse_than_it_began(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["papers_search"], "TUNINGS", tmp_path)
    seen = []

    def loss(log, trace):
        seen.append(float(np.mean(trace.estimate[:, 1] ** 2)))
        return seen[-1]

    short = drives.replace(drives.low, manoeuvre=drives.replace(drives.low.manoeuvre, duration=2.0))
    monkeypatch.setitem(search.TRAINING, search.FAR, short)
    for name in ("kf", "switching"):
        search.tune_for("D", name, short, loss, 2)
    search.search_on("switching", search.FAR, loss, budget=2)
    first, second, third = (search.load("switching", search.FAR, stage) for stage in ("dynamic", *search.STARTS))
    assert first.make().threshold == np.inf
    for tuning in (second, third):
        assert tuning.make().threshold == 1.5
        assert tuning.origin["tuned"] <= tuning.origin["default"]
    assert first.settings["treatment.ay_band"] == 5.0  # not of the dynamic scheme, so not searched
    assert first.origin["tuned"] <= first.origin["default"]


def test_of_all_searches_the_one_that_ended_best_counts_for_both_estimators(monkeypatch):
    losses = {"switching": (2.0, 1.0, 3.0), "fusion": (1.0, 2.0, 3.0)}
    starts = ("", *search.STARTS)

    def load(name, family, start=""):
        k = starts.index(start)
        settings = {"stiffness": 0.8 + 0.2 * k} if name in losses else {}
        return search.Tuning(name, settings, {"tuned": losses[name][k] if name in losses else 0.0})

    monkeypatch.setattr(search, "load", load)
    made = search.contenders(search.FAR)
    assert (made["switching"].stiffness, made["fusion"].stiffness) == (1.0, 0.8)
