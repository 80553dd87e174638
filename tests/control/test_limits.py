"""The last word: nothing leaves that is not a number, out of range or too quick."""

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cruise.control.commissioning import CommissioningLimits
from cruise.control.limits import Limits, LimitSettings

SETTINGS = LimitSettings(current_min_ma=0.0, current_max_ma=1200.0, rate_max_ma_per_s=600.0)


@settings(deadline=None)  # a slow machine must not pass for a mutant that was caught
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


@pytest.mark.parametrize("time_s", [math.nan, math.inf, -0.001])
def test_a_time_that_cannot_be_is_neutral_at_once(time_s):
    limits = Limits(SETTINGS)
    limits.take_over(800.0)
    assert limits.step(810.0, time_s) == 0.0


def test_no_time_leaves_the_current_as_it_is():
    limits = Limits(SETTINGS)
    limits.take_over(800.0)
    assert limits.step(900.0, 0.0) == 800.0


@pytest.mark.parametrize(("past_ma", "sent_ma"), [(math.nan, 30.0), (math.inf, 30.0), (5000.0, 1170.0), (-800.0, 30.0)])
def test_a_past_that_cannot_be_lets_nothing_out_of_range_pass(past_ma, sent_ma):
    limits = Limits(SETTINGS)
    limits.last_ma = past_ma
    assert limits.step(500.0, 0.05) == sent_ma


@pytest.mark.parametrize(("low", "high"), [(-1.0, 1200.0), (1200.0, 1200.0), (1300.0, 1200.0)])
def test_limits_that_let_it_reverse_or_leave_no_range_are_refused(low, high):
    with pytest.raises(ValueError, match="current_min_ma has to be at least 0 and below current_max_ma"):
        LimitSettings(current_min_ma=low, current_max_ma=high)


def test_the_defaults_are_those_of_the_solenoid_and_never_reverse():
    found = LimitSettings()
    assert (found.current_min_ma, found.current_max_ma, found.rate_max_ma_per_s) == (0.0, 1200.0, 600.0)
    raised = Limits(LimitSettings(current_min_ma=100.0))
    raised.take_over(50.0)
    assert raised.last_ma == 100.0


def test_limits_are_named_known_and_stay_as_they_are():
    with pytest.raises(msgspec.ValidationError, match="curent_max_ma"):
        msgspec.convert({"curent_max_ma": 900.0}, LimitSettings)
    with pytest.raises(TypeError):
        LimitSettings(0.0)  # pyright: ignore[reportCallIssue]
    with pytest.raises(AttributeError):
        SETTINGS.current_max_ma = 5000.0  # pyright: ignore[reportAttributeAccessIssue]


def test_nothing_was_sent_before_the_first_step():
    assert Limits(SETTINGS).last_ma == 0.0
    assert Limits(SETTINGS).step(500.0, 0.05) == 30.0


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


@pytest.mark.parametrize(("most_ma", "fine"), [(100.0, True), (99.9, False), (2000.0, True), (2000.1, False)])
def test_a_limit_is_one_of_a_coil_in_ma(most_ma, fine):
    if fine:
        assert msgspec.convert({"current_max_ma": most_ma}, LimitSettings).current_max_ma == most_ma
    else:
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert({"current_max_ma": most_ma}, LimitSettings)
