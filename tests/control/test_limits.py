"""The last word: nothing leaves that is not a number, out of range or too quick."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.control.commissioning import CommissioningLimits
from cruise.control.limits import Limits, LimitSettings

SETTINGS = LimitSettings(current_min_ma=0.0, current_max_ma=1200.0, rate_max_ma_per_s=600.0)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=40), st.floats(0, 2000))
def test_whatever_is_wanted_what_leaves_is_within_the_limits(wanted, start):
    limits = Limits(SETTINGS)
    limits.take_over(start)
    last = limits.last_ma
    for value in wanted:
        sent = limits.step(value, 0.05)
        assert 0.0 <= sent <= 1200.0
        assert abs(sent - last) <= 30.0 + 1e-9 or (sent == 0.0 and not math.isfinite(value))
        last = sent


@pytest.mark.parametrize("nonsense", [math.nan, math.inf, -math.inf])
def test_not_a_number_is_neutral_at_once(nonsense):
    limits = Limits(SETTINGS)
    limits.take_over(800.0)
    assert limits.step(nonsense, 0.05) == 0.0
    assert limits.last_ma == 0.0


def test_neutral_is_never_slowed_down():
    limits = Limits(SETTINGS)
    limits.take_over(800.0)
    assert limits.neutral() == 0.0
    assert limits.step(800.0, 0.05) == 30.0


@pytest.mark.parametrize(("current", "kept"), [(-50.0, 0.0), (1500.0, 1200.0), (math.nan, 0.0), (700.0, 700.0)])
def test_taking_over_starts_inside(current, kept):
    limits = Limits(SETTINGS)
    limits.take_over(current)
    assert limits.last_ma == kept


def test_a_value_within_reach_passes_unchanged():
    limits = Limits(SETTINGS)
    limits.take_over(700.0)
    assert limits.step(720.0, 0.05) == 720.0
    assert limits.step(600.0, 0.05) == 690.0


@pytest.mark.parametrize("settings", [SETTINGS, CommissioningLimits()], ids=["engaged", "commissioning"])
def test_either_set_of_limits_forbids_reversing_and_the_full_stroke_beyond(settings):
    limits = Limits(settings)
    assert min(limits.step(-500.0, 0.05) for _ in range(100)) == 0.0
    assert max(limits.step(5000.0, 0.05) for _ in range(100)) == settings.current_max_ma == 1200.0


def test_only_commissioning_passes_the_whole_range_in_a_frame():
    engaged, commissioning = Limits(SETTINGS), Limits(CommissioningLimits())
    assert engaged.step(1200.0, 0.05) == 30.0
    assert commissioning.step(1200.0, 0.05) == 1200.0
    assert commissioning.step(0.0, 0.05) == 0.0
