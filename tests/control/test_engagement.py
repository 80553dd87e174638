"""The table of transitions: nothing engages by itself."""

import math
from dataclasses import replace

import pytest

from cruise.control.engagement import TRANSITIONS, Engagement, State
from cruise.control.situation import EngagementSettings
from tests.control.situations import READY, engaged, engaging


def test_resume_engages_at_the_requested_speed_and_set_at_the_present_one():
    assert (engaging().state, engaging().setpoint_mps) == (State.ENGAGING, 1.4)
    other = engaging(set=True)
    assert (other.state, other.setpoint_mps) == (State.ENGAGING, 1.1)


def test_engaging_lasts_until_the_speed_has_reached_the_setpoint():
    engagement = engaging()
    for speed_mps in (1.1, 1.2, 1.29):
        assert engagement.step(replace(READY, speed_mps=speed_mps)) is State.ENGAGING
    assert engagement.step(replace(READY, speed_mps=1.31)) is State.ENGAGED
    assert engagement.step(replace(READY, requested_mps=2.0)) is State.ENGAGED  # a new setpoint is no new take-over


def test_without_a_setpoint_on_the_bus_the_buttons_are_enough():
    engagement = Engagement(EngagementSettings())
    alone = replace(READY, requested_mps=math.nan)
    for situation in (alone, alone, replace(alone, set=True)):
        engagement.step(situation)
    for _ in range(3):
        assert engagement.step(alone).controls
    assert engagement.step(replace(alone, requested_mps=1.2)).controls
    assert engagement.setpoint_mps == 1.2
    assert engagement.step(alone) is State.STANDBY  # from now on it is the bus that asks


def test_resume_takes_the_last_setpoint_where_no_panel_ever_asks_for_one():
    alone, time_s = replace(READY, requested_mps=math.nan), 0.0

    def steps(engagement: Engagement, *situations) -> State:
        nonlocal time_s
        for situation in situations:
            time_s += 1.0
            engagement.step(replace(situation, time_s=time_s))
        return engagement.state

    def driven_and_braked(asked: float) -> Engagement:
        engagement = Engagement(EngagementSettings())
        steps(engagement, alone, replace(alone, set=True), replace(alone, requested_mps=asked), alone)
        steps(engagement, replace(alone, brake=True), alone, alone)
        return engagement

    pressed = (alone, replace(alone, resume=True))
    engagement = driven_and_braked(asked=math.nan)
    assert steps(engagement, *pressed) is State.ENGAGING
    assert engagement.setpoint_mps == 1.1
    assert steps(driven_and_braked(asked=1.3), *pressed) is State.STANDBY, "a panel that asked has to ask again"
    assert steps(engagement, replace(alone, enable=False), *pressed) is State.STANDBY, "switching off forgets it"


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"signals_valid": False, "missing": ("gear", "lever_pct")}, "signals are missing: gear, lever_pct"),
        ({"model_ready": False}, "the observer has not caught up yet"),
        ({"contradiction": "a and b"}, "signals contradict each other: a and b"),
        ({"brake": True}, "brake or clutch is pressed"),
        ({"clutch": True}, "brake or clutch is pressed"),
        ({"gear": 0.0}, "no gear is engaged"),
        ({"gear": math.nan}, "no gear is engaged"),
        ({"speed_mps": 0.1}, "the machine is too slow or too fast"),
        ({"speed_mps": math.nan}, "the machine is too slow or too fast"),
        ({"speed_mps": 9.0}, "the machine is too slow or too fast"),
        ({"coming_mps2": 1.1}, "the current was changed too quickly just now"),
        ({"requested_mps": math.nan}, "there is no setpoint to resume"),
        ({"requested_mps": 20.0}, "the setpoint is out of range"),
        ({"operator_present": False}, "the panel's frames are missing"),
        ({"enable": False}, "the main switch is off"),
        ({"ailment": "no bus"}, "after a fault it has to be switched off and on"),
    ],
)
def test_it_does_not_engage_and_says_what_is_in_the_way(fields, why):
    engagement = engaging(**fields)
    assert not engagement.state.drives
    assert engagement.refused == why


@pytest.mark.parametrize(
    ("before", "why"),
    [
        ({"brake": True}, "brake, clutch or lever was in use just now"),
        ({"enable": False}, "the main switch is off"),
        ({"ailment": "no bus"}, "after a fault it has to be switched off and on"),
    ],
)
def test_a_press_says_what_is_in_the_way_in_every_state(before, why):
    engagement = engaged()
    lasting = {name: value for name, value in before.items() if name == "enable"}
    for fields in (before, lasting):
        engagement.step(replace(READY, **fields))
        assert engagement.refused == ""
    for press in (1, 2):  # each counts once, however long the button is held, and the same words twice
        for resume in (True, True, False):
            engagement.step(replace(READY, resume=resume, **lasting))
            assert (engagement.refused, engagement.refusals) == (why, press)
    for k in range(40):
        engagement.step(replace(READY, time_s=0.1 * k, enable=k != 1))
    engagement.step(replace(READY, time_s=4.0, resume=True))
    assert (engagement.state, engagement.refused, engagement.refusals) == (State.ENGAGING, "", 2)


def test_only_the_operators_press_leads_into_a_state_that_drives():
    into = {row.condition for row in TRANSITIONS if row.target.drives and not row.source.drives}
    assert into == {"engage", "commission"}
    assert {row.source for row in TRANSITIONS if row.condition in into} == {State.STANDBY}


def test_a_button_held_while_the_panel_was_lost_does_not_engage_again():
    engagement, held = engaging(), replace(READY, resume=True)
    assert engagement.step(replace(READY, operator_present=False)) is State.STANDBY
    assert [engagement.step(held) for _ in range(3)] == [State.STANDBY] * 3
    assert engagement.step(READY) is State.STANDBY
    assert engagement.step(held) is State.ENGAGING, "a press that was seen to begin"


def test_a_button_held_from_the_start_does_not_engage():
    engagement = Engagement(EngagementSettings())
    for _ in range(10):
        assert not engagement.step(replace(READY, resume=True)).drives


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
    for _ in range(40):  # no button leads out of the range
        engagement.step(READY)
        engagement.step(replace(READY, coast=True))
    assert engagement.setpoint_mps == 0.3
    assert engagement.state.controls


@pytest.mark.parametrize("press", ["set", "accelerate", "coast"])
def test_a_knob_that_wavers_does_not_take_back_what_a_button_said(press):
    engagement = Engagement(EngagementSettings())
    for situation in (READY, READY, replace(READY, set=press == "set", resume=press != "set"), READY):
        engagement.step(situation)
    engagement.step(replace(READY, **{press: True}))
    said_mps = engagement.setpoint_mps
    for k in range(30):
        assert engagement.step(replace(READY, requested_mps=1.4 + 0.001 * (k % 7 == 0))).controls
        assert engagement.setpoint_mps == said_mps
    engagement.step(replace(READY, requested_mps=1.5))
    assert engagement.setpoint_mps == 1.5, "a knob that is turned has the last word"
    engagement.step(replace(READY, requested_mps=1.51))
    assert engagement.setpoint_mps == 1.51, "and every bit of it counts then"


def test_every_row_of_the_table_names_a_condition_that_exists():
    conditions = Engagement(EngagementSettings())._conditions(READY, None)
    assert {row.condition for row in TRANSITIONS} == set(conditions)


@pytest.mark.parametrize("gear", [1.0, 3.0])
def test_a_gear_that_changes_ends_the_drive_upwards_and_downwards(gear):
    engagement = engaged()
    assert engagement.step(replace(READY, gear=gear)) is State.STANDBY


def test_reverse_is_no_gear_to_drive_in_even_where_gears_may_change_under_way():
    settings = EngagementSettings(shifts_under_way=True)
    engagement = Engagement(settings)
    for situation in (READY, READY, replace(READY, set=True), READY):
        engagement.step(situation)
    assert engagement.state.controls
    assert engagement.step(replace(READY, gear=3.0)).controls
    assert engagement.step(replace(READY, gear=-1.0)) is State.STANDBY
