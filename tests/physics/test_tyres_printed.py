"""The laws made of the polynomial that Qin et al. (2014) print, against their print."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.physics.parameters import TYRES
from vse_gym.physics.tyres import KNOT, PLATEAU, PRINTED_KNOT, aligning_arm, polynomial, tyre_force

SETTINGS = {"slip_stiffness": 120e3, "cornering_stiffness": 34377.0, "trail": 0.07}  # Qin et al. (2014)
BOUND = {"polynomial": 1.0063, "ellipse": 1.0, "fiala": math.inf}  # largest force over mu Fz
WITH_TRAIL = [name for name in TYRES if "trail" in TYRES[name]._fields]
FIVE_DIGITS = 1e-5  # relative; the print gives the plateau as 1.0063, and the polynomial reaches 1.0063025

slips = st.floats(-2.0, 2.0)
loads = st.floats(0.0, 20e3)
frictions = st.floats(0.05, 1.5)
some_examples = settings(deadline=None)  # the first example may have to compile a kernel


def tyre(name):
    return TYRES[name](**{field: SETTINGS[field] for field in TYRES[name]._fields if field in SETTINGS})


@pytest.mark.parametrize("name", ["polynomial", "ellipse"])
@pytest.mark.parametrize(("kappa", "tan_alpha"), [(1.0, 0.0), (-1.0, 0.0), (0.0, 2.0), (-0.7, 1.5)])
def test_gives_all_the_friction_when_it_slides(name, kappa, tan_alpha):
    fx, fy, _, _ = tyre_force(tyre(name), kappa, tan_alpha, 4000.0, 0.4)
    assert math.hypot(fx, fy) == pytest.approx(BOUND[name] * 0.4 * 4000, rel=1e-9)


@pytest.mark.parametrize("name", ["polynomial", "fiala", "ellipse"])
@pytest.mark.parametrize(("theta", "printed"), [(0.5, 0.4704), (1.0, 0.83), (1.5, 1.0014), (3.0, 1.0063)])
def test_has_the_printed_lateral_force(name, theta, printed):
    # By hand from theta - 0.0668 theta^2 - 0.1032 theta^3, and the plateau; exact in four decimals.
    law, limit = tyre(name), 0.9 * 4000
    fy = tyre_force(law, 0.0, theta * limit / law.cornering_stiffness, 4000.0, 0.9)[1]
    assert fy == pytest.approx(min(printed, BOUND[name]) * limit, rel=1e-9)


@pytest.mark.parametrize("kappa", [-0.5, -0.01, 0.003, 0.8])
def test_the_printed_law_has_no_limit_along_the_wheel(kappa):
    fx, _, _, slope = tyre_force(tyre("fiala"), kappa, 0.3, 4000.0, 0.9)
    assert fx == pytest.approx(1200 * 100 * kappa, rel=1e-12)  # 1200 N per percent slip
    assert slope == 120e3


@some_examples
@given(slips, slips, st.floats(1.0, 20e3), frictions)
def test_the_default_law_pushes_along_the_normalised_slip(kappa, tan_alpha, load, friction):
    fx, fy, _, _ = tyre_force(tyre("polynomial"), kappa, tan_alpha, load, friction)
    ux, uy = SETTINGS["slip_stiffness"] * kappa, SETTINGS["cornering_stiffness"] * tan_alpha
    cross = fx * uy - fy * ux
    assert abs(cross) <= 1e-12 * math.hypot(fx, fy) * math.hypot(ux, uy)  # parallel, to rounding


@some_examples
@given(slips, slips, st.floats(1.0, 20e3), frictions)
def test_the_ellipse_holds_both_forces(kappa, tan_alpha, load, friction):
    law = tyre("ellipse")
    fx, fy, _, _ = tyre_force(law, kappa, tan_alpha, load, friction)
    free = tyre_force(law, 0.0, tan_alpha, load, friction)[1]
    limit = friction * load
    assert abs(fy) <= math.sqrt(max(0.0, limit**2 - fx**2)) * (1 + 1e-9) + 1e-9
    assert abs(fy) <= abs(free)


def test_the_polynomial_has_no_kink_at_its_knot():
    root = (-0.1336 + math.sqrt(0.1336**2 + 4 * 0.3096)) / (2 * 0.3096)  # where its slope is zero
    assert pytest.approx(root, abs=5e-5) == KNOT  # given in four decimals
    below, above = polynomial(KNOT - 1e-9), polynomial(KNOT)
    assert below[0] == pytest.approx(above[0], rel=FIVE_DIGITS)
    assert below[1] == pytest.approx(above[1], abs=5e-5)  # of a slope that begins at 1: the rounding of the knot
    assert above == (PLATEAU, 0.0)


def test_the_polynomial_rises_up_to_its_knot():
    values, slopes = zip(*(polynomial(theta) for theta in np.linspace(0.0, 3.0, 3001)), strict=True)
    assert min(slopes) >= -5e-5  # the knot is rounded up, past the summit
    assert np.all(np.diff(values) >= -PLATEAU * FIVE_DIGITS)


def test_the_printed_law_steps_by_no_more_than_its_print_at_the_printed_knot():
    law, limit = tyre("fiala"), 0.9 * 4000
    below, above = (
        tyre_force(law, 0.0, theta * limit / law.cornering_stiffness, 4000.0, 0.9)[1] / limit
        for theta in (PRINTED_KNOT - 1e-9, PRINTED_KNOT + 1e-9)
    )
    # 1.0063 less 1.54 - 0.0668 1.54^2 - 0.1032 1.54^3 = 1.004663, as printed.
    assert above - below == pytest.approx(0.001637, abs=1e-6)


@pytest.mark.parametrize("name", WITH_TRAIL)
@some_examples
@given(slips, slips, loads, frictions)
def test_the_aligning_moment_opposes_the_lateral_force(name, kappa, tan_alpha, load, friction):
    _, fy, mz, _ = tyre_force(tyre(name), kappa, tan_alpha, load, friction)
    assert fy * mz <= 0


@pytest.mark.parametrize(
    ("theta", "arm"), [(0.0, 0.0), (1.0, 0.128), (2.0, 0.037), (2.5, 0.0185), (3.0, 0.0), (9.0, 0.0)]
)
def test_the_aligning_arm_is_as_printed_up_to_two_and_fades_out(theta, arm):
    # By hand from 0.2749 theta - 0.0950 theta^2 - 0.0872 theta^3 + 0.0353 theta^4.
    assert aligning_arm(theta) == pytest.approx(arm, abs=1e-12)


@pytest.mark.parametrize("theta", [2.0, 3.0])
def test_the_aligning_arm_does_not_jump(theta):
    # The arm's slope is below 0.3 everywhere, so that 2e-9 apart it may differ by 1e-9.
    assert aligning_arm(theta - 1e-9) == pytest.approx(aligning_arm(theta + 1e-9), abs=1e-9)


@pytest.mark.parametrize("name", WITH_TRAIL)
def test_the_aligning_moment_is_the_arm_times_trail_and_friction(name):
    law, limit = tyre(name), 0.9 * 4000
    mz = tyre_force(law, 0.0, limit / law.cornering_stiffness, 4000.0, 0.9)[2]  # at theta = 1
    assert mz == pytest.approx(-0.128 * 0.07 * limit, rel=1e-9)
