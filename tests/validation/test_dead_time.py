"""A dead time that changes is told from noise, soil, a gain that wanders, and a constant delay."""

import numpy as np
import pytest

from cruise.validation.dead_time import DeadTime, dead_time
from tests.validation.driving import lagged, levels, wander

PERIOD_S, COUNT = 0.2, 3000
WHOLE = [slice(0, COUNT)]
SPEED_MPS = lagged(2e-3 * levels(COUNT, PERIOD_S, 1), 0.05)  # of its samples of 10 ms, 1 s of ours


def noise(seed: int) -> np.ndarray:
    return 0.02 * np.random.default_rng(seed).normal(size=COUNT)


def late(early_s: float, late_s: float, each_s: float) -> np.ndarray:
    """Error in m/s where the speed comes by turns earlier and later than the model's, for so long each."""
    time_s = PERIOD_S * np.arange(COUNT)
    shift_s = np.where(time_s % (2.0 * each_s) < each_s, early_s, late_s)
    return np.interp(time_s - shift_s, time_s, SPEED_MPS) - SPEED_MPS


@pytest.mark.parametrize("each_s", [30.0, 40.0, 100.0])
def test_a_delay_that_changes_is_found_with_how_early_and_how_late_it_is(each_s):
    found = dead_time(late(-0.2, 0.3, each_s) + noise(1), SPEED_MPS, WHOLE, PERIOD_S)
    assert found.much > 1.0
    assert -0.25 < found.early_s < -0.1
    assert 0.15 < found.late_s < 0.35


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("time_constant_s", [0.0, 1.0, 5.0, 30.0])
def test_neither_noise_nor_soil_is_a_delay(seed, time_constant_s):
    soil = wander(COUNT, PERIOD_S, seed, 0.05, time_constant_s) if time_constant_s else 0.0
    assert dead_time(soil + noise(seed), SPEED_MPS, WHOLE, PERIOD_S).much < 0.5


def test_a_gain_that_wanders_is_none():
    gain = wander(COUNT, PERIOD_S, 3, 0.1, 10.0)
    assert dead_time(gain * SPEED_MPS + noise(1), SPEED_MPS, WHOLE, PERIOD_S).much < 0.5


def test_the_signal_that_it_changes_with_is_named_though_it_changes_quickly():
    quick = wander(COUNT, PERIOD_S, 5, 1.0, 1.5)
    signals = {"engine_speed_rpm": 2000.0 + 100.0 * quick, "bin_fill_pct": wander(COUNT, PERIOD_S, 6, 10.0, 20.0)}
    time_s, blocks = PERIOD_S * np.arange(COUNT), np.arange(COUNT) // 100
    error = np.interp(time_s - 0.1 * quick, time_s, SPEED_MPS) - SPEED_MPS + noise(1)
    assert dead_time(error, SPEED_MPS, WHOLE, PERIOD_S).much < 1.0
    found = dead_time(error, SPEED_MPS, WHOLE, PERIOD_S, signals, blocks)
    assert found.signal == "engine_speed_rpm"
    assert found.much > 2.0
    assert -0.25 < found.early_s < -0.1 < 0.1 < found.late_s < 0.25


@pytest.mark.parametrize("seed", range(6))
def test_no_signal_is_named_where_the_dead_time_is_one(seed):
    signals = {str(i): wander(COUNT, PERIOD_S, 10 * seed + i, 1.0, 1.0 + 10.0 * i) for i in range(6)}
    soil = wander(COUNT, PERIOD_S, seed, 0.05, 5.0)
    found = dead_time(soil + noise(seed), SPEED_MPS, WHOLE, PERIOD_S, signals, np.arange(COUNT) // 100)
    assert (found.signal, found.much < 0.5) == ("", True)


def test_little_of_it_is_not_worth_a_word():
    assert dead_time(late(-0.02, 0.02, 40.0) + noise(1), SPEED_MPS, WHOLE, PERIOD_S).much < 1.0


def test_less_than_samples_can_show_is_none_though_it_is_all_that_is_left():
    """Steps of another shape than the model's look like it: hundredths of a second now earlier, now later."""
    assert dead_time(late(-0.01, 0.02, 40.0), SPEED_MPS, WHOLE, PERIOD_S).much == 0.0
    assert dead_time(late(-0.05, 0.05, 40.0), SPEED_MPS, WHOLE, PERIOD_S).much > 1.0


def test_recordings_are_looked_at_one_by_one():
    """Two halves of opposite delay: taken as one recording, the windows at the seam would be both."""
    halves = [slice(0, COUNT // 2), slice(COUNT // 2, COUNT)]
    error = late(-0.3, 0.3, PERIOD_S * COUNT / 2) + noise(1)
    apart, joined = (dead_time(error, SPEED_MPS, parts, PERIOD_S) for parts in (halves, WHOLE))
    assert apart.share > joined.share


def test_holes_short_drives_and_drives_without_any_change():
    error = late(-0.2, 0.3, 40.0) + noise(1)
    error[300:340] = np.nan
    assert dead_time(error, np.where(np.isfinite(error), SPEED_MPS, np.nan), WHOLE, PERIOD_S).much > 1.0
    assert dead_time(error[:1], SPEED_MPS[:1], [slice(0, 1)], PERIOD_S) == DeadTime()
    assert dead_time(error, np.ones(COUNT), WHOLE, PERIOD_S) == DeadTime()
    assert dead_time(np.full(COUNT, np.nan), SPEED_MPS, WHOLE, PERIOD_S) == DeadTime()
    assert dead_time(np.zeros(COUNT), SPEED_MPS, WHOLE, PERIOD_S) == DeadTime()
