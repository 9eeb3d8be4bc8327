"""Noise found on line: off it changes nothing, on it is window matching, and it finds by how much R is wrong."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from vse_gym.inference.gaussian import Extended, filter_drive, filter_step
from vse_gym.inference.gaussian.innovation_adaptive import InnovationAdaptive, adaptive_memory
from vse_gym.inference.gaussian.square_root_cubature import SquareRootCubature

WINDOW, EXTENDED = 20, Extended()


def adaptive(linear, floor=0.01, cap=100.0, window=WINDOW, rule=EXTENDED, **gate):
    """The rule, and the model with room for its memory."""
    m = linear.R.size
    rule = InnovationAdaptive(rule, window, np.full(m, floor), np.full(m, cap), **gate)
    return rule, linear._replace(memory=adaptive_memory(m, window))


def start(model):
    return model.prior_mean, model.prior_cov, model.memory


@pytest.mark.parametrize("inner", [Extended(), SquareRootCubature()], ids=["extended", "square_root_cubature"])
def test_with_floor_and_cap_of_one_nothing_is_adapted(inner, linear, linear_drive):
    rule, model = adaptive(linear, 1.0, 1.0, rule=inner)
    mine = filter_drive(rule, model, *start(model), linear_drive.inputs, linear_drive.readings)
    theirs = filter_drive(inner, linear, *start(linear), linear_drive.inputs, linear_drive.readings)
    np.testing.assert_array_equal(mine[0], theirs[0])
    np.testing.assert_array_equal(mine[1], theirs[1])


def test_it_is_window_matching_as_filterpy_would_be_told_to(linear, linear_drive):
    rule, model = adaptive(linear, floor=0.25, cap=4.0)
    means, covs = filter_drive(rule, model, *start(model), linear_drive.inputs, linear_drive.readings)
    theirs = KalmanFilter(2, 3)
    theirs.x, theirs.P, theirs.F, theirs.Q = linear.prior_mean, linear.prior_cov, linear.F, linear.process_cov
    windows = [[], [], []]
    for k, (u, y) in enumerate(zip(linear_drive.inputs, linear_drive.readings, strict=True)):
        theirs.predict(B=linear.G, u=u)
        heard, factor = np.isfinite(y), np.ones(3)
        innovation, spread = y - linear.H @ theirs.x, np.diag(linear.H @ theirs.P @ linear.H.T)
        for i in np.nonzero(heard)[0]:
            windows[i] = [*windows[i], (innovation[i] ** 2 - spread[i]) / linear.R[i]][-WINDOW:]
            if len(windows[i]) == WINDOW:
                factor[i] = np.clip(np.mean(windows[i]), 0.25, 4.0)
        if heard.any():
            theirs.update(y[heard], R=np.diag((linear.R * factor)[heard]), H=linear.H[heard])
        np.testing.assert_allclose(means[k], theirs.x, atol=1e-9)  # difference quotients
        np.testing.assert_allclose(covs[k], theirs.P, atol=1e-9)


def drive(linear, truth, steps, rng):
    """Inputs and readings of the linear model whose noise variances are ``truth`` times what it says."""
    x, readings = linear.prior_mean, np.empty((steps, 3))
    for k in range(steps):
        x = rng.multivariate_normal(linear.F @ x, linear.process_cov)
        readings[k] = rng.normal(linear.H @ x, np.sqrt(truth * linear.R))
    return np.zeros((steps, 1)), readings


def factors(rule, model, inputs, readings):
    """What the windows say at the end, (m,)."""
    m = readings.shape[1]
    mean, kept, memory = start(model)
    for u, y in zip(inputs, readings, strict=True):
        mean, kept, memory, _, _ = filter_step(rule, model, mean, kept, memory, u, y)
    return memory[m : m * (1 + rule.window)].reshape(m, rule.window).mean(axis=1)


def test_it_finds_by_how_much_the_noise_is_wrong(linear):
    # The scatter of a mean of 2000 squares is sqrt(2/2000), 3 %, times (1 + HPH/R) of up to 3 where R is too large.
    truth = np.array([0.5, 9.0, 3.0])
    rule, model = adaptive(linear, window=2000)
    found = factors(rule, model, *drive(linear, truth, 4000, np.random.default_rng(3)))
    np.testing.assert_allclose(found, truth, rtol=0.2)


def test_a_wrong_noise_costs_less_when_it_is_found(linear):
    truth = np.array([25.0, 25.0, 25.0])
    inputs, readings = drive(linear, truth, 2000, np.random.default_rng(4))
    best, _ = filter_drive(Extended(), linear._replace(R=truth * linear.R), *start(linear), inputs, readings)
    wrong, _ = filter_drive(Extended(), linear, *start(linear), inputs, readings)
    rule, model = adaptive(linear, window=50)
    found, _ = filter_drive(rule, model, *start(model), inputs, readings)
    far, near = (np.sqrt(np.mean((m[100:] - best[100:]) ** 2)) for m in (wrong, found))
    assert near < 0.4 * far


def test_what_the_gate_refuses_teaches_nothing(linear, linear_drive):
    wild = linear_drive.readings.copy()
    wild[30::10, 0] = 1e4
    rule, model = adaptive(linear, limit=25.0, patience=1e9)
    silent = np.where(wild == 1e4, np.nan, wild)
    mine = filter_drive(rule, model, *start(model), linear_drive.inputs, wild)
    theirs = filter_drive(rule, model, *start(model), linear_drive.inputs, silent)
    np.testing.assert_array_equal(mine[0], theirs[0])
