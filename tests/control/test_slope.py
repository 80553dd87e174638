"""The slope of the ground against motions written here: what is acceleration is no slope, what is slope is found."""

import math

import numpy as np
import pytest

from cruise.control.slope import SlopeObserver

FRAME_S, SPEED_NOISE_MPS = 0.05, 0.010
TIME_S = FRAME_S * np.arange(600)


def seen_deg(
    share: float, accel_mps2: np.ndarray, slope_deg: np.ndarray, noise: float = 1.0, pace: float = 1.0
) -> np.ndarray:
    """What the observer makes of a speed from 1 m/s on with 1 cm/s of noise, and of a pitch with 0.11 degrees."""
    rng = np.random.default_rng(0)
    speed_mps = 1.0 + FRAME_S * np.cumsum(accel_mps2) + 0.01 * noise * rng.standard_normal(len(TIME_S))
    pull_mps2 = 9.81 * np.sin(np.radians(slope_deg)) + share * accel_mps2
    pitch_deg = np.degrees(np.arcsin(pull_mps2 / 9.81)) + 0.11 * noise * rng.standard_normal(len(TIME_S))
    observer = SlopeObserver(share, FRAME_S, SPEED_NOISE_MPS)
    return np.array([observer.step(*one, pace) for one in zip(pitch_deg.tolist(), speed_mps.tolist(), strict=True)])


def step_of_speed() -> np.ndarray:
    """0.5 m/s2 for 2 s, begun and ended within 0.6 s: the pitch shows 2.9 degrees."""
    return 0.5 * np.clip(np.minimum((TIME_S - 10.0) / 0.6, (12.6 - TIME_S) / 0.6), 0.0, 1.0)


def test_acceleration_is_no_slope():
    """A fifth of the 2.9 degrees while it begins, nothing once it lasts."""
    assert np.abs(seen_deg(1.0, step_of_speed(), np.zeros(len(TIME_S)))[100:]).max() < 0.6


def test_a_sensor_that_shows_no_acceleration_is_believed_in_full():
    level, hill = np.zeros(len(TIME_S)), np.clip(TIME_S - 10.0, 0.0, 3.0)
    seen = seen_deg(0.0, step_of_speed(), hill, noise=0.0)
    np.testing.assert_allclose(seen, seen_deg(0.0, level, hill, noise=0.0), atol=1e-9)
    assert np.abs(seen - hill).max() < 0.3


@pytest.mark.parametrize("share", [1.0, 0.4])
def test_a_hill_is_found_on_the_way(share):
    """Five degrees within 3 s: less than half a second behind on the way up, and exact at the top."""
    hill = np.clip((TIME_S - 10.0) * 5.0 / 3.0, 0.0, 5.0)
    seen = seen_deg(share, step_of_speed(), hill, noise=0.0)
    assert np.abs(seen - hill).max() < 0.5 * 5.0 / 3.0
    assert seen[-1] == pytest.approx(5.0, abs=0.01)
    assert np.std(seen_deg(share, step_of_speed(), hill)[400:]) < 0.15


def test_a_fast_gear_sees_less_noise_and_the_same_hill_later():
    level, hill = np.zeros(len(TIME_S)), np.clip((TIME_S - 10.0) * 5.0 / 3.0, 0.0, 5.0)
    slow, fast = (seen_deg(1.0, level, level, pace=pace)[200:].std() for pace in (1.0, 0.14))
    assert fast < 0.5 * slow
    seen = seen_deg(1.0, level, hill, noise=0.0, pace=0.14)
    assert np.abs(seen - hill).max() < 2.5
    assert seen[-1] == pytest.approx(5.0, abs=0.05)


def test_a_gear_that_is_changed_keeps_what_is_known():
    observer = SlopeObserver(1.0, FRAME_S, SPEED_NOISE_MPS)
    seen = [observer.step(3.0, 1.2, pace) for pace in [1.0] * 20 + [0.14] * 20 + [2.0] * 20]
    np.testing.assert_allclose(seen, 3.0, atol=1e-9)


def test_no_gear_is_slower_than_slow():
    level = np.zeros(len(TIME_S))
    np.testing.assert_array_equal(seen_deg(1.0, level, level, pace=2.0), seen_deg(1.0, level, level))


def test_it_begins_with_what_is_seen_first():
    observer = SlopeObserver(1.0, FRAME_S, SPEED_NOISE_MPS)
    assert math.isnan(observer.pull_mps2)
    assert observer.step(3.0, 1.2) == pytest.approx(3.0, abs=1e-9)
    observer.restart()
    assert observer.step(-2.0, 0.5) == pytest.approx(-2.0, abs=1e-9)
