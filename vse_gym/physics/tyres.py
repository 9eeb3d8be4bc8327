"""One force law per tyre type.

Slip is (kappa, tan_alpha): kappa the slip ratio, positive when driving; alpha the slip angle, steer minus the angle
of the wheel's velocity, so that positive alpha pushes left.
"""

import math

from vse_gym.compiled import compiled, generic
from vse_gym.physics.parameters import EllipseTyre, FialaTyre, LinearTyre, PolynomialTyre

KNOT = 1.5944  # where the polynomial's slope is zero; the print's 1.54 would leave a kink
PLATEAU = 1.00630  # its value there, and beyond
PRINTED_KNOT = 1.54
TINY = 1e-12


@compiled
def polynomial(theta):
    """Normalised force of the Fiala tyre at normalised slip theta >= 0, and its slope. Qin et al. (2014).

    Returns:
        value, slope: p(theta) in [0, 1.0063] and dp/dtheta, both continuous.
    """
    if theta >= KNOT:
        return PLATEAU, 0.0
    return theta * (1 - theta * (0.0668 + 0.1032 * theta)), 1 - theta * (0.1336 + 0.3096 * theta)


@compiled
def aligning_arm(theta):
    """Arm of the aligning moment over the length L, at normalised slip theta >= 0. Qin et al. (2014).

    The print jumps at theta = 2 to another branch; here the arm fades to zero from there to theta = 3.
    """
    t = min(theta, 2.0)
    arm = t * (0.2749 - t * (0.0950 + t * (0.0872 - 0.0353 * t)))
    return arm * min(1.0, max(0.0, 3.0 - theta))


@generic
def tyre_force(tyre, kappa, tan_alpha, load, friction):
    """Steady force of one tyre, in wheel axes.

    Args:
        tyre: One of the tyre types.
        kappa: Slip ratio, positive when driving [-].
        tan_alpha: Tangent of the slip angle, positive pushes left [-].
        load: Vertical load, not negative [N].
        friction: Tyre-road friction coefficient, positive [-].

    Returns:
        fx, fy: Force [N].
        mz: Aligning moment [N m].
        slope: dfx/dkappa, not negative [N].
    """


@tyre_force.register(PolynomialTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    # The vector form: the polynomial acts on the length of the normalised slip vector. Force and slip have the same
    # sign in each direction, so the tyre never creates power, and hypot(fx, fy) <= 1.0063 friction load.
    limit = friction * load + TINY
    ux = tyre.slip_stiffness * kappa / limit
    uy = tyre.cornering_stiffness * tan_alpha / limit
    u = math.sqrt(ux * ux + uy * uy) + TINY  # so that a rolling tyre has a direction too
    p, dp = polynomial(u)
    cx, cy = ux / u, uy / u
    secant = p / u
    slope = tyre.slip_stiffness * (secant + (dp - secant) * cx * cx)
    return limit * p * cx, limit * p * cy, 0.0, slope


@tyre_force.register(LinearTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    return tyre.slip_stiffness * kappa, tyre.cornering_stiffness * tan_alpha, 0.0, tyre.slip_stiffness


@compiled
def _printed_lateral(tyre, tan_alpha, limit):
    """Lateral force and aligning moment as printed; the force takes alpha's sign, the moment opposes it."""
    theta = tyre.cornering_stiffness * abs(tan_alpha) / limit
    p = PLATEAU if theta >= PRINTED_KNOT else theta * (1 - theta * (0.0668 + 0.1032 * theta))
    return math.copysign(limit * p, tan_alpha), -math.copysign(limit * tyre.trail * aligning_arm(theta), tan_alpha)


@tyre_force.register(FialaTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    fy, mz = _printed_lateral(tyre, tan_alpha, friction * load + TINY)
    return tyre.slip_stiffness * kappa, fy, mz, tyre.slip_stiffness


@tyre_force.register(EllipseTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    # Longitudinal force first, up to the friction; the lateral force takes what the ellipse leaves.
    limit = friction * load + TINY
    fy, mz = _printed_lateral(tyre, tan_alpha, limit)
    fx = tyre.slip_stiffness * kappa
    slope = tyre.slip_stiffness
    if abs(fx) >= limit:
        fx, slope = math.copysign(limit, kappa), 0.0
    left = math.sqrt(max(0.0, 1 - (fx / limit) ** 2))
    return fx, left * max(-limit, min(limit, fy)), left * mz, slope
