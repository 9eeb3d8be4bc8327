"""The low-pass, the reliability test and the running median, beside scipy's and their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal
from scipy.ndimage import median_filter

from vse_gym.inference.pretreatment import BESSEL, low_pass, low_pass_step, reliable, running_median

CORNER, DT = 100.0, 0.01


def run(step, memory, values, *settings):
    return np.array([step(*settings, memory, value) for value in values])


def filtered(coefficients, values):
    memory = np.zeros(3)
    return np.array([low_pass_step(coefficients, memory, float(value)) for value in values])


ANALOG = {1.0: ([1e4], [1, 200, 1e4]), BESSEL: signal.bessel(2, CORNER, analog=True, norm="phase")}


@pytest.mark.parametrize("damping", ANALOG, ids=["as printed", "Bessel"])
def test_the_low_pass_is_the_bilinear_transform_of_its_transfer_function(damping):
    b, a = signal.bilinear(*ANALOG[damping], fs=1 / DT)
    mine = low_pass(CORNER, damping, DT)
    np.testing.assert_allclose([*mine[:3], 1.0, *mine[3:]], [*b, *a], rtol=1e-12)


@pytest.mark.parametrize("damping", ANALOG)
def test_its_step_response_is_scipys(damping):
    b, a = signal.bilinear(*ANALOG[damping], fs=1 / DT)
    step = np.ones(60)
    np.testing.assert_allclose(filtered(low_pass(CORNER, damping, DT), step), signal.lfilter(b, a, step), atol=1e-13)


def test_its_frequency_response_is_the_analog_one_on_a_bent_frequency_axis():
    # The bilinear transform maps w to 2/dt tan(w dt/2): all that it changes.
    w = np.array([1.0, 20.0, 100.0, 250.0])
    impulse = filtered(low_pass(CORNER, 1.0, DT), np.eye(1, 400)[0])
    response = np.exp(-1j * np.outer(w * DT, np.arange(400))) @ impulse
    _, analog = signal.freqs(*ANALOG[1.0], worN=2 / DT * np.tan(w * DT / 2))
    np.testing.assert_allclose(response, analog, atol=1e-12)


def test_a_slow_signal_is_late_by_what_the_transfer_function_says():
    late = filtered(low_pass(CORNER, 1.0, DT), DT * np.arange(400.0))  # a ramp
    assert DT * 399 - late[-1] == pytest.approx(2 / CORNER, rel=1e-9)


def test_the_bessel_filters_of_both_norms_have_these_dampings():
    # The one is flat in its delay as the other; they differ in what is called the corner.
    for norm, corner in (("phase", CORNER), ("delay", CORNER * math.sqrt(3))):
        _, a = signal.bessel(2, CORNER, analog=True, norm=norm)
        assert math.sqrt(a[2]) == pytest.approx(corner)
        assert a[1] / (2 * corner) == pytest.approx(BESSEL)


def test_a_silent_sensor_repeats_its_last_reading():
    values = np.array([0.0, 1.0, np.nan, np.nan, 2.0, np.nan])
    spoken = np.array([0.0, 1.0, 1.0, 1.0, 2.0, 2.0])
    coefficients = low_pass(CORNER, 1.0, DT)
    np.testing.assert_array_equal(filtered(coefficients, values), filtered(coefficients, spoken))


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30), st.sampled_from([1, 3, 5, 9]))
def test_the_running_median_is_scipys(values, length):
    mine = run(running_median_step, np.zeros(1 + length), values)
    whole = median_filter(np.array(values), length, origin=length // 2)  # of a value and those before it
    np.testing.assert_array_equal(mine[length - 1 :], whole[length - 1 :])


@given(st.lists(st.floats(-10, 10) | st.just(float("nan")), min_size=1, max_size=30))
def test_the_running_median_passes_over_silence(values):
    mine, heard = run(running_median_step, np.zeros(6), values), []
    for value, median in zip(values, mine, strict=True):
        heard += [value] if value == value else []
        expected = np.median(heard[-5:]) if heard else np.nan
        np.testing.assert_array_equal(median, expected)


def running_median_step(memory, value):
    return running_median(value, memory)


def replaced(values, references, band=1.0, patience=3.0):
    memory = np.zeros(2)
    return [reliable(float(v), float(r), band, patience, memory) for v, r in zip(values, references, strict=True)]


def test_a_reading_outside_the_band_is_replaced_by_the_last_good_one():
    assert replaced([0.5, 5.0, -5.0, 0.7], np.zeros(4)) == [0.5, 0.5, 0.5, 0.7]
    assert replaced([0.5, 1.7, 5.0], [0, 1, 2]) == [0.5, 1.7, 1.7]  # the band goes with the reference


def test_after_its_patience_a_reading_is_believed_until_it_is_good_again():
    readings = [0.5, 5, 5, 5, 6, 7, 0.3, 5, 5]
    assert replaced(readings, np.zeros(9)) == [0.5, 0.5, 0.5, 0.5, 6, 7, 0.3, 0.3, 0.3]
    assert replaced(readings, np.zeros(9), patience=0.0) == readings


def test_silence_is_no_refusal():
    silent = float("nan")
    assert replaced([0.5, 5, silent, silent, silent, 5, 5, 5], np.zeros(8)) == [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 5]
