"""Autoregressions whose coefficients follow the series: adaptive autoregressive models (AAR)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.compiled import compiled

LARGEST = 1e6  # trace of A beyond which nothing is forgotten: it would wind up while a series says nothing
GIVEN = 1e-2  # variance of coefficients that were given, over the same
ROUNDING = 1e-9
HALVINGS = 6  # of a step, before it is refused


class AutoregressionTuning(NamedTuple):
    """How autoregressions learn."""

    rate: float  # update coefficient UC: what is t steps old counts (1 - UC)^t [-]
    noise_rate: float  # at which the variance of what is left unexplained follows [-]
    printed: float  # 1: the gain as Qin et al. (2014) print it; 0: that of least squares
    window: float  # coefficients come from least squares over so many samples, and until then are ``start`` [samples]
    radius: float  # no pole may lie farther from zero [-]
    start: NDArray[np.float64]  # a_0, newest sample first, (p,)


class Autoregressions(NamedTuple):
    """One autoregression of order p for each of n series."""

    coefficients: NDArray[np.float64]  # of the newest sample first, (n, p)
    covs: NDArray[np.float64]  # A: of the coefficients, over the variance of what they leave unexplained, (n, p, p)
    past: NDArray[np.float64]  # the series' last samples, newest first, (n, p)
    variances: NDArray[np.float64]  # of what the coefficients leave unexplained, (n,)
    time: float  # samples so far


def autoregressions(adaptation: AutoregressionTuning, first: NDArray[np.float64]) -> Autoregressions:
    """As if each series had had its first value (n,) for ever."""
    n, p = first.size, adaptation.start.size
    doubt = 0.0 if adaptation.printed else LARGEST / p if adaptation.window > 0 else GIVEN
    covs = np.tile(doubt * np.eye(p), (n, 1, 1))
    return Autoregressions(np.tile(adaptation.start, (n, 1)), covs, np.tile(first[:, None], p), np.zeros(n), 0.0)


@compiled
def is_stable(coefficients, radius):
    """Whether all poles of x_t = sum of a_k x_(t-k) lie within a radius, by stepping down. Jury (1964)."""
    p = coefficients.size
    c, before = np.empty(p), np.empty(p)
    scale = 1.0
    for k in range(p):
        scale *= radius * (1 + ROUNDING)
        c[k] = -coefficients[k] / scale
    for order in range(p, 0, -1):
        reflection = c[order - 1]
        if not abs(reflection) < 1:
            return False
        for k in range(order - 1):
            before[k] = c[k]
        for k in range(order - 1):
            c[k] = (before[k] - reflection * before[order - 2 - k]) / (1 - reflection * reflection)
    return True


@compiled
def retreat(stable, wanted, radius):
    """Halve the way from stable coefficients (p,) to wanted ones, in place, until no pole lies beyond the radius.

    Drawing all poles inwards would move that of a constant, at one, too: what was steady would begin to fade.
    """
    p = wanted.size
    for _ in range(HALVINGS):
        if is_stable(wanted, radius):
            return
        for k in range(p):
            wanted[k] = 0.5 * (wanted[k] + stable[k])
    for k in range(p):
        wanted[k] = stable[k]


@compiled
def coefficients_used(adaptation, ar):
    """The coefficients (n, p) to foretell with: those to start with until the first window is over."""
    if ar.time >= adaptation.window:
        return ar.coefficients
    used = np.empty_like(ar.coefficients)
    for i in range(used.shape[0]):
        used[i] = adaptation.start
    return used


@compiled
def _least_squares(a, cov, x, error, forgetting):
    """One step of recursive least squares with exponential forgetting, in place. Haykin (2014), chapter 10."""
    p = x.size
    gain, spread = np.zeros(p), forgetting
    for i in range(p):
        for j in range(p):
            gain[i] += cov[i, j] * x[j]
        spread += x[i] * gain[i]
    trace = 0.0
    for i in range(p):
        a[i] += gain[i] / spread * error
        for j in range(i + 1):
            cov[i, j] = cov[j, i] = cov[i, j] - gain[i] * gain[j] / spread
        trace += cov[i, i]
    if trace <= LARGEST * forgetting:
        for i in range(p):
            for j in range(p):
                cov[i, j] /= forgetting


@compiled
def _as_printed(a, cov, x, error, rate):
    """One step as Qin et al. (2014) print it, in place: A is no covariance but the mean of x x^T.

    Its gain grows with the third power of a small series, and takes a large one's whole error away at every step.
    """
    p = x.size
    direction, size = np.zeros(p), 0.0
    for i in range(p):
        for j in range(p):
            cov[i, j] = (1 - rate) * cov[i, j] + rate * x[i] * x[j]
            direction[i] += cov[i, j] * x[j]
        size += x[i] * direction[i]
    for i in range(p):
        a[i] += rate * direction[i] / (rate * size + 1) * error


@compiled
def adapt(adaptation, ar, values):
    """The autoregressions after one more sample of each series (n,). Schloegl (2000).

    e = x - a^T X; a += k e, with the gain k of recursive least squares that forgets at the rate UC, or the printed one;
    the variance of what is left unexplained follows e^2 at the same rate.
    """
    n, p = ar.coefficients.shape
    used = coefficients_used(adaptation, ar)
    coefficients, covs = ar.coefficients.copy(), ar.covs.copy()
    past, variances = np.empty((n, p)), np.empty(n)
    counted = max(adaptation.noise_rate, 1 / (ar.time + 1))  # a plain mean to begin with
    for i in range(n):
        x, foretold, error = ar.past[i], 0.0, values[i]
        for k in range(p):
            foretold += used[i, k] * x[k]
            error -= coefficients[i, k] * x[k]
        variances[i] = (1 - counted) * ar.variances[i] + counted * (values[i] - foretold) ** 2
        if adaptation.printed:
            _as_printed(coefficients[i], covs[i], x, error, adaptation.rate)
        elif ar.time < adaptation.window:
            _least_squares(coefficients[i], covs[i], x, error, 1.0)
        else:
            _least_squares(coefficients[i], covs[i], x, error, 1 - adaptation.rate)
        if ar.time + 1 >= adaptation.window:
            retreat(used[i], coefficients[i], adaptation.radius)
        past[i, 0] = values[i]
        for k in range(1, p):
            past[i, k] = x[k - 1]
    return Autoregressions(coefficients, covs, past, variances, ar.time + 1)
