"""System E's drives are what the page says of them, and its figures measure what they are named after."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from vse_gym.metrics_found import true_value
from vse_gym.replay import Trace
from vse_gym.simulation import rollout
from vse_gym.types import FOUND

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
paper = import_module("papers_e")


def sine(friction, amplitude):
    return rollout(paper.Sine(friction, amplitude, "").scenario(), "truth", "none", 0)


def sides(log):
    """How far the car slips to the right and to the left, and where it is in the end [deg]."""
    beta = np.degrees(log.sideslip)
    return -beta.min(), beta.max(), abs(beta[-1])


def test_the_published_steer_is_a_slide_on_the_slippery_road_and_a_sine_on_the_other():
    right, left, rest = sides(sine(0.4, paper.PUBLISHED))
    assert right > 10 and left < 0.1 and rest > 5
    right, left, rest = sides(sine(0.9, paper.PUBLISHED))
    assert left == pytest.approx(right, rel=0.1) and rest < 0.01


def test_the_scanned_steer_is_the_largest_that_swings_to_either_side_alike():
    right, left, rest = sides(sine(0.4, paper.BELOW))
    assert left == pytest.approx(right, rel=0.1) and rest < 0.01
    assert paper.BELOW in paper.SCANNED
    right, left, rest = sides(sine(0.4, min(a for a in paper.SCANNED if a > paper.BELOW)))
    assert left > 1.2 * right and rest > 1


def test_an_estimate_that_is_the_truth_of_a_while_ago_is_late_by_that_while():
    log = sine(0.9, paper.PUBLISHED)
    found, late = np.full((len(log.time), len(FOUND)), np.nan), 7
    for axle in paper.AXLES:
        found[late:, FOUND.index(axle)] = true_value(log, axle)[:-late]
    none = np.empty(0)
    trace = Trace(none, none, found, none, none, 0.0, "")
    assert [paper.lateness(axle)(log, trace) for axle in paper.AXLES] == pytest.approx([70, 70])
    assert paper.stiffness_percent(paper.AXLES[0])(log, trace) > 1
