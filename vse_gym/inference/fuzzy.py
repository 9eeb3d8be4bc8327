"""A fuzzy controller of two inputs, computed once into a surface that kernels interpolate.

Triangular sets that overlap at half height, rules joined by product, conclusions added, centre of gravity: the
product-sum-gravity method of Mizumoto (1991). With output sets of one width its surface is exactly the bilinear
interpolation between the rules' conclusions, so monotone rules give a monotone surface. Mamdani's min-max-gravity
would not: with the table below it dips by up to 0.02 of a decade between the rules.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled

SETS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")  # of each input, centres equally spaced over [-1, 1]
OUTPUTS = ("PVS", "PS", "PMS", "PM", "PMB", "PB", "PBB", "PVB")  # of the factor U, from a sixth to a hundred
CENTRES = tuple(round(-0.8 + 0.4 * k, 1) for k in range(len(OUTPUTS)))  # of the output sets [log10 U]

# The published table is lost. This one is chosen: a row for each set of e, a column for each set of its change. It is
# monotone in both, a positive e raises the factor, a negative one lowers it, and at e = 0 it is 1.
RULES = """
    PVS PVS PVS PVS PVS PS  PS
    PVS PVS PVS PS  PS  PS  PS
    PVS PVS PS  PS  PS  PS  PS
    PMS PMS PMS PMS PMS PMS PMS
    PM  PM  PM  PM  PMB PMB PMB
    PM  PMB PMB PB  PB  PBB PBB
    PB  PBB PBB PVB PVB PVB PVB
"""


def rule_surface() -> NDArray[np.float64]:
    """Conclusion of each pair of input sets, log10 U, (7, 7): rows are e, columns its change."""
    rows = [[CENTRES[OUTPUTS.index(name)] for name in line.split()] for line in RULES.strip().splitlines()]
    return np.array(rows)


@compiled
def _place(value, count):
    """Cell of an input on the grid of ``count`` centres over [-1, 1], and where in it; beyond the ends, the ends."""
    at = 0.5 * (count - 1) * (1 + max(-1.0, min(1.0, value)))
    cell = min(int(at), count - 2)
    return cell, at - cell


@compiled
def fuzzy_factor(surface, e, change):
    """The factor U = 10^surface at two inputs in [-1, 1], held to the ends beyond; 1 where one of them is NaN."""
    if math.isnan(e) or math.isnan(change):
        return 1.0
    i, s = _place(e, surface.shape[0])
    j, t = _place(change, surface.shape[1])
    low = (1 - t) * surface[i, j] + t * surface[i, j + 1]
    high = (1 - t) * surface[i + 1, j] + t * surface[i + 1, j + 1]
    return 10 ** ((1 - s) * low + s * high)
