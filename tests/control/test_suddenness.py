"""A force that comes at once is seen for what it adds within 0.4 s, though the drive moves; a hill hardly is."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from cruise.control.suddenness import OVER_S, Suddenness

FRAME_S = 0.05
Accel = Callable[[float], float]
"""Time in s to an acceleration in m/s2."""


def seen(own: Accel, more: Accel, seconds: float = 6.0, noise_mps: float = 0.0) -> np.ndarray:
    """`more_mps` and `own_mps` by frame (N, 2) of a drive that the model tells one part of the acceleration of."""
    suddenness, rng, speed, shown, answers = Suddenness(FRAME_S), np.random.default_rng(2), 1.5, 1.5, []
    for k in range(round(seconds / FRAME_S)):
        expected = own(k * FRAME_S) * FRAME_S
        speed += expected + more(k * FRAME_S) * FRAME_S
        before, shown = shown, speed + noise_mps * rng.standard_normal()
        suddenness.take(expected, shown - before - expected)
        answers.append((suddenness.more_mps, suddenness.own_mps))
    return np.array(answers)


def none(time_s: float) -> float:
    return 0.0


def step(accel_mps2: float, at_s: float = 2.975) -> Accel:
    return lambda time_s: accel_mps2 if time_s > at_s else 0.0


@pytest.mark.parametrize("force_mps2", [-0.5, 0.3])
@pytest.mark.parametrize("own", [none, lambda time_s: 0.4], ids=["rests", "moves"])
def test_a_force_that_comes_at_once_is_what_it_adds_within_the_time(force_mps2, own):
    more_mps, own_mps = seen(own, step(force_mps2)).T
    assert more_mps[:60] == pytest.approx(0.0, abs=1e-9)
    assert np.argmax(more_mps) == 60 + round(OVER_S / FRAME_S) - 1
    assert more_mps.max() == pytest.approx(abs(force_mps2) * OVER_S)
    assert own_mps[40:] == pytest.approx(0.0, abs=1e-9), "a drive that moves evenly does nothing new"


def test_a_hill_of_8_degrees_within_2_s_and_a_half_is_hardly_seen():
    rate_mps3 = 9.81 * math.sin(math.radians(8.0)) / 2.5
    more_mps, _ = seen(none, lambda time_s: rate_mps3 * min(max(time_s - 3.0, 0.0), 2.5)).T
    assert more_mps.max() == pytest.approx(rate_mps3 * OVER_S**2, rel=0.02)


def test_noise_moves_it_by_little_more_than_a_reading():
    """A difference of three readings, y_k - 2 y_(k-n) + y_(k-2n), would show 2.4 times their noise."""
    more_mps, _ = seen(none, none, 200.0, noise_mps=0.01).T
    assert math.sqrt(np.mean(more_mps**2)) == pytest.approx(0.0153, rel=0.1)


def test_what_the_drive_itself_does_at_once_counts_for_as_long_as_it_can_be_mistaken():
    more_mps, own_mps = seen(step(0.6), none).T
    assert more_mps == pytest.approx(0.0, abs=1e-9)
    frames = round(OVER_S / FRAME_S)
    assert own_mps[60 + frames - 1 : 60 + 3 * frames - 1] == pytest.approx(0.6 * OVER_S)
    assert own_mps[60 + 4 * frames :] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("hole", [(math.nan, 0.5), (0.5, math.nan)])
def test_what_is_not_known_was_no_change(hole):
    suddenness = Suddenness(FRAME_S)
    for expected_mps, unexpected_mps in ((0.0, 0.0), (0.0, 0.0), hole, (0.0, 0.0)):
        suddenness.take(expected_mps, unexpected_mps)
        assert math.isfinite(suddenness.more_mps)
        assert math.isfinite(suddenness.own_mps)
    assert (suddenness.more_mps, suddenness.own_mps) == (0.0, 0.0)


def test_what_is_still_to_come_counts_as_the_drives_own_in_its_direction():
    coming = tuple(-0.6 * FRAME_S * (k > 2) for k in range(14))
    suddenness = Suddenness(FRAME_S)
    suddenness.take(0.0, -1e-3, coming)
    assert suddenness.same_mps == suddenness.own_mps == pytest.approx(0.6 * OVER_S)
    suddenness.take(0.0, 1.0, coming)
    assert (suddenness.same_mps, suddenness.own_mps) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.6 * OVER_S))
