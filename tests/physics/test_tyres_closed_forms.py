"""The Magic Formula, Dugoff's tyre and stiffness in proportion to load, against what their authors write."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vse_gym.physics import parameters as p
from vse_gym.physics.tyres import magic_formula, tyre_force

slips = st.floats(-2.0, 2.0)
some_examples = settings(deadline=None)  # the first example may have to compile a kernel

TYRE = p.MagicFormulaTyre(66909.0, 65760.0, 3000.0, 1.6411, 1.3507, 0.46403, -0.0074722, 1.1739, 1.0489)
DUGOFF = p.DugoffTyre(slip_stiffness=100e3, cornering_stiffness=60e3)


def pacejka(slip, load, friction, stiffness_per_load, shape, curvature, peak):
    """Y = D sin(C atan(B x - E (B x - atan(B x)))) with C B D the stiffness; Pacejka (2012), 4.3."""
    d = peak * friction * load
    bx = stiffness_per_load * load / (shape * d) * slip
    return d * math.sin(shape * math.atan(bx - curvature * (bx - math.atan(bx))))


@some_examples
@given(slips, st.floats(100.0, 9e3), st.floats(0.1, 1.2))
def test_pure_slip_is_the_magic_formula(slip, load, friction):
    along = pacejka(slip, load, friction, 66909 / 3000, TYRE.shape_x, TYRE.curvature_x, TYRE.peak_x)
    across = pacejka(slip, load, friction, 65760 / 3000, TYRE.shape_y, TYRE.curvature_y, TYRE.peak_y)
    assert tyre_force(TYRE, slip, 0.0, load, friction)[:2] == pytest.approx((along, 0.0), rel=1e-9, abs=1e-6)
    assert tyre_force(TYRE, 0.0, slip, load, friction)[:2] == pytest.approx((0.0, across), rel=1e-9, abs=1e-6)


@some_examples
@given(slips, slips, st.floats(0.1, 1.2))
def test_combined_slip_of_one_curve_pulls_along_the_slip(kappa, tan_alpha, friction):
    alike = TYRE._replace(shape_y=TYRE.shape_x, curvature_y=TYRE.curvature_x, peak_y=TYRE.peak_x)
    alike = alike._replace(cornering_stiffness=TYRE.slip_stiffness)
    fx, fy, _, _ = tyre_force(alike, kappa, tan_alpha, 3000.0, friction)
    slip = math.hypot(kappa, tan_alpha)
    pure = tyre_force(alike, slip, 0.0, 3000.0, friction)[0]
    assert math.hypot(fx, fy) == pytest.approx(pure, rel=1e-9, abs=1e-6)
    assert fx * tan_alpha == pytest.approx(fy * kappa, rel=1e-9, abs=1e-6)


@some_examples
@given(st.floats(0.0, 50.0), st.floats(1.0, 1.99), st.floats(-5.0, 1.0))
def test_the_formula_stays_between_nothing_and_its_peak(x, shape, curvature):
    value, slope = magic_formula(x, shape, curvature)
    assert 0 <= value <= 1
    h = 1e-6 * max(1.0, x)
    nearby = (magic_formula(x + h, shape, curvature)[0] - magic_formula(x, shape, curvature)[0]) / h
    # The second derivative is below 2 (1 - E)^2 C^2: h of it.
    assert slope == pytest.approx(nearby, abs=h * 2 * (1 - min(curvature, 0)) ** 2 * shape**2 + 1e-9)


LOAD_PROPORTIONAL = [TYRE, p.PolynomialTyre(120e3, 34377.0, reference_load=3500.0)]


@pytest.mark.parametrize("law", LOAD_PROPORTIONAL, ids=lambda law: type(law).__name__)
@some_examples
@given(slips, slips, st.floats(0.1, 1.2), st.floats(0.1, 4.0))
def test_force_is_in_proportion_to_load_where_stiffness_is(law, kappa, tan_alpha, friction, times):
    one = tyre_force(law, kappa, tan_alpha, 2500.0, friction)
    more = tyre_force(law, kappa, tan_alpha, 2500.0 * times, friction)
    np.testing.assert_allclose(more, np.multiply(one, times), rtol=1e-9, atol=1e-9)


@some_examples
@given(slips, slips, st.floats(0.1, 1.2))
def test_stiffness_holds_at_the_reference_load(kappa, tan_alpha, friction):
    fixed, relative = (p.PolynomialTyre(120e3, 34377.0, reference) for reference in (0.0, 3500.0))
    assert tyre_force(relative, kappa, tan_alpha, 3500.0, friction) == tyre_force(
        fixed, kappa, tan_alpha, 3500.0, friction
    )


@some_examples
@given(st.floats(-0.99, 2.0), slips, st.floats(100.0, 9e3), st.floats(0.1, 1.2))
def test_dugoffs_tyre_has_its_closed_form(kappa, tan_alpha, load, friction):
    # Dugoff, Fancher, Segel (1970) with s = -kappa: Fx = Cs kappa/(1 + kappa) f, Fy = Ca tan(alpha)/(1 + kappa) f,
    # f = (2 - q) q below q = mu Fz (1 + kappa)/(2 hypot(Cs kappa, Ca tan(alpha))) = 1, and 1 above.
    cx, cy = DUGOFF
    length = math.hypot(cx * kappa, cy * tan_alpha)
    q = friction * load * (1 + kappa) / (2 * length) if length > 1e-9 else math.inf
    f = (2 - q) * q if q < 1 else 1.0
    expected = cx * kappa / (1 + kappa) * f, cy * tan_alpha / (1 + kappa) * f
    assert tyre_force(DUGOFF, kappa, tan_alpha, load, friction)[:2] == pytest.approx(expected, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("tan_alpha", [-0.4, 0.0, 0.05])
def test_dugoffs_locked_wheel_gives_all_its_friction_against_its_slip(tan_alpha):
    fx, fy, _, _ = tyre_force(DUGOFF, -1.0, tan_alpha, 4000.0, 0.7)
    assert math.hypot(fx, fy) == pytest.approx(0.7 * 4000, rel=1e-12)
    assert fy / fx == pytest.approx(-60e3 * tan_alpha / 100e3, abs=1e-12)


def test_dugoffs_tyre_is_exactly_linear_up_to_half_the_friction():
    for tan_alpha in np.linspace(0.0, 0.5 * 0.9 * 4000 / 60e3, 20):
        assert tyre_force(DUGOFF, 0.0, tan_alpha, 4000.0, 0.9)[1] == pytest.approx(60e3 * tan_alpha, rel=1e-12)
    beyond = 0.6 * 0.9 * 4000 / 60e3
    assert tyre_force(DUGOFF, 0.0, beyond, 4000.0, 0.9)[1] < 60e3 * beyond
