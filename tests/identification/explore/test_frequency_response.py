"""The frequency response recovers known filters, and its band and intervals hold as often as they say."""

import numpy as np
import pytest
from scipy import signal

from cruise.identification.explore import FrequencyResponse, NotPossible, frequency_response
from tests.identification.explore.drives import DT_S, lag, noise, recording, through, white

DELAY = 10  # samples, 0.5 s
RATE_HZ = 1.0 / DT_S


def explored(b, a, seed: int, samples: int = 6000, noise_mps: float = 0.05, delay_s: float = 0.5) -> FrequencyResponse:
    u = white(samples, seed)
    y = through(b, a, DELAY, u) + noise(samples, seed, noise_mps)
    found = frequency_response([recording(u, y)], delay_s)
    assert isinstance(found, FrequencyResponse)
    return found


def response(b, a, frequency_hz: np.ndarray) -> np.ndarray:
    z = np.exp(-2j * np.pi * frequency_hz / RATE_HZ)
    return np.polyval(b[::-1], z) / np.polyval(a[::-1], z)


def lag_at_rest_s(b, a) -> float:
    """How late a ramp comes through."""
    low_hz = np.array([1e-4])
    return float(-np.angle(response(b, a, low_hz) / response(b, a, np.zeros(1)))[0] / (2.0 * np.pi * low_hz[0]))


def half_power_hz(b, a) -> float:
    f = np.linspace(0.001, 9.0, 20_000)
    gain = np.abs(response(b, a, f)) / np.abs(response(b, a, np.zeros(1)))
    return float(f[np.argmax(gain < np.sqrt(0.5))])


def low_pass(order: int, cutoff_hz: float) -> tuple[np.ndarray, np.ndarray]:
    designed = signal.butter(order, cutoff_hz, fs=RATE_HZ)
    assert designed is not None
    return 0.003 * np.asarray(designed[0]), np.asarray(designed[1])


def shelf() -> tuple[np.ndarray, np.ndarray]:
    """Two lags of 1.3 Hz, with 5 dB more around 1.7 Hz: the gain falls, rises again and falls."""
    s, at = 2.0 * np.pi, 2.0 * np.pi * 1.7
    top = np.array([1.0, 2.0 * 0.16 * at, at**2])
    bottom = np.polymul(np.array([1.0, 2.0 * 0.09 * at, at**2]), np.array([1.0 / (1.3 * s) ** 2, 2.0 / (1.3 * s), 1.0]))
    b_z, a_z = signal.bilinear(top, bottom, RATE_HZ)
    return 0.003 * np.asarray(b_z), np.asarray(a_z)


def test_gain_phase_and_lag_of_a_known_lag():
    b, a = lag(1.0)
    found = explored(b, a, seed=1, samples=24_000)
    known = found.frequency_hz < 3.0
    truth = response(b, a, found.frequency_hz)
    assert found.low_frequency_gain_mps_per_ma == pytest.approx(0.003, rel=0.02)
    np.testing.assert_allclose(found.gain_mps_per_ma[known], np.abs(truth)[known], rtol=0.12)
    late_deg = 360.0 * found.frequency_hz * DELAY * DT_S
    phase_deg = np.degrees(np.unwrap(np.angle(truth))) - late_deg
    np.testing.assert_allclose(found.phase_deg[known], phase_deg[known], atol=8.0)
    assert found.lag_s.value == pytest.approx(DELAY * DT_S + lag_at_rest_s(b, a), abs=0.01)


@pytest.mark.parametrize("cutoff_hz", [0.1, 0.16, 0.32, 1.0])  # windows resolve 0.05 Hz
@pytest.mark.parametrize("noise_mps", [0.01, 0.05])
def test_level_and_lag_are_those_of_slow_changes_however_slow_the_drive(cutoff_hz, noise_mps):
    b, a = lag(cutoff_hz)
    truth_s = DELAY * DT_S + lag_at_rest_s(b, a)
    found = [explored(b, a, seed, noise_mps=noise_mps) for seed in range(12)]
    held = [abs(one.lag_s.value - truth_s) < 1.96 * one.lag_s.std for one in found]
    assert sum(held) >= 10  # 95 %: fewer has a chance of 0.2 %
    assert np.mean([one.lag_s.std for one in found]) < 0.12 * truth_s
    assert np.mean([one.low_frequency_gain_mps_per_ma for one in found]) == pytest.approx(0.003, rel=0.05)


def test_a_ring_does_not_move_the_lag():
    b, a = shelf()
    found = explored(b, a, seed=1, samples=24_000, noise_mps=0.02)
    assert found.lag_s.value == pytest.approx(DELAY * DT_S + lag_at_rest_s(b, a), abs=0.03)  # of an order not its own
    assert found.low_frequency_gain_mps_per_ma == pytest.approx(0.003, rel=0.02)


def test_the_band_holds_the_true_gain_as_often_as_it_says():
    b, a = lag(1.0)
    inside, lows = [], []
    for seed in range(40):
        found = explored(b, a, seed, samples=3000, noise_mps=0.15)
        known = found.coherence > 0.3  # bins where the band is a band
        truth_db = 20.0 * np.log10(np.abs(response(b, a, found.frequency_hz)) / found.low_frequency_gain_mps_per_ma)
        hit = (found.gain_low_db < truth_db) & (truth_db < found.gain_high_db)
        inside.append(np.mean(hit[known & (found.frequency_hz < 1.5)]))
        lows.append(found.lag_s)
    assert 0.92 < np.mean(inside) < 0.98


def test_the_interval_of_the_cutoff_holds_the_true_one():
    b, a = lag(1.0)
    truth_hz = half_power_hz(b, a)
    found = [explored(b, a, seed, samples=3000).cutoff for seed in range(60)]
    assert all(found)
    inside = [cutoff.low_hz < truth_hz < cutoff.high_hz for cutoff in found if cutoff]
    assert np.mean(inside) >= 0.85
    assert np.mean([cutoff.frequency_hz for cutoff in found if cutoff]) == pytest.approx(truth_hz, rel=0.04)
    assert np.mean([cutoff.high_hz / cutoff.low_hz for cutoff in found if cutoff]) < 1.5


def test_a_bump_above_the_cutoff_is_found():
    b, a = shelf()
    gain = np.abs(response(b, a, np.linspace(1.0, 3.0, 400)))
    assert np.any(np.diff(gain) > 0.0)
    for seed in range(4):
        found = explored(b, a, seed, samples=12_000, noise_mps=0.03)
        assert found.cutoff is not None
        assert found.bump is not None
        assert found.bump.frequency_hz == pytest.approx(1.7, abs=0.15)
        assert found.bump.height_db == pytest.approx(5.0, abs=1.5)
        assert "bump of" in " ".join(found.words())


@pytest.mark.parametrize("order", [1, 2, 4])
def test_a_smooth_low_pass_has_no_bump(order):
    b, a = low_pass(order, 1.0)
    for seed in range(6):
        assert explored(b, a, seed, noise_mps=0.02).bump is None


def test_short_windows_are_not_biased_by_the_delay_once_it_is_taken_out():
    b, a = lag(1.0)
    parts, delay = [], 30  # 1.5 s
    for seed in range(40):
        u = white(200, seed)  # pieces of 10 s
        parts.append(recording(u, through(b, a, delay, u) + noise(200, seed)))
    aligned, plain = frequency_response(parts, 1.5), frequency_response(parts)
    assert isinstance(aligned, FrequencyResponse)
    assert isinstance(plain, FrequencyResponse)
    assert aligned.low_frequency_gain_mps_per_ma == pytest.approx(0.003, rel=0.03)
    assert plain.low_frequency_gain_mps_per_ma < 0.93 * aligned.low_frequency_gain_mps_per_ma
    assert aligned.lag_s.value == pytest.approx(1.5 + 0.05 + 1.0 / (2.0 * np.pi) - 0.025, abs=0.05)


def test_a_gap_splits_and_nothing_is_joined():
    b, a = lag(1.0)
    u = white(4000, 3)
    y = through(b, a, DELAY, u)
    holed = y.copy()
    holed[1500:1520] = np.nan
    apart = frequency_response([recording(u[:1500], y[:1500]), recording(u[1520:], y[1520:])])
    holes = frequency_response([recording(u, holed)])
    assert isinstance(apart, FrequencyResponse)
    assert isinstance(holes, FrequencyResponse)
    np.testing.assert_array_equal(apart.gain_mps_per_ma, holes.gain_mps_per_ma)


def test_a_drive_that_runs_backwards_has_a_negative_gain():
    b, a = lag(1.0, gain=-0.003)
    found = explored(b, a, seed=5)
    assert found.low_frequency_gain_mps_per_ma == pytest.approx(-0.003, rel=0.05)
    assert found.lag_s.value == pytest.approx(0.68, abs=0.05)
    assert found.cutoff is not None


def test_a_gain_that_falls_from_the_lowest_frequency_on_has_no_cutoff():
    found = explored(*lag(0.08), seed=1, samples=12_000)
    assert found.cutoff is None
    assert found.bump is None
    assert "no cut-off found" in " ".join(found.words())


def test_what_is_not_coherent_is_not_known():
    b, a = low_pass(6, 2.0)
    found = explored(b, a, seed=2, noise_mps=0.05)
    assert 2.5 < found.reliable_to_hz < 5.0
    assert "nothing can be said above" in found.words()[-1]


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        (np.full(2000, 700.0), noise(2000, 1), "the current is constant"),
        (white(2000, 1), np.full(2000, 2.0), "the speed is constant while the current moves: see to its sensor"),
        (white(2000, 1), noise(2000, 1), "no gain is known anywhere"),
        (white(60, 1), white(60, 1) / 300.0, "too short for a frequency response"),
        (white(60, 1), np.full(60, np.nan), "no sample has both"),
    ],
)
def test_what_cannot_be_estimated_is_said(u, y, says):
    found = frequency_response([recording(u, y)])
    assert isinstance(found, NotPossible)
    assert says in found.reason
