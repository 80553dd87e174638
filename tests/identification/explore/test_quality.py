"""Faults that were put into data are found, and sound data are left in peace."""

import numpy as np
import pytest

from cruise.identification.explore import Feedback, Jitter, NotPossible, Quality, feedback, jitter, quality
from tests.identification.explore.drives import DT_S, lag, noise, recording, steps, through, white


def sound(samples: int = 4000, seed: int = 1, std_mps: float = 0.01):
    u = steps(samples, seed, hold=160)
    return u, through(*lag(1.0), 10, u) + noise(samples, seed, std_mps)


def examined(u, y) -> Quality:
    found = quality([recording(u, y)])
    assert isinstance(found, Quality)
    return found


def test_sound_data_are_left_in_peace():
    found = examined(*sound())
    assert found.lost_samples == 0
    assert found.outliers == 0
    assert found.stuck is None
    assert found.noise is not None
    assert found.noise.std_mps == pytest.approx(0.01, rel=0.2)
    said = " ".join(found.words())
    assert "no gap in 4000 samples" in said
    assert "no feedback" in said


def test_gaps_are_counted():
    u, y = sound()
    y[100:140] = np.nan
    u[2000:2010] = np.nan
    found = examined(u, y)
    assert found.lost_samples == 50
    assert found.longest_gap_s == pytest.approx(2.0)
    assert found.pieces == 3


def test_spikes_are_found_and_nothing_else():
    u, y = sound()
    places = [300, 1111, 1112, 2500]
    y[places] += [0.5, -0.4, -0.4, 0.3]
    np.testing.assert_allclose(examined(u, y).outlier_times_s, DT_S * np.array(places))


def test_an_overshoot_of_one_sample_is_no_spike():
    u = steps(4000, 1, hold=20)
    y = through(np.array([0.0, 0.003, -0.0008]), np.array([1.0, 0.0]), 10, u)
    assert examined(u, y + noise(4000, 1, 0.003)).outliers == 0


def test_a_sensor_that_hangs_is_found():
    u, y = sound()
    y[1100:1200] = y[1100]
    found = examined(u, y)
    assert found.stuck is not None
    assert found.stuck.start_s == pytest.approx(55.0)
    assert found.stuck.duration_s == pytest.approx(5.0)
    assert "the sensor hangs" in " ".join(found.words())


def test_a_sensor_that_clips_is_found():
    u, y = sound()
    limit = float(np.quantile(y, 0.9))
    found = examined(u, np.minimum(y, limit))
    assert found.output_share_at_high == pytest.approx(0.1, abs=0.01)
    assert "the sensor clips" in " ".join(found.words())
    assert examined(u, y).output_share_at_high < 0.01


def test_a_speed_in_coarse_digits_neither_hangs_nor_clips():
    u, y = sound()
    digit_mps = float(np.ptp(y)) / 4.0
    found = examined(u, np.round(y / digit_mps) * digit_mps)
    assert found.output_digit_mps == pytest.approx(digit_mps, abs=1e-6)
    assert found.output_digit_share == pytest.approx(0.25, rel=1e-3)
    words = " ".join(found.words())
    assert f"the speed comes in steps of {digit_mps:.2g} m/s, 25 % of its range" in words
    assert "clips" not in words
    assert "while the current moves: the sensor hangs" not in words
    assert "comes in steps" not in " ".join(examined(u, y).words())


@pytest.mark.parametrize("std_mps", [0.002, 0.006, 0.02])
@pytest.mark.parametrize("digit_mps", [0.001, 0.01, 0.1 / 3.6])
def test_the_noise_of_a_coarse_sensor_is_not_none(digit_mps, std_mps):
    u = np.repeat(np.random.default_rng(4).uniform(400.0, 900.0, 60), 200)  # 10 s each
    true_mps = through(*lag(1.0), 10, u)
    read_mps = np.round((true_mps + noise(len(u), 2, std_mps)) / digit_mps) * digit_mps
    found = examined(u, read_mps).noise
    assert found is not None
    assert found.std_mps == pytest.approx(float(np.sqrt(np.mean((read_mps - true_mps) ** 2))), rel=0.3)


def test_noise_is_seen_in_the_spectrum_where_the_current_never_rests():
    u = white(6000, 2)
    found = examined(u, through(*lag(0.2), 10, u) + noise(6000, 2, 0.2))
    assert found.noise is not None
    assert "spectrum" in found.noise.how
    assert found.noise.std_mps == pytest.approx(0.2, rel=0.15)


def test_jitter_of_time_stamps_is_measured_without_the_gaps():
    rng = np.random.default_rng(1)
    times_s = 0.1 * np.arange(5000) + 0.003 * rng.standard_normal(5000)
    times_s[2000:] += 7.0
    found = jitter([times_s])
    assert isinstance(found, Jitter)
    assert found.typical_step_s == pytest.approx(0.1, rel=1e-3)
    assert found.std_s == pytest.approx(0.003 * np.sqrt(2.0), rel=0.05)
    assert isinstance(jitter([]), NotPossible)


def closed_loop(samples: int, seed: int):
    """A proportional controller that holds 2 m/s against noise and steps of its own, through the known lag."""
    (_, b), (_, a) = lag(1.0)
    rng, extra = np.random.default_rng(seed), 0.2 * steps(samples, seed)
    u, y = np.full(samples, 700.0), np.full(samples, 2.1)
    for k in range(12, samples):
        y[k] = -a * y[k - 1] + b * u[k - 11] + 0.02 * rng.standard_normal()
        u[k] = 550.0 + extra[k] + 150.0 * (2.0 - y[k - 1])
    return u, y


def test_feedback_is_found_where_there_is_some():
    for seed in range(5):
        found = feedback([recording(*closed_loop(4000, seed))])
        assert isinstance(found, Feedback)
        assert found.found, found
        assert "hangs on the output" in found.words()[0]


@pytest.mark.parametrize("make", [steps, white, lambda n, seed: 700.0 + np.cumsum(white(n, seed) - 700.0) / 50.0])
def test_no_feedback_is_found_where_there_is_none(make):
    found = []
    for seed in range(10):
        u = make(4000, seed)
        verdict = feedback([recording(u, through(*lag(1.0), 10, u) + noise(4000, seed))])
        assert isinstance(verdict, Feedback)
        found.append(verdict.found)
    assert not any(found)


def test_experiments_of_another_kind_are_no_feedback():
    parts = []
    for make in (steps, white):
        u = make(6000, 3)
        parts.append(recording(u, through(*lag(1.0), 10, u) + noise(6000, 3)))
    verdict = feedback(parts)
    assert isinstance(verdict, Feedback)
    assert verdict.p_value > 0.01


def test_a_long_drive_with_a_trace_does_not_hide_a_short_closed_loop():
    u = steps(60_000, 5)
    y = through(*lag(1.0), 10, u) + noise(60_000, 5)
    u[5:] += 60.0 * (y[:-5] - y.mean())
    verdict = feedback([recording(u, y), recording(*closed_loop(1200, 5))])
    assert isinstance(verdict, Feedback)
    assert verdict.found


def test_many_short_recordings_are_tested_together():
    u, y = closed_loop(6000, 8)
    parts = [recording(u[k : k + 300], y[k : k + 300]) for k in range(0, 6000, 300)]
    assert isinstance(feedback(parts[:1]), NotPossible)
    verdict = feedback(parts)
    assert isinstance(verdict, Feedback)
    assert verdict.found
