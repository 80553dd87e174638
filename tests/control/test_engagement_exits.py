"""Every way out of driving acts at once, says why, and does not lead back by itself."""

import math
from dataclasses import replace

import pytest

from cruise.control.engagement import TRANSITIONS, Engagement, ExitReason, State
from cruise.control.situation import EngagementSettings
from tests.control.situations import DRIVEN_AT_SETPOINT, READY, engaged, engaging


def test_overspeed_is_more_than_a_hill_adds_and_that_is_more_in_a_fast_gear_not_at_a_high_setpoint():
    for alpha, most_mps in ((1.0, 0.28), (0.33, 0.487), (0.118, 0.815), (1.5, 0.28)):  # quick to brake is no slow gear
        for wished_mps in (1.6, 3.6):
            for over_mps in (most_mps - 0.02, most_mps + 0.02):
                engagement = engaged()
                engagement.setpoint_mps = wished_mps
                now = replace(READY, alpha=alpha, reference_mps=wished_mps, speed_mps=wished_mps + over_mps)
                assert (engagement.step(now) is State.FAULT) is (over_mps > most_mps)


EXITS = {
    "unhealthy": ({"ailment": "no bus"}, State.FAULT, ExitReason.FUNCTION_FAULT),
    "operator_lost": ({"operator_present": False}, State.STANDBY, ExitReason.OPERATOR_LOST),
    "switched_off": ({"enable": False}, State.OFF, ExitReason.RELEASED),
    "brake": ({"brake": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "clutch": ({"clutch": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "lever_moved": ({"lever_pct": 45.1}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "neutral": ({"gear": 0.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "signals_lost": ({"signals_valid": False, "missing": ("gear",)}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    "shifted": ({"gear": 3.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "setpoint_lost": ({"requested_mps": math.nan}, State.STANDBY, ExitReason.COMMAND_TIMEOUT),
    "setpoint_invalid": ({"requested_mps": 0.0}, State.STANDBY, ExitReason.COMMAND_INVALID),
    "standing": ({"time_s": 1.1, "speed_mps": 0.09}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    "implausible": ({"contradiction": "two speeds"}, State.FAULT, ExitReason.FUNCTION_FAULT),
    "overspeed": ({"speed_mps": 1.69}, State.FAULT, ExitReason.FUNCTION_FAULT),
}


@pytest.mark.parametrize("state", [State.ENGAGING, State.ENGAGED])
def test_every_exit_of_the_controller_is_tried_below(state):
    assert [row.condition for row in TRANSITIONS if row.source is state and row.target is not State.ENGAGED] == [*EXITS]


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("lever_moved", "lever moved (ISO exit reason 3, override)"),
        ("unhealthy", "unhealthy, no bus (ISO exit reason 9, function fault)"),
        ("signals_lost", "signals lost, gear (ISO exit reason 9, function fault)"),
        ("implausible", "implausible, two speeds (ISO exit reason 9, function fault)"),
    ],
)
def test_an_exit_is_told_in_words_until_it_drives_again(condition, words):
    engagement = engaged()
    assert engagement.ended_by == ""
    engagement.step(replace(READY, **EXITS[condition][0]))
    assert (engagement.ended_by, engagement.exits) == (words, 1)
    for k in range(40):
        engagement.step(replace(READY, time_s=0.1 * k, enable=k != 1))
    assert (engagement.ended_by, engagement.exits) == (words, 1)
    engagement.step(replace(READY, time_s=4.0, resume=True))
    assert engagement.ended_by == ""


@pytest.mark.parametrize("begin", [engaging, engaged])
@pytest.mark.parametrize("condition", EXITS)
def test_every_exit_acts_in_one_step_says_why_and_does_not_come_back(begin, condition):
    fields, target, reason = EXITS[condition]
    engagement = begin()
    held = replace(READY, resume=True, set=True)
    assert engagement.step(replace(held, **fields)) is target
    assert (engagement.exit_condition, engagement.exit_reason) == (condition, reason)
    assert engagement.exit_detail == fields.get(
        "contradiction", fields.get("ailment", ", ".join(fields.get("missing", ())))
    )
    for k in range(100):  # the cause goes away while both buttons stay down, and then they are let go
        now = replace(held if k < 50 else READY, time_s=0.05 * k)
        assert not engagement.step(now).drives
    assert (engagement.exit_condition, engagement.exit_reason) == (condition, reason)


@pytest.mark.parametrize("fields", [{"lever_pct": 0.0}, {"lever_pct": 34.9}, {"gear": -1.0}, {"speed_mps": 5.0}])
def test_the_lever_backwards_reverse_gear_and_any_greater_speed_end_it_too(fields):
    assert not engaged().step(replace(DRIVEN_AT_SETPOINT, **fields)).drives


@pytest.mark.parametrize("fields", [{"lever_pct": 44.9}, {"lever_pct": 35.1}, {"speed_mps": 1.67}])
def test_what_is_less_than_a_limit_does_not_end_it(fields):
    assert engaged().step(replace(DRIVEN_AT_SETPOINT, **fields)) is State.ENGAGED


@pytest.mark.parametrize("word_mps", [0.0, 0.2, 9.0, 50.0])
def test_a_word_beyond_what_may_be_driven_ends_it_and_is_not_passed_over(word_mps):
    engagement = engaged()
    assert engagement.step(replace(DRIVEN_AT_SETPOINT, requested_mps=word_mps)) is State.STANDBY
    assert engagement.exit_reason is ExitReason.COMMAND_INVALID


def test_a_machine_that_slowed_down_to_a_stop_does_not_start_again_by_itself():
    engagement = engaged()
    for k in range(20):  # slow, as an engine at its limit makes it
        assert engagement.step(replace(DRIVEN_AT_SETPOINT, time_s=0.1 * k, speed_mps=0.12)).controls
    states = [engagement.step(replace(READY, time_s=2.0 + 0.1 * k, speed_mps=0.0)) for k in range(12)]
    assert states[9].controls
    assert states[-1] is State.STANDBY
    assert engagement.exit_condition == "standing"
    assert engagement.step(replace(READY, time_s=4.0)) is State.STANDBY


def test_a_gearbox_that_shifts_under_way_may():
    engagement = engaged(EngagementSettings(shifts_under_way=True))
    assert engagement.step(replace(DRIVEN_AT_SETPOINT, gear=3.0)) is State.ENGAGED
    assert engagement.step(replace(DRIVEN_AT_SETPOINT, gear=0.0)) is State.STANDBY


def test_an_override_lasts_as_long_as_the_operator_acts_and_a_press_meanwhile_is_lost():
    engagement = engaged()
    acts = [{"brake": True}, {"brake": True}, {}, {"lever_pct": 46.0}, {"lever_pct": 52.0}, {"clutch": True}]
    time_s = 0.0
    for act in acts:
        time_s += 0.8
        assert engagement.step(replace(READY, time_s=time_s, **act)) is State.OVERRIDDEN
    at_rest = replace(READY, time_s=time_s, lever_pct=40.0)
    engagement.step(replace(at_rest, time_s=time_s + 0.1))
    assert engagement.step(replace(at_rest, time_s=time_s + 1.0, resume=True)) is State.OVERRIDDEN
    assert engagement.step(replace(at_rest, time_s=time_s + 1.2, resume=True)) is State.STANDBY
    assert engagement.step(replace(at_rest, time_s=time_s + 1.3)) is State.STANDBY
    assert engagement.step(replace(at_rest, time_s=time_s + 1.4, resume=True)) is State.ENGAGING


@pytest.mark.parametrize("seen_pct", [40.0, math.nan])
def test_a_lever_that_has_no_value_when_the_override_begins_still_lasts_as_long_as_it_is_moved(seen_pct):
    engagement = engaged()
    engagement.step(replace(READY, time_s=1.0, brake=True, lever_pct=seen_pct))
    for k in range(1, 60):
        assert (
            engagement.step(replace(READY, time_s=1.0 + 0.05 * k, lever_pct=40.0 + 10.0 * k % 90)) is State.OVERRIDDEN
        )


def test_a_lever_without_a_value_is_not_left_alone():
    engagement = engaged()
    for k in range(60):
        now = replace(READY, time_s=1.0 + 0.05 * k, brake=k == 0, lever_pct=math.nan)
        assert engagement.step(now) is State.OVERRIDDEN
    states = [engagement.step(replace(READY, time_s=4.0 + 0.05 * k)) for k in range(30)]
    assert (states[15], states[-1]) == (State.OVERRIDDEN, State.STANDBY)


@pytest.mark.parametrize(
    ("fields", "target"), [({"ailment": "no bus"}, State.FAULT), ({"enable": False}, State.OFF), ({}, State.OVERRIDDEN)]
)
def test_fault_and_switch_count_in_an_override_too(fields, target):
    engagement = engaged()
    engagement.step(replace(READY, brake=True))
    assert engagement.step(replace(READY, **fields)) is target


def test_every_way_out_of_driving_has_a_reason_and_no_other_way_out_pretends_one():
    for row in TRANSITIONS:
        if row.source.drives and not row.target.drives:
            assert row.reason is not ExitReason.NONE
        elif row.target is not State.FAULT:
            assert row.reason is ExitReason.NONE


def test_a_fault_is_left_by_switching_off_and_on_only():
    engagement = engaged()
    engagement.step(replace(READY, ailment="no bus"))
    for situation in (READY, replace(READY, resume=True), READY):
        assert engagement.step(situation) is State.FAULT
    assert engagement.step(replace(READY, enable=False)) is State.OFF
    assert engagement.step(READY) is State.STANDBY


def test_a_wish_for_less_is_no_overspeed_before_the_machine_can_have_followed():
    engagement = engaged()
    fast = replace(READY, speed_mps=1.4, reference_mps=1.4, requested_mps=1.4)
    for k in range(1, 40):
        engagement.step(replace(fast, time_s=0.05 * k))
    less = replace(fast, requested_mps=0.9, reference_mps=0.9)
    assert engagement.step(replace(less, time_s=2.0)).controls
    assert engagement.step(replace(less, time_s=2.45)).controls
    states = [engagement.step(replace(less, time_s=0.05 * k)) for k in range(50, 101)]
    assert states[-1] is State.FAULT, "a machine that never follows is driven by something else"


def test_a_fast_drive_leaves_nothing_allowed_for_a_slow_one_after_it():
    engagement = Engagement(EngagementSettings())
    fast = replace(READY, speed_mps=3.0, reference_mps=3.0, requested_mps=3.0)
    slow = replace(READY, speed_mps=1.0, reference_mps=3.0, requested_mps=math.nan)  # the reference of the last drive
    steps = (fast, replace(fast, set=True), fast, replace(fast, brake=True), *[slow] * 60, replace(slow, set=True))
    for k, now in enumerate(steps):
        engagement.step(replace(now, time_s=0.05 * k))
    assert engagement.state is State.ENGAGING
    driven = replace(slow, time_s=0.05 * len(steps), reference_mps=1.0, speed_mps=1.8)
    assert engagement.step(driven) is State.FAULT
    assert engagement.exit_condition == "overspeed"
