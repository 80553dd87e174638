"""The cross-correlation finds known delays, and its bound holds as often as it says."""

import numpy as np
import pytest
from scipy import signal

from cruise.identification.explore import CrossCorrelation, NotPossible, cross_correlation
from tests.identification.explore.drives import DT_S, lag, noise, recording, steps, through, white


def correlated(u, y, whiten=None) -> CrossCorrelation:
    found = cross_correlation([recording(u, y)], whiten)
    assert isinstance(found, CrossCorrelation)
    return found


def red(samples: int, seed: int, pole: float) -> np.ndarray:
    return np.asarray(signal.lfilter([1.0], [1.0, -pole], np.random.default_rng(seed).standard_normal(samples)))


@pytest.mark.parametrize("delay", [0, 4, 15])
def test_a_white_input_shows_the_delay_of_a_known_lag(delay):
    u = white(4000, 1)
    found = correlated(u, through(*lag(1.0), delay, u) + noise(4000, 1))
    assert found.whitening_order == 0
    # The lag's own response begins, and is greatest, one sample after the current.
    assert found.peak_lag_s == pytest.approx((delay + 1) * DT_S, abs=0.6 * DT_S)
    assert found.delay_s == pytest.approx((delay + 1) * DT_S, abs=DT_S)


@pytest.mark.parametrize("make", [steps, lambda n, seed: 700.0 + 60.0 * red(n, seed, 0.9)])
def test_a_coloured_input_is_whitened_first(make):
    u = make(8000, 3)
    y = through(*lag(1.0), 14, u) + noise(8000, 3, 0.01)
    found = correlated(u, y)
    assert found.whitening_order >= 1
    assert found.peak_lag_s == pytest.approx(15 * DT_S, abs=1.1 * DT_S)
    plain = correlated(u, y, whiten=False)
    assert plain.whitening_order == 0
    assert abs(plain.peak_lag_s - 0.75) > abs(found.peak_lag_s - 0.75)


def test_a_peak_between_two_lags_is_interpolated():
    u = white(20_000, 4)
    fir = np.zeros(16)
    fir[11:15] = [0.5, 1.0, 1.0, 0.5]  # its middle lies at 12.5 samples
    found = correlated(u, 0.003 * np.convolve(u, fir)[: len(u)])
    assert found.peak_lag_s == pytest.approx(12.5 * DT_S, abs=0.2 * DT_S)


@pytest.mark.parametrize("poles", [(0.0, 0.0), (0.7, 0.8), (0.9, 0.9)])
def test_the_bound_of_unrelated_signals_holds_as_often_as_it_says(poles):
    outside, peaks = [], []
    for seed in range(60):
        u, y = red(3000, seed, poles[0]), red(3000, 500 + seed, poles[1])
        found = correlated(u, y, whiten=False)
        outside.append(np.mean(np.abs(found.correlation) > found.bound))
        peaks.append(found.delay_s is not None)
    assert 0.03 < np.mean(outside) < 0.07
    assert np.mean(peaks) <= 0.1


def test_a_gap_joins_nothing():
    u = white(3000, 6)
    y = through(*lag(1.0), 9, u)
    u[1000:1100] = np.nan
    pieces = [recording(u[:1000], y[:1000]), recording(u[1100:], y[1100:])]
    holed, apart = cross_correlation([recording(u, y)]), cross_correlation(pieces)
    assert isinstance(holed, CrossCorrelation)
    assert isinstance(apart, CrossCorrelation)
    np.testing.assert_array_equal(holed.correlation, apart.correlation)


def test_pieces_shorter_than_the_whitening_filter_say_nothing():
    u = red(6000, 7, 0.9)
    y = through(*lag(1.0), 14, u) + noise(6000, 7, 0.01)
    u[3000::8] = np.nan
    found = correlated(u, y)
    assert found.whitening_order >= 1
    assert found.samples <= 3000
    assert found.delay_s == pytest.approx(15 * DT_S, abs=1.1 * DT_S)


def test_a_slow_drive_begins_before_its_peak_though_noise_breaks_the_way_there():
    delays = []
    for seed in range(20):
        u = white(4000, seed)
        y = through(*lag(1.5), 9, np.asarray(signal.lfilter([0.03], [1.0, -0.97], u - 700.0)))
        delays.append(correlated(u, y + noise(4000, seed, 0.2)).delay_s)
    assert None not in delays
    assert np.quantile(delays, 0.8) < 0.8
    assert np.median(delays) == pytest.approx(10 * DT_S, abs=0.2)


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        (np.full(200, 5.0), noise(200, 1), "the current is constant"),
        (white(30, 1), noise(30, 1), "too short for a cross-correlation"),
    ],
)
def test_what_cannot_be_estimated_is_said(u, y, says):
    found = cross_correlation([recording(u, y)])
    assert isinstance(found, NotPossible)
    assert says in found.reason
