"""The table of transitions, row by row; nothing engages by itself."""

import math
from dataclasses import replace

import pytest

from cruise.control.engagement import TRANSITIONS, Engagement, EngagementSettings, ExitReason, Situation, State

READY = Situation(
    enable=True,
    set=False,
    resume=False,
    accelerate=False,
    coast=False,
    operator_present=True,
    signals_valid=True,
    model_ready=True,
    healthy=True,
    brake=False,
    clutch=False,
    gear=2.0,
    lever_pct=40.0,
    speed_mps=1.1,
    requested_mps=1.4,
    reference_mps=1.1,
)


def engaged(**fields):
    engagement = Engagement(EngagementSettings())
    for situation in (READY, READY, replace(READY, resume=True, **fields)):
        engagement.step(situation)
    return engagement


def test_resume_engages_at_the_requested_speed_and_set_at_the_present_one():
    assert (engaged().state, engaged().setpoint_mps) == (State.ENGAGED, 1.4)
    other = engaged(set=True)
    assert (other.state, other.setpoint_mps) == (State.ENGAGED, 1.1)


EXITS = [
    ({"healthy": False}, State.FAULT, ExitReason.FUNCTION_FAULT),
    ({"operator_present": False}, State.STANDBY, ExitReason.OPERATOR_LOST),
    ({"enable": False}, State.OFF, ExitReason.RELEASED),
    ({"brake": True}, State.STANDBY, ExitReason.OVERRIDE),
    ({"clutch": True}, State.STANDBY, ExitReason.OVERRIDE),
    ({"lever_pct": 47.0}, State.STANDBY, ExitReason.OVERRIDE),
    ({"lever_pct": 0.0}, State.STANDBY, ExitReason.OVERRIDE),
    ({"gear": 0.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    ({"gear": math.nan, "signals_valid": False}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    ({"signals_valid": False}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    ({"speed_mps": 2.2}, State.FAULT, ExitReason.FUNCTION_FAULT),
]


@pytest.mark.parametrize(("fields", "target", "reason"), EXITS)
def test_every_exit_acts_in_one_step_says_why_and_does_not_come_back(fields, target, reason):
    engagement = engaged()
    bad = replace(READY, resume=True, **fields)
    assert engagement.step(bad) is target
    assert engagement.exit_reason is reason
    for _ in range(50):  # the cause goes away while the button is still down
        assert engagement.step(replace(READY, resume=True)) is not State.ENGAGED
        assert engagement.step(READY) is not State.ENGAGED or pytest.fail("engaged on a falling edge")
        break


@pytest.mark.parametrize(
    "fields",
    [
        {"signals_valid": False},
        {"operator_present": False},
        {"model_ready": False},
        {"brake": True},
        {"clutch": True},
        {"gear": 0.0},
        {"speed_mps": 0.1},
        {"speed_mps": math.nan},
        {"speed_mps": 9.0},
        {"requested_mps": math.nan},
        {"requested_mps": 20.0},
        {"enable": False},
    ],
)
def test_it_does_not_engage_and_says_what_is_in_the_way(fields):
    engagement = engaged(**fields)
    assert engagement.state is not State.ENGAGED
    if "enable" not in fields and "operator_present" not in fields:
        assert engagement.refused


def test_a_button_held_from_the_start_does_not_engage():
    engagement = Engagement(EngagementSettings())
    for _ in range(10):
        assert engagement.step(replace(READY, resume=True)) is not State.ENGAGED


def test_a_fault_is_left_by_switching_off_and_on_only():
    engagement = engaged()
    engagement.step(replace(READY, healthy=False))
    for situation in (READY, replace(READY, resume=True), READY):
        assert engagement.step(situation) is State.FAULT
    assert engagement.step(replace(READY, enable=False)) is State.OFF
    assert engagement.step(READY) is State.STANDBY


def test_the_operators_newest_word_is_the_setpoint():
    engagement = engaged()
    engagement.step(READY)
    engagement.step(replace(READY, requested_mps=1.8))
    assert engagement.setpoint_mps == 1.8
    engagement.step(replace(READY, requested_mps=1.8, accelerate=True))
    engagement.step(replace(READY, requested_mps=1.8, accelerate=True))
    assert engagement.setpoint_mps == pytest.approx(1.9)
    engagement.step(replace(READY, requested_mps=1.8))
    engagement.step(replace(READY, requested_mps=1.8, coast=True))
    assert engagement.setpoint_mps == pytest.approx(1.8)
    engagement.step(replace(READY, requested_mps=50.0))
    assert engagement.setpoint_mps == pytest.approx(1.8)


def test_every_row_of_the_table_names_a_condition_that_exists():
    conditions = Engagement(EngagementSettings())._conditions(READY, None)
    assert {row.condition for row in TRANSITIONS} == set(conditions)
