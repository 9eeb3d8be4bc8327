"""What every tyre law promises: friction is its limit, it never gives power, and its slope is the true one."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vse_gym.physics import parameters as p
from vse_gym.physics.tyres import tyre_force

QIN = {"slip_stiffness": 120e3, "cornering_stiffness": 34377.0}  # Qin et al. (2014)
# CommonRoad's coefficients (see the car files) at 3000 N; and a curve with another shape and curvature each way.
COMMONROAD = p.MagicFormulaTyre(66909.0, 65760.0, 3000.0, 1.6411, 1.3507, 0.46403, -0.0074722, 1.1739, 1.0489)
LAWS = {
    "polynomial": p.PolynomialTyre(**QIN),
    "polynomial in proportion to load": p.PolynomialTyre(**QIN, reference_load=3500.0),
    "magic formula": COMMONROAD,
    "magic formula, peaked": COMMONROAD._replace(shape_y=1.9, curvature_y=-3.0, curvature_x=0.95, peak_y=0.7),
    "dugoff": p.DugoffTyre(**QIN),
    "ellipse": p.EllipseTyre(**QIN, trail=0.07),
    "fiala": p.FialaTyre(**QIN, trail=0.07),
    "linear": p.LinearTyre(**QIN),
}
# Largest force over friction times load, along and across: half the axes of an ellipse.
BOUND = {"ellipse": (1.0, 1.0), "dugoff": (1.0, 1.0)}
for label, law in LAWS.items():
    if isinstance(law, p.PolynomialTyre):
        BOUND[label] = (1.0063, 1.0063)
    if isinstance(law, p.MagicFormulaTyre):
        BOUND[label] = (law.peak_x, law.peak_y)
FIVE_DIGITS = 1e-5  # relative; the print gives the plateau as 1.0063, and the polynomial reaches 1.0063025

slips = st.floats(-2.0, 2.0)
loads = st.floats(0.0, 20e3)
frictions = st.floats(0.05, 1.5)
some_examples = settings(deadline=None)  # the first example may have to compile a kernel
every_law = pytest.mark.parametrize("name", LAWS)
every_limited_law = pytest.mark.parametrize("name", BOUND)


def stiffness(law, load):
    """Slip and cornering stiffness at a load [N]."""
    reference = getattr(law, "reference_load", 0.0)
    share = load / reference if reference else 1.0
    return law.slip_stiffness * share, law.cornering_stiffness * share


def test_every_law_is_here():
    assert {type(law) for law in LAWS.values()} == set(p.TYRES.values())


@every_law
def test_takes_power_and_never_gives_any(name):
    # Wheel and road rub at (R w - vx, -vy) = |v| (kappa, tan alpha): each force must push along its slip.
    grid = np.linspace(-1.5, 1.5, 31)
    for load in (0.0, 300.0, 4000.0):
        for friction in (0.1, 0.9):
            for kappa in grid:
                for tan_alpha in grid:
                    fx, fy, _, _ = tyre_force(LAWS[name], kappa, tan_alpha, load, friction)
                    assert fx * kappa >= 0
                    assert fy * tan_alpha >= 0


@every_limited_law
@some_examples
@given(slips, slips, loads, frictions)
def test_never_pulls_harder_than_friction_allows(name, kappa, tan_alpha, load, friction):
    fx, fy, _, _ = tyre_force(LAWS[name], kappa, tan_alpha, load, friction)
    along, across = BOUND[name]
    assert math.hypot(fx / along, fy / across) <= friction * load * (1 + FIVE_DIGITS) + 1e-9


@every_limited_law
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0)])
def test_reaches_its_friction_but_for_a_little(name, direction):
    # Dugoff's tyre comes within 1/(4 u) of it, u = C slip/(mu Fz): 34377 * 3/3000 makes 0.7 %.
    along, across = direction
    forces = [tyre_force(LAWS[name], k * along, k * across, 4000.0, 0.75)[:2] for k in np.linspace(0.0, 3.0, 3001)]
    largest = np.abs(np.array(forces)).max(axis=0)
    bound = BOUND[name][0] * along + BOUND[name][1] * across
    assert np.hypot(*largest) == pytest.approx(bound * 0.75 * 4000, rel=0.01)


@every_law
@some_examples
@given(slips, slips, loads, frictions)
def test_is_the_same_to_either_side(name, kappa, tan_alpha, load, friction):
    fx, fy, mz, slope = tyre_force(LAWS[name], kappa, tan_alpha, load, friction)
    assert tyre_force(LAWS[name], kappa, -tan_alpha, load, friction) == (fx, -fy, -mz, slope)
    if name != "dugoff":  # whose slip is relative to the passing tread: not the same driving and braking
        assert tyre_force(LAWS[name], -kappa, tan_alpha, load, friction) == (-fx, fy, mz, slope)


@every_law
@some_examples
@given(slips, slips, st.floats(1.0, 20e3), frictions)
def test_says_by_how_much_slip_changes_its_force(name, kappa, tan_alpha, load, friction):
    law = LAWS[name]
    reach = friction * load / stiffness(law, load)[0]  # slip at which the friction is used up
    if name == "ellipse":
        assume(abs(abs(kappa) - reach) > 1e-3 * reach)  # a kink has no derivative
    if name == "dugoff":
        assume(abs(kappa + 1) > 1e-2)  # where the tread stops passing, the curve is steep and has a kink
    h = 1e-5 * reach
    more, less = (tyre_force(law, kappa + step, tan_alpha, load, friction)[0] for step in (h, -h))
    slope = tyre_force(law, kappa, tan_alpha, load, friction)[3]
    # A second derivative of some 1/reach makes 1e-5 of it, the polynomial's rounded knot a step of 5e-5; kappa + h
    # itself is rounded by 2e-16 |kappa|/h. Where the force falls, the slope is given as 0.
    rounding = 1e-15 * abs(kappa) / h
    steep = max(stiffness(law, load)[0], slope)
    assert slope == pytest.approx(max(0.0, (more - less) / (2 * h)), abs=(1e-4 + rounding) * steep)


@every_law
@some_examples
@given(slips, slips, st.floats(1.0, 20e3), frictions, st.floats(-math.pi, math.pi))
def test_has_no_jump(name, kappa, tan_alpha, load, friction, direction):
    # No law is steeper than its slopes at zero, but Dugoff's where the tread hardly passes, as 1/(1 + kappa)^2.
    law = LAWS[name]
    if name == "dugoff":
        assume(abs(kappa + 1) > 0.1)
    step = 1e-9
    near = kappa + step * math.cos(direction), tan_alpha + step * math.sin(direction)
    apart = np.subtract(
        tyre_force(law, *near, load, friction)[:2], tyre_force(law, kappa, tan_alpha, load, friction)[:2]
    )
    steepest = 2 * max(stiffness(law, load)) * (100 if name == "dugoff" else 1)
    knot = 0.002 * friction * load if name in ("fiala", "ellipse") else 0.0  # the print steps by 0.0016 there
    assert np.hypot(*apart) <= steepest * step + knot + 1e-9


@every_law
def test_is_linear_at_small_slip(name):
    law, load, friction = LAWS[name], 4000.0, 0.9
    along, across = stiffness(law, load)
    kappa, tan_alpha = (1e-5 * friction * load / c for c in (along, across))
    # The polynomial softens by 0.0668 of the normalised slip, 1e-5 here; Dugoff's slip is kappa less kappa^2.
    assert tyre_force(law, kappa, 0.0, load, friction)[0] == pytest.approx(along * kappa, rel=1e-6)
    assert tyre_force(law, 0.0, tan_alpha, load, friction)[1] == pytest.approx(across * tan_alpha, rel=1e-6)
    assert tyre_force(law, 0.0, 0.0, load, friction)[3] == pytest.approx(along, rel=1e-6)


@every_law
@pytest.mark.parametrize("kappa", [-1.0, 0.0, 0.05])
@pytest.mark.parametrize("tan_alpha", [-0.2, 0.0, 1.0])
def test_a_wheel_in_the_air_gives_numbers(name, kappa, tan_alpha):
    fx, fy, mz, slope = tyre_force(LAWS[name], kappa, tan_alpha, 0.0, 0.9)
    assert np.all(np.isfinite([fx, fy, mz, slope]))
    if name in BOUND:  # the others know nothing of the load along the wheel
        assert math.hypot(fx, fy) < 1e-9
        assert abs(mz) < 1e-9
