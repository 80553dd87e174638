"""The play operator: its loop, its indifference to rate, and its inverse while the current moves."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.effects.hysteresis import Hysteresis

WIDTH_MA, AMPLITUDE_MA = 60.0, 200.0
PLAY = Hysteresis(WIDTH_MA)


def through(currents_ma: np.ndarray) -> np.ndarray:
    return PLAY.over(currents_ma, np.zeros(len(currents_ma)), {}, 0.2)[0]


def triangle(step_ma: float) -> np.ndarray:
    up = np.arange(-AMPLITUDE_MA, AMPLITUDE_MA, step_ma)
    return np.tile(np.concatenate([up, -up]), 3)


def test_the_loop_encloses_its_width_times_the_travel():
    u = triangle(1.0)
    x = through(u)
    last = slice(-len(u) // 3, None)
    area_ma2 = abs(np.trapezoid(np.append(x[last], x[last][0]), np.append(u[last], u[last][0])))
    assert area_ma2 == pytest.approx(WIDTH_MA * (2.0 * AMPLITUDE_MA - WIDTH_MA), rel=1e-3)


def test_only_the_path_counts_and_not_its_speed():
    np.testing.assert_allclose(through(triangle(1.0))[::20], through(triangle(20.0)), atol=1e-9)


def test_after_a_reversal_nothing_moves_for_the_whole_width():
    x = through(np.array([500.0, 600.0, 570.0, 541.0, 540.0, 530.0]))
    assert x.tolist() == [500.0, 570.0, 570.0, 570.0, 570.0, 560.0]


def test_after_a_hole_the_current_is_taken_as_it_is():
    x = through(np.array([500.0, 600.0, math.nan, 400.0, 410.0]))
    np.testing.assert_array_equal(x, [500.0, 570.0, math.nan, 400.0, 400.0])


def test_of_what_is_held_in_part_the_rest_follows_at_once():
    soft = Hysteresis(WIDTH_MA, 0.25)
    x = soft.over(np.array([500.0, 600.0, 570.0, 540.0, 500.0]), np.zeros(5), {}, 0.2)[0]
    assert x.tolist() == [500.0, 592.5, 570.0, 547.5, 507.5]  # a quarter of 30 mA behind, both ways


@pytest.mark.parametrize(("closed", "left_ma"), [(0.0, 30.0), (0.4, 18.0), (1.0, 0.0)])
def test_springs_close_the_loop_where_no_current_flows(closed, left_ma):
    effect = Hysteresis(WIDTH_MA, closed_share=closed)
    x = effect.over(np.array([400.0, 200.0, 0.0, -200.0, 0.0, 200.0, 300.0]), np.zeros(7), {}, 0.2)[0]
    assert x.tolist() == [400.0, 230.0, left_ma, -170.0, -left_ma, 170.0, 270.0]


def test_near_no_current_it_gives_no_more_than_twice_the_current():
    effect = Hysteresis(WIDTH_MA, closed_share=1.0)
    x = effect.over(np.array([400.0, 20.0, 10.0, 5.0, 40.0]), np.zeros(5), {}, 0.2)[0]
    assert x.tolist() == [400.0, 40.0, 20.0, 10.0, 35.0]  # it stands at 35 mA, and 5 mA give no more than 10


SHAPES = {
    "slack": (1.0, 0.0),
    "in part": (0.6, 0.0),
    "hardly": (0.1, 0.0),
    "closes": (1.0, 1.0),
    "in part, and closes in part": (0.5, 0.7),
}


@pytest.mark.parametrize("shape", SHAPES)
@given(wanted=st.lists(st.floats(-900, 900) | st.floats(-40, 40), min_size=2, max_size=20))
def test_the_inverse_leads_wherever_it_is_wanted(wanted, shape):
    effect = Hysteresis(WIDTH_MA, *SHAPES[shape])
    current, state = effect.step(300.0, 0.0, {}, effect.start(0.0), 0.2)
    for value in wanted:
        current = effect.inverse(value, {}, state).nearest(current)
        result, state = effect.step(current, 0.0, {}, state, 0.2)
        assert result == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize("closed", [0.0, 1.0])
def test_where_it_stands_any_current_of_the_band_holds_it_and_none_beyond(closed):
    effect = Hysteresis(WIDTH_MA, closed_share=closed)
    band = effect.inverse(500.0, {}, 500.0)
    assert (band.low, band.high) == (470.0, 530.0)
    outputs = [effect.step(u, 0.0, {}, 500.0, 0.2)[0] for u in (469.0, 470.0, 500.0, 530.0, 531.0)]
    assert outputs == [499.0, 500.0, 500.0, 500.0, 501.0]


def test_where_it_closes_a_little_needs_half_of_its_own_current():
    effect = Hysteresis(WIDTH_MA, closed_share=1.0)
    band = effect.inverse(20.0, {}, 20.0)
    assert (band.low, band.high) == (10.0, 50.0)
    assert effect.step(9.0, 0.0, {}, 20.0, 0.2)[0] == 18.0
