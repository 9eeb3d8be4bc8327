"""The slalom's experiment: what its peaks are."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
papers_a = import_module("papers_a")
TIME = 0.01 * np.arange(1000)


def test_a_peak_is_the_top_tenth_of_a_half_wave():
    found = papers_a.peaks(3 * np.sin(2 * np.pi * 0.5 * TIME + 0.1))
    # |sin| exceeds 0.9 for 1 - 2 asin(0.9)/pi of the time
    assert found.mean() == pytest.approx(1 - 2 * np.arcsin(0.9) / np.pi, abs=0.02)


def test_weak_half_waves_have_none():
    swings = np.sin(2 * np.pi * 0.5 * TIME) * np.where(TIME < 5, 0.4, 1.0)
    found = papers_a.peaks(swings)
    assert not found[TIME < 4.9].any()
    assert found[TIME >= 5].any()


def test_a_speed_is_taken_about_its_mean():
    wave = np.sin(2 * np.pi * 0.5 * TIME)
    np.testing.assert_array_equal(papers_a.peaks(14 + wave, about_mean=True), papers_a.peaks(wave))
