"""Great steps become ramps, small ones pass, and 10000 mA/s is no limit."""

import math

import numpy as np
import pytest

from cruise.effects.rate_limit import UNLIMITED_MA_PER_S, RateLimit


def through(rate_ma_per_s: float, currents_ma: list[float], dt_s: float) -> list[float]:
    effect = RateLimit(rate_ma_per_s)
    return effect.over(np.array(currents_ma), np.zeros(len(currents_ma)), {}, dt_s)[0].tolist()


def test_a_great_step_takes_its_size_over_the_rate_both_ways():
    assert through(1000.0, [0.0, 500, 500, 500, 500], 0.2) == [0, 200, 400, 500, 500]
    assert through(1000.0, [500.0, 0, 0, 0, 0], 0.2) == [500, 300, 100, 0, 0]
    assert through(1000.0, [0.0, 500, 500], 0.05) == [0, 50, 100]


def test_back_to_neutral_it_may_go_at_another_rate():
    effect = RateLimit(1000.0, return_share=2.0)
    for sign in (1.0, -1.0):
        currents = sign * np.array([0.0, 500, 500, 500, 0, 0])
        np.testing.assert_allclose(
            effect.over(currents, np.zeros(6), {}, 0.2)[0], sign * np.array([0.0, 200, 400, 500, 100, 0])
        )


def test_a_small_step_passes_at_once():
    assert through(1000.0, [300.0, 499, 400], 0.2) == [300, 499, 400]


@pytest.mark.parametrize("dt_s", [0.2, 0.01, 1e-6])
def test_the_neutral_rate_is_none_at_any_period(dt_s):
    assert through(UNLIMITED_MA_PER_S, [-1500.0, 1500, -1500, 0], dt_s) == [-1500, 1500, -1500, 0]


def test_after_a_hole_the_current_is_taken_as_it_is():
    np.testing.assert_array_equal(through(100.0, [0.0, math.nan, 700, 800], 0.2), [0, math.nan, 700, 720])


def test_the_inverse_gives_what_is_within_reach_and_the_greatest_rate_beyond():
    effect, state = RateLimit(1000.0), 300.0
    for value, reached in ((420.0, 420.0), (500.0, 500.0), (900.0, 500.0), (-900.0, 100.0)):
        current = effect.inverse(value, {}, state).nearest(0.0)
        assert effect.step(current, 0.0, {}, state, 0.2)[0] == reached
