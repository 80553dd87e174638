"""The learning filter against scipy's own, and what it must let through and keep out."""

import numpy as np
from scipy import signal

from cruise.estimation.filters import LearningFilter


def test_the_low_pass_is_scipys_butterworth():
    rows = np.random.default_rng(0).standard_normal((200, 3))
    learning = LearningFilter(3, 0.05, 1.0, 15.0)
    ours = np.array([learning(row)[0] for row in rows])
    theirs = signal.sosfilt(signal.butter(2, 1.0, fs=20.0, output="sos"), rows, axis=0)
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_a_settled_filter_shows_a_constant_at_once_and_its_band_shows_nothing():
    learning = LearningFilter(2, 0.2, 1.0, 15.0)
    row = np.array([3.0, -2.0])
    learning.settle(row)
    for _ in range(50):
        low, band = learning(row)
        np.testing.assert_allclose(low, row, atol=1e-9)
        np.testing.assert_allclose(band, 0.0, atol=1e-9)


def test_the_band_forgets_an_offset_with_its_time_constant():
    learning = LearningFilter(1, 0.2, 1.0, 15.0)
    learning.settle(np.zeros(1))
    bands = [learning(np.ones(1))[1, 0] for _ in range(round(45 / 0.2))]
    assert bands[round(15 / 0.2)] < 0.45
    assert abs(bands[-1]) < 0.06


def test_a_linear_relation_survives_filtering():
    rows = np.random.default_rng(1).standard_normal((300, 3))
    learning = LearningFilter(4, 0.2, 1.0, 15.0)
    weights = np.array([0.3, -1.0, 2.0])
    for row in rows:
        for out in learning(np.array([row @ weights, *row])):
            assert abs(out[0] - out[1:] @ weights) < 1e-9


def test_a_slow_recording_passes_unfiltered():
    learning = LearningFilter(2, 0.5, 1.0, 15.0)
    np.testing.assert_array_equal(learning(np.array([1.0, 2.0]))[0], [1.0, 2.0])
