"""Something that swings at a pace of its own is told from noise, from soil, and from what the current was moved at."""

import numpy as np
import pytest
from scipy import signal

from cruise.validation.swing import Swing, swing

PERIOD_S, COUNT = 0.2, 4500


def white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=COUNT)


def soil(seed: int, time_s: float) -> np.ndarray:
    rest = np.exp(-PERIOD_S / time_s)
    wander = np.asarray(signal.lfilter([np.sqrt(1.0 - rest**2)], [1.0, -rest], white(seed)))
    return 2.0 * wander + white(seed + 100)


def swung(seed: int, period_s: float, wander: float = 0.0) -> np.ndarray:
    """A swing of RMS 1 whose pace wanders by this share."""
    pace = (1.0 + wander * soil(seed, 20.0) / 2.0) / period_s
    return np.sqrt(2.0) * np.sin(2.0 * np.pi * np.cumsum(pace) * PERIOD_S)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("time_s", [0.0, 1.0, 5.0, 30.0])
def test_neither_noise_nor_soil_swings(seed, time_s):
    error = soil(seed, time_s) if time_s else white(seed)
    assert swing(error, white(seed + 50), PERIOD_S).much < 0.8


@pytest.mark.parametrize(("period_s", "wander"), [(3.0, 0.0), (8.0, 0.03), (14.0, 0.0)])
def test_what_swings_as_much_as_the_noise_is_found_with_its_period(period_s, wander):
    found = swing(swung(1, period_s, wander) + white(2), white(3), PERIOD_S)
    assert found.much > 1.0
    assert found.period_s == pytest.approx(period_s, rel=0.05)
    assert found.share == pytest.approx(0.5, abs=0.1)


def test_a_swing_that_the_hand_on_the_lever_made_says_nothing():
    moved = 50.0 * swung(1, 8.0)
    assert swing(swung(1, 8.0) + white(2), moved + white(3), PERIOD_S).much < 1.0


def test_a_weak_swing_is_not_worth_a_word():
    assert swing(0.4 * swung(1, 8.0) + white(2), white(3), PERIOD_S).much < 1.0


def test_holes_and_short_drives():
    error = swung(1, 8.0) + white(2)
    error[300:340] = np.nan
    assert swing(error, white(3), PERIOD_S).much > 1.0
    assert swing(error[:600], white(3)[:600], PERIOD_S) == Swing()
    assert swing(np.full(COUNT, np.nan), white(3), PERIOD_S).much == 0.0
    assert swing(np.zeros(COUNT), white(3), PERIOD_S).much == 0.0
