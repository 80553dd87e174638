"""The observer finds how wide the hysteresis is, from what the turns of the current leave."""

import math
from copy import deepcopy

import numpy as np
import pytest

from cruise.control.observer import DisturbanceObserver, ObserverSettings
from tests.control.observing import FRAME_S, POLE

BAND_MPS, TURN_S = 0.1, 6.0  # what the model's width is in steady speed; time from one turn to the next


def turned(observer, true_share, seconds=300.0, hill=None, rate_mps2=0.0, seed=5):
    """The share that it believes of a width (N,), of a drive whose current turns to and fro.

    The machine's width is `true_share` of the model's. `hill(time)` is what else moves it, in m/s.
    """
    rng, speed, shares = np.random.default_rng(seed), 1.0, []
    observer.reset(speed)
    for k in range(round(seconds / FRAME_S)):
        at = k * FRAME_S
        width_mps = BAND_MPS / 2.0 * (-1.0 if at // TURN_S % 2 else 1.0)
        moved = 1.0 + rate_mps2 * (at % TURN_S)
        load = hill(at) if hill else 0.0
        speed += (1.0 - POLE) * (moved + true_share * width_mps + load - speed)
        shown = speed + 0.005 * rng.standard_normal()
        observer.step(POLE, moved + observer.width_share * width_mps, shown, 1.0, width_mps)
        shares.append(observer.width_share)
    return np.array(shares)


@pytest.mark.parametrize("true_share", [0.0, 0.5, 0.8, 1.0])
def test_it_finds_the_width_from_what_the_turns_leave(true_share):
    shares = turned(DisturbanceObserver(FRAME_S, ObserverSettings()), true_share)
    assert shares[-1] == pytest.approx(true_share, abs=0.15)
    assert abs(shares[round(5.0 * TURN_S / FRAME_S)] - 1.0) >= 0.4 * abs(true_share - 1.0), "within four turns"


@pytest.mark.parametrize("true_share", [-1.0, 1.3, 3.0])
def test_no_width_is_taken_for_wider_than_the_models_or_for_less_than_none(true_share):
    shares = turned(DisturbanceObserver(FRAME_S, ObserverSettings()), true_share)
    assert shares.max() <= 1.0
    assert shares.min() >= 0.0
    assert shares[-1] == pytest.approx(min(max(true_share, 0.0), 1.0), abs=0.02)


def test_where_the_current_does_not_turn_nothing_is_learned_of_the_width():
    observer, speed = DisturbanceObserver(FRAME_S, ObserverSettings()), 1.0
    observer.reset(speed)
    for k in range(1200):
        speed += (1.0 - POLE) * (1.0 + 0.2 * math.sin(0.5 * k * FRAME_S) - speed)
        observer.step(POLE, 1.0, speed, 1.0, 0.0)
        assert observer.width_share == 1.0


def test_a_hill_that_makes_the_current_turn_is_not_its_width():
    """It comes in the 6 s about the turn: of what is learned by it, what has lasted would be as much again."""

    def hill(at):
        towards = 1.0 if math.floor(at / TURN_S + 0.5) % 2 else -1.0
        return 0.05 * towards * min((at / TURN_S + 0.5) % 1.0 * TURN_S - 3.0, 3.0)

    shares = turned(DisturbanceObserver(FRAME_S, ObserverSettings()), 0.7, hill=hill)
    assert shares[-200:].mean() == pytest.approx(0.7, abs=0.3)


def test_what_comes_while_the_drive_moves_tells_less_of_the_width():
    slow, fast = (
        turned(DisturbanceObserver(FRAME_S, ObserverSettings()), 0.5, TURN_S * 4.0, rate_mps2=rate)
        for rate in (0.0, 1.0)
    )
    assert abs(fast[-1] - 1.0) < 0.6 * abs(slow[-1] - 1.0)


def test_a_width_is_kept_when_it_begins_anew_and_slowly_forgotten():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings(width_s=100.0))
    turned(observer, 0.5)
    found, known = observer.width_share, observer.width_variance
    observer.reset(2.0)
    assert observer.width_share == found
    assert not observer.upset
    for _ in range(2000):
        observer.step(POLE, 2.0, 2.0)
    assert 1.0 - observer.width_share == pytest.approx((1.0 - found) / math.e, rel=1e-6)
    assert known < observer.width_variance < ObserverSettings().width_share ** 2


def test_what_shows_the_width_is_the_derivative_of_the_state():
    """By two observers more, to which a width a little more and a little less is known for good."""
    settings, small, rng = ObserverSettings(width_share=1e-9, brisk_mps2=1e9), 1e-3, np.random.default_rng(1)
    observers, speed = {by: DisturbanceObserver(FRAME_S, settings) for by in (0.0, small, -small)}, 1.0
    for one in observers.values():
        one.reset(speed)
    for k in range(66):
        width_mps = 0.05 if k < 60 else -0.05
        speed += (1.0 - POLE) * (1.0 + 0.6 * width_mps - speed)
        shown = speed + 0.005 * rng.standard_normal()
        for by, one in observers.items():
            one.step(POLE, 1.0 + (0.9 + by) * width_mps, shown, 1.0, width_mps)
    more, less = ([one.speed_mps, one.disturbance_mps, *one.ripple] for one in list(observers.values())[1:])
    np.testing.assert_allclose(observers[0.0].turned, (np.array(more) - less) / (2.0 * small), rtol=0.02, atol=5e-5)


def test_the_state_moves_along_with_the_width():
    observer = DisturbanceObserver(FRAME_S, ObserverSettings())
    turned(observer, 1.0, TURN_S + 0.3)
    certain = deepcopy(observer)
    certain.width_variance = 0.0
    for one in (observer, certain):
        one.step(POLE, 1.0, 1.1, 1.0, -BAND_MPS / 2.0)
    more = observer.width_share - certain.width_share
    assert abs(more) > 0.01
    found, expected = (np.array([one.speed_mps, one.disturbance_mps, *one.ripple]) for one in (observer, certain))
    np.testing.assert_allclose(found, expected + more * observer.turned)
