"""One force law per tyre type.

Slip is (kappa, tan_alpha): kappa the slip ratio, positive when driving; alpha the slip angle, steer minus the angle
of the wheel's velocity, so that positive alpha pushes left.
"""

import math

from vse_gym.compiled import compiled, generic
from vse_gym.physics.parameters import DugoffTyre, EllipseTyre, FialaTyre, LinearTyre, MagicFormulaTyre, PolynomialTyre

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


@compiled
def _load_share(tyre, load):
    """What the load makes of a tyre's stiffness: a factor."""
    return load / tyre.reference_load if tyre.reference_load > 0 else 1.0


@tyre_force.register(PolynomialTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    # The vector form: the polynomial acts on the length of the normalised slip vector. Force and slip have the same
    # sign in each direction, so the tyre never creates power, and hypot(fx, fy) <= 1.0063 friction load.
    limit = friction * load + TINY
    share = _load_share(tyre, load)
    slip_stiffness = share * tyre.slip_stiffness
    fx, fy = slip_stiffness * kappa, share * tyre.cornering_stiffness * tan_alpha  # of a tyre that never slides
    u = math.sqrt(fx * fx + fy * fy) / limit + TINY  # so that a rolling tyre has a direction too
    p, dp = polynomial(u)
    inverse = 1 / u
    secant, cx = p * inverse, fx / limit * inverse
    return secant * fx, secant * fy, 0.0, slip_stiffness * (secant + (dp - secant) * cx * cx)


@compiled
def magic_formula(x, shape, curvature):
    """The Magic Formula sin(C atan(x - E (x - atan x))) of x = B slip >= 0, and its slope. Pacejka (2012), 4.3.

    Returns:
        value, slope: value in [0, 1], slope C at x = 0; the force is D times the value, and C B D the stiffness.
    """
    bent = math.atan(x)
    argument = x - curvature * (x - bent)
    angle = shape * math.atan(argument)
    slope = shape * math.cos(angle) / (1 + argument * argument) * (1 - curvature * x * x / (1 + x * x))
    return math.sin(angle), slope


@tyre_force.register(MagicFormulaTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    # Similarity, Pacejka (2012), 4.2: each force takes its pure-slip curve at the length of the vector of both
    # slips, (Bx kappa, By tan(alpha)), and its component's share of it. Force and slip have the same sign in each
    # direction; (fx/peak_x)^2 + (fy/peak_y)^2 <= (friction load)^2. B does not depend on the load.
    grip = tyre.reference_load * friction
    stiffness_x = tyre.slip_stiffness / (tyre.shape_x * tyre.peak_x * grip)
    stiffness_y = tyre.cornering_stiffness / (tyre.shape_y * tyre.peak_y * grip)
    ux, uy = stiffness_x * kappa, stiffness_y * tan_alpha
    u = math.sqrt(ux * ux + uy * uy) + TINY
    cx, cy = ux / u, uy / u
    along, rise = magic_formula(u, tyre.shape_x, tyre.curvature_x)
    across, _ = magic_formula(u, tyre.shape_y, tyre.curvature_y)
    secant = along / u
    limit_x, limit_y = tyre.peak_x * friction * load, tyre.peak_y * friction * load
    slope = limit_x * stiffness_x * (secant + (rise - secant) * cx * cx)
    return limit_x * along * cx, limit_y * across * cy, 0.0, max(0.0, slope)


@tyre_force.register(DugoffTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    # Dugoff, Fancher, Segel, SAE 700377 (1970), with one friction at every speed of sliding: up to half the friction
    # the whole contact sticks. Slip is relative to the speed 1 + kappa at which the tread passes, in parts of the
    # car's; written so that a locked wheel, where it is zero, gives all its friction.
    limit, passing = friction * load, abs(1 + kappa)
    ux, uy = tyre.slip_stiffness * kappa, tyre.cornering_stiffness * tan_alpha
    u = math.sqrt(ux * ux + uy * uy) + TINY
    cx, cy = ux / u, uy / u
    forward = math.copysign(1.0, 1 + kappa)
    if 2 * u <= limit * passing:
        slope = tyre.slip_stiffness * (passing - forward * kappa) / (passing * passing)
        return ux / passing, uy / passing, 0.0, max(0.0, slope)
    left = 0.25 * limit / u  # of the friction, what sticking still keeps from use, per passing speed
    force = limit * (1 - left * passing)
    slope = (
        tyre.slip_stiffness * limit / u * (cy * cy - left * passing * (cy * cy - cx * cx)) - limit * left * cx * forward
    )
    return force * cx, force * cy, 0.0, max(0.0, slope)


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


@compiled
def _within(force, limit, slope):
    """A force up to its limit, and its slope, which ends there."""
    return (force, slope) if abs(force) < limit else (math.copysign(limit, force), 0.0)


@tyre_force.register(EllipseTyre)
@compiled
def _(tyre, kappa, tan_alpha, load, friction):
    # Longitudinal force first, up to the friction; the lateral force takes what the ellipse leaves.
    limit = friction * load + TINY
    fy, mz = _printed_lateral(tyre, tan_alpha, limit)
    fx, slope = _within(tyre.slip_stiffness * kappa, limit, tyre.slip_stiffness)
    left = math.sqrt(max(0.0, 1 - (fx / limit) ** 2))
    return fx, left * max(-limit, min(limit, fy)), left * mz, slope
