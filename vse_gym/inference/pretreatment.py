"""What readings go through before a filter hears them: a low-pass, a test of their reliability, a running median.

Each works on a slice of a flat memory, in place. NaN is a sensor that stayed silent.
"""

import math
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled

BESSEL = math.sqrt(3) / 2  # damping of the second-order Bessel filter whose phase at its corner is a right angle [-]


class LowPass(NamedTuple):
    """Second order in steps: y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y'', a prime for each step back."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


def low_pass(corner: float, damping: float, dt: float) -> LowPass:
    """H(s) = w^2/(s^2 + 2 damping w s + w^2) with w = ``corner`` [rad/s], by the bilinear transform.

    Bilinear without prewarping: it keeps the delay of slow signals, 2 damping/w, to the second order in w dt, where the
    zero-order hold would add half a step and one more; the gain falls to zero at half the sampling rate. Its price is
    that the corner lies at 2/dt atan(w dt/2), 7 % too low at 100 rad/s and 10 ms.
    """
    k = 2 / (corner * dt)
    scale = 1 / (k * k + 2 * damping * k + 1)
    return LowPass(scale, 2 * scale, scale, 2 * (1 - k * k) * scale, (k * k - 2 * damping * k + 1) * scale)


@compiled
def low_pass_step(low_pass, memory, value):
    """The output after one more value; a silent sensor repeats its last one.

    Args:
        low_pass: Coefficients.
        memory: Last value heard, and the two sums of the transposed direct form II, (3,).
        value: Reading, or NaN.
    """
    if not math.isnan(value):
        memory[0] = value
    x = memory[0]
    out = low_pass.b0 * x + memory[1]
    memory[1] = low_pass.b1 * x - low_pass.a1 * out + memory[2]
    memory[2] = low_pass.b2 * x - low_pass.a2 * out
    return out


@compiled
def reliable(value, reference, band, patience, memory):
    """A value within ``band`` of its reference, as it is; for one beyond, or none, the last good one.

    A reference may be wrong for long, and the last good value older and older: one refused ``patience`` times in a row
    is believed, and so are those after it, until one lies within the band again.

    Args:
        value: Reading, or NaN.
        reference: What it should be about.
        band: Largest distance from it that is believed.
        patience: Readings.
        memory: The last good value, and how often in a row one has been refused, (2,).
    """
    if not math.isnan(value):
        if abs(value - reference) <= band:
            memory[0], memory[1] = value, 0.0
        elif memory[1] < patience:
            memory[1] += 1.0
        else:
            memory[0] = value
    return memory[0]


@compiled
def running_median(value, memory):
    """Median of the last k values, or of as many as there have been; NaN before the first. NaN is passed over.

    Args:
        value: Newest.
        memory: How many values there have been, then the last k of them in a ring, (1 + k,).
    """
    length = memory.size - 1
    if not math.isnan(value):
        memory[1 + int(memory[0]) % length] = value
        memory[0] += 1.0
    count = min(int(memory[0]), length)
    if count == 0:
        return np.nan
    ordered = np.empty(count)
    for i in range(count):
        j = i
        while j > 0 and ordered[j - 1] > memory[1 + i]:
            ordered[j] = ordered[j - 1]
            j -= 1
        ordered[j] = memory[1 + i]
    return 0.5 * (ordered[(count - 1) // 2] + ordered[count // 2])
