"""Laws of what goes wrong with a sensor: plain NumPy, each drawing from the generator that it is handed."""

import itertools
import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import quad

from vse_gym.types import Array

# Cauchy share of the Cauchy-Gaussian mixture for a characteristic exponent alpha. Both run from 1 to 0.
CONTAMINATIONS: dict[str, Callable[[float], float]] = {
    "published": lambda alpha: (4 - alpha**2) / (3 * alpha**2),
    "log_moment": lambda alpha: 2 / alpha - 1,
}


def contamination(alpha: float, rule: str = "published") -> float:
    """Cauchy share of the mixture that stands for a symmetric alpha-stable law, by one of two rules.

    ``published``, (4 - alpha^2)/(3 alpha^2), is that of Qin et al. (2014). ``log_moment``, 2/alpha - 1, gives the
    mixture the stable law's mean of log|x|, and half the distance to its distribution function.

    Raises:
        ValueError: If alpha lies outside [1, 2], or there is no such rule.
    """
    if rule not in CONTAMINATIONS:
        raise ValueError(f"alpha_rule must be one of {', '.join(CONTAMINATIONS)}, not {rule!r}")
    if not 1 <= alpha <= 2:
        raise ValueError(f"alpha must lie in [1, 2], not {alpha}")
    return CONTAMINATIONS[rule](alpha)


def cauchy_gaussian(
    alpha: float, scale: float, shape: tuple[int, ...], rng: np.random.Generator, rule: str = "published"
) -> Array:
    """Draws from the Cauchy-Gaussian mixture of Qin et al. (2014), unclipped.

    With probability share = contamination(alpha, rule) a Cauchy variate of this scale, else a normal one of variance
    2 scale^2. The density is (share scale)/(pi (x^2 + scale^2)) + (1 - share)/(2 sqrt(pi) scale) exp(-x^2/(4 scale^2)).
    """
    heavy = rng.random(shape) < contamination(alpha, rule)
    normal = np.sqrt(2) * scale * rng.standard_normal(shape)
    return np.where(heavy, scale * rng.standard_cauchy(shape), normal)


def fisher_information(share: float, sigma: float = 1.0, ratio: float = math.sqrt(0.5)) -> float:
    """Fisher information of the Cauchy-Gaussian mixture about its location, the integral of f'(x)^2/f(x).

    With a share of 0 it is 1/sigma^2, all Cauchy 1/(2 ratio^2 sigma^2); what is heard of a mixture lies below what its
    core alone would tell, and far above what its infinite variance suggests. By quadrature, to 1e-8 of it.

    Args:
        share: Of the Cauchy law in the mixture, in [0, 1] [-].
        sigma: Standard deviation of the Gaussian core.
        ratio: The Cauchy law's scale over sigma; sqrt(1/2) in the mixture of Qin et al. (2014) [-].

    Raises:
        ValueError: If the share is none, or a scale is not positive.
    """
    if not (0 <= share <= 1 and 0 < sigma < math.inf and 0 < ratio < math.inf):
        raise ValueError(f"share must lie in [0, 1], sigma and ratio be positive, not {share}, {sigma} and {ratio}")
    if share == 0:  # its density underflows long before infinity
        return 1 / sigma**2

    def integrand(z: float) -> float:
        core = (1 - share) / math.sqrt(2 * math.pi) * math.exp(-0.5 * z * z)
        tail = share * ratio / math.pi / (z * z + ratio * ratio)
        slope = z * core + 2 * z / (z * z + ratio * ratio) * tail
        return slope * slope / (core + tail) if core + tail > 0 else 0.0  # both may underflow

    edges = (0.0, *sorted((0.3 * ratio, ratio, 1.0, 3 * ratio, 3.0, 10.0)), math.inf)
    small = 1e-11 * min(1.0, 0.5 / ratio**2)  # beside what either law tells alone
    total = sum(quad(integrand, a, b, epsabs=small, epsrel=1e-10)[0] for a, b in itertools.pairwise(edges))
    return float(2 * total / sigma**2)


def student_t(normal: Array, freedom: float, rng: np.random.Generator) -> Array:
    """Student's t of scale 1 from standard normal draws, as Gosset has it: normal/sqrt(chi2/freedom).

    The scale is that of the density: its standard deviation is sqrt(freedom/(freedom - 2)), infinite up to a freedom
    of 2, where 1 is all Cauchy. The more degrees of freedom, the nearer each draw stays to the normal one it came from.

    Args:
        normal: Any shape.
        freedom: Degrees of freedom, at least 1 [-].
    """
    return normal / np.sqrt(rng.chisquare(freedom, normal.shape) / freedom)


def growing_sigma(time: Array, factor: float, begin: float, end: float) -> Array:
    """By what the sheet's sigma is multiplied at each time: 1 until the beginning, ``factor`` from the end on.

    Between them the *variance* rises in proportion to time.
    """
    share = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    return np.sqrt(1 + (factor**2 - 1) * share)


def random_walk(steps: int, channels: int, dt: float, rng: np.random.Generator) -> Array:
    """A Wiener process of density 1 per sqrt(s) in each channel, (steps, channels): variance t, zero at the start."""
    increments = math.sqrt(dt) * rng.standard_normal((steps, channels))
    increments[:1] = 0.0
    return np.cumsum(increments, axis=0)


def episodes(
    rate: float, shortest: float, longest: float, steps: int, channels: int, dt: float, rng: np.random.Generator
) -> Array:
    """When something goes wrong: (steps, channels) of 0 and, during an episode, its sign, +1 or -1.

    Args:
        rate: Episodes that begin per second and channel, a Poisson process [1/s].
        shortest, longest: Their length is uniform between these [s].
    """
    out = np.zeros((steps, channels))
    if rate == 0:
        return out
    begins = rng.random((steps, channels)) < -np.expm1(-rate * dt)
    lengths = np.rint(rng.uniform(shortest, longest, (steps, channels)) / dt).astype(int)
    signs = rng.choice([-1.0, 1.0], (steps, channels))
    for k, channel in zip(*np.nonzero(begins), strict=True):
        out[k : k + max(1, lengths[k, channel]), channel] = signs[k, channel]
    return out
