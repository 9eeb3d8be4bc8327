"""The published checks as a whole: what they are run on, and the run of all that apply."""

import numpy as np
import pytest

from vse_gym import testing
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.probing import mirror
from vse_gym.testing import CONTROLLER_CHECKS, ESTIMATOR_CHECKS, MANOEUVRE_CHECKS, conformance


def test_every_check_says_what_it_checks_and_is_published():
    public = {check for name, check in vars(testing).items() if name.startswith("check_")}
    assert public == {*ESTIMATOR_CHECKS, *CONTROLLER_CHECKS, *MANOEUVRE_CHECKS}
    assert all(check.__doc__ for check in public)


def test_the_example_drive_swerves_brakes_and_falls_silent(drive):
    # Otherwise the checks would promise less than they say.
    assert max(abs(estimate.ay) for estimate in drive.estimates) > 5
    assert max(reading.brake.max() for reading in drive.readings) > 500
    assert np.isnan([reading.y for reading in drive.readings]).any(axis=0).all()


def test_a_mirror_s_mirror_image_is_the_thing_itself(drive):
    for k in (0, 40, 100):
        thing = drive.readings[k], drive.estimates[k], drive.cars[k], drive.times[k]
        there, back = mirror(thing), mirror(mirror(thing))
        assert there[2].y == -thing[2].y
        assert there[2].vy == -thing[2].vy
        assert there[3] == thing[3]
        np.testing.assert_array_equal(back[0].y, thing[0].y)
        np.testing.assert_array_equal(back[2].state, thing[2].state)


@pytest.mark.parametrize(
    ("thing", "checks"),
    [
        (ESTIMATORS.make("kinematic"), ESTIMATOR_CHECKS),
        (CONTROLLERS.make("esc"), CONTROLLER_CHECKS),
        (MANOEUVRES.make("sine_with_dwell"), MANOEUVRE_CHECKS),
    ],
    ids=["estimator", "controller", "manoeuvre"],
)
def test_conformance_runs_every_check_that_applies(thing, checks):
    findings = list(conformance(thing))
    assert [finding.check for finding in findings] == list(checks)
    assert all(finding.error is None for finding in findings)


def test_conformance_wants_a_block():
    with pytest.raises(TypeError, match="neither an Estimator nor a Controller nor a Manoeuvre"):
        list(conformance(lambda: None))
