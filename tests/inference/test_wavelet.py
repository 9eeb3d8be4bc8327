"""The noise level by wavelets: PyWavelets' coefficients, the law of a median, silence."""

import numpy as np
import pytest
import pywt
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from vse_gym.inference.wavelet import DONOHO, PRINTED, listen, median, noise_level
from vse_gym.noise import cauchy_gaussian

VALUES = st.floats(-1e3, 1e3)
WINDOW = 64


@given(st.integers(1, 32).flatmap(lambda pairs: arrays(float, 2 * pairs, elements=VALUES)))
def test_the_details_are_those_of_pywavelets(x):
    level = noise_level(np.ones(1), WINDOW)
    for y in x:
        level = listen(level, np.array([y]), 0.1, DONOHO)
    # Of every reading and the one before it: the pairs of a transform are every other one of them.
    _, details = pywt.dwt(x, "haar")
    np.testing.assert_allclose(level.details[0, 1 : x.size : 2], np.abs(details), rtol=1e-12, atol=1e-12)


@given(arrays(float, st.integers(1, 40), elements=VALUES))
def test_a_median_by_selection_is_that_of_sorting(x):
    assert median(x.copy(), x.size) == np.median(x)


def heard(readings, window=WINDOW, smoothing=0.1, constant=DONOHO, start=1.0):
    """R after every reading (T, m): (T, m)."""
    level, out = noise_level(np.full(readings.shape[1], start), window), []
    for y in readings:
        level = listen(level, y, smoothing, constant)
        out.append(level.variances)
    return np.array(out)


@given(arrays(float, 16, elements=VALUES))
def test_the_level_is_that_of_the_last_windows_finest_details(x):
    variance = 1.0
    for k, found in enumerate(heard(x[:, None], window=8)[:, 0]):
        if k >= 7:
            sigma = np.median(np.abs(pywt.wavedec(x[k - 7 : k + 1], "haar", level=1)[-1])) / 0.6745
            variance = 0.9 * variance + 0.1 * sigma**2
        assert found == pytest.approx(variance, rel=1e-12)


@pytest.mark.parametrize("decibel", [-10, -5, 0, 5, 10])
def test_over_20_db_the_variance_is_found_within_10_percent(decibel):
    # On a signal that swings by 2 m/s2 at 0.2 Hz, whose own details add 2 % to the lowest variance, at most; a squared
    # median of 32 lies 4 % too high in the mean.
    sigma, time = 0.3 * 10 ** (decibel / 20), 0.01 * np.arange(20_000)
    x = 2 * np.sin(2 * np.pi * 0.2 * time) + np.random.default_rng(1).normal(0, sigma, time.size)
    found = heard(x[:, None], start=sigma**2)[WINDOW:, 0]
    assert found.mean() == pytest.approx(sigma**2, rel=0.1)


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("scale", [1.0, 5.0])
def test_contamination_biases_it_as_the_law_of_the_median_says(share, scale):
    # The median of |d| under the mixture, by its distribution: a difference of two readings holds none, one or two
    # Cauchy variates, each of ``scale`` core sigmas. One with a Gaussian is Voigt's law: by simulation.
    rng, size = np.random.default_rng(2), 400_000
    heavy = rng.random((2, size)) < share
    z = np.where(heavy, scale * rng.standard_cauchy((2, size)), rng.standard_normal((2, size)))
    wanted = np.median(np.abs(z[0] - z[1])) / np.sqrt(2) / DONOHO
    published = {0.05: (1.03, 1.10), 0.1: (1.06, 1.22), 0.2: (1.14, 1.50)}[share][scale > 1]
    assert wanted == pytest.approx(published, abs=0.03)
    found = heard(z[0][:20_000, None])[1000:, 0]
    # The mean of sigma^2 lies above the square of the median's limit by the scatter of a median of 32: 3 to 10 %.
    assert np.sqrt(np.median(found)) == pytest.approx(wanted, rel=0.1)


def test_single_medians_scatter_by_a_fifth_and_smoothing_takes_most_of_it():
    x = np.random.default_rng(3).standard_normal((40_000, 1))
    single, smooth = (np.sqrt(heard(x, smoothing=s)[200:, 0]) for s in (1.0, 0.1))
    # Of a median of 32: density at the quartile, 0.3178, gives 0.5/(sqrt(32) 2 0.3178 0.6745)
    law = 0.5 / (np.sqrt(WINDOW / 2) * 2 * stats.norm.pdf(stats.norm.ppf(0.75)) * DONOHO)
    assert single.std() == pytest.approx(law, rel=0.1)
    assert smooth.std() < 0.75 * single.std()


def test_as_printed_it_is_louder_by_the_ratio_of_the_constants():
    x = np.random.default_rng(4).standard_normal((200, 2))
    ours, printed = heard(x, start=0.0), heard(x, constant=PRINTED, start=0.0)
    np.testing.assert_allclose(printed[WINDOW:], ours[WINDOW:] * (0.6745 / 0.627) ** 2, rtol=1e-12)


def test_before_the_window_is_full_the_data_sheet_holds():
    found = heard(100 * np.random.default_rng(5).standard_normal((WINDOW + 1, 1)), start=0.04)
    assert np.all(found[: WINDOW - 1] == 0.04)
    assert np.all(found[WINDOW - 1 :] > 100)


def test_silence_says_nothing_of_the_noise():
    rng = np.random.default_rng(6)
    x = rng.standard_normal((1000, 3))
    silent = x.copy()
    silent[300:700, 1] = np.nan
    silent[rng.random(1000) < 0.1, 2] = np.nan
    found = heard(silent)
    np.testing.assert_array_equal(found[:, 0], heard(x)[:, 0])  # each channel on its own
    np.testing.assert_array_equal(found[331:700, 1], found[331, 1])  # half its pairs gone: as it was
    assert np.isfinite(found).all()
    assert found[100:, 2].mean() == pytest.approx(1.0, rel=0.15)


def test_one_burst_moves_it_little():
    x = 0.1 * np.random.default_rng(7).standard_normal((300, 1))
    burst = x.copy()
    burst[150:158] += 8.0
    assert heard(burst)[:, 0].max() < 2 * heard(x)[:, 0].max()


def test_listening_edits_nothing():
    level = noise_level(np.ones(2), 4)
    before = [np.copy(part) for part in level]
    listen(level, np.ones(2), 0.1, DONOHO)
    for part, old in zip(level, before, strict=True):
        np.testing.assert_array_equal(part, old)


@pytest.mark.parametrize("window", [0, 3, -2])
def test_a_window_without_pairs_is_refused(window):
    with pytest.raises(ValueError, match="an even number of readings"):
        noise_level(np.ones(1), window)


def test_the_sensors_own_law_is_heard_near_its_core():
    # alpha 1.5: a share of 0.26 with the core's sigma over sqrt 2; the filter scales its likelihood by this.
    z = cauchy_gaussian(1.5, np.sqrt(0.5), (20_000, 1), np.random.default_rng(8))
    assert 1.0 < np.sqrt(np.median(heard(z)[1000:])) < 1.35
