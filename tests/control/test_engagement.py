"""The table of transitions, row by row; nothing engages by itself."""

import math
from dataclasses import replace

import pytest

from cruise.control.commissioning import CommissioningSettings, Conditions, Experiment
from cruise.control.engagement import TRANSITIONS, Engagement, ExitReason, State
from cruise.control.excitation import Ramp
from cruise.control.situation import EngagementSettings, Situation

READY = Situation(
    time_s=0.0,
    enable=True,
    set=False,
    resume=False,
    accelerate=False,
    coast=False,
    operator_present=True,
    signals_valid=True,
    drive_signals_valid=True,
    model_ready=True,
    healthy=True,
    contradiction="",
    brake=False,
    clutch=False,
    gear=2.0,
    lever_pct=40.0,
    speed_mps=1.1,
    coming_mps2=0.2,
    requested_mps=1.4,
    reference_mps=1.1,
    requested_experiment=0,
    experiment_over=False,
)


def engaging(settings: EngagementSettings | None = None, **fields) -> Engagement:
    engagement = Engagement(settings or EngagementSettings())
    for situation in (READY, READY, replace(READY, resume=True, **fields)):
        engagement.step(situation)
    return engagement


def engaged(settings: EngagementSettings | None = None) -> Engagement:
    engagement = engaging(settings)
    engagement.step(DRIVEN_AT_SETPOINT)
    assert engagement.state is State.ENGAGED
    return engagement


DRIVEN_AT_SETPOINT = replace(READY, speed_mps=1.38)


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


def test_overspeed_is_more_than_a_hill_adds_and_that_is_more_in_a_fast_gear():
    for wished_mps, least_mps, most_mps in ((1.4, 0.28, 0.32), (2.2, 0.4, 0.5), (3.6, 0.8, 0.9)):
        for over_mps in (least_mps, most_mps):
            engagement = engaged()
            engagement.setpoint_mps = wished_mps
            now = replace(READY, reference_mps=wished_mps, speed_mps=wished_mps + over_mps)
            assert (engagement.step(now) is State.FAULT) is (over_mps == most_mps)


EXITS = {
    "unhealthy": ({"healthy": False}, State.FAULT, ExitReason.FUNCTION_FAULT),
    "operator_lost": ({"operator_present": False}, State.STANDBY, ExitReason.OPERATOR_LOST),
    "switched_off": ({"enable": False}, State.OFF, ExitReason.RELEASED),
    "brake": ({"brake": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "clutch": ({"clutch": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "lever_moved": ({"lever_pct": 45.1}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "neutral": ({"gear": 0.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "signals_lost": ({"signals_valid": False, "gear": math.nan}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    "shifted": ({"gear": 3.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "setpoint_lost": ({"requested_mps": math.nan}, State.STANDBY, ExitReason.COMMAND_TIMEOUT),
    "setpoint_invalid": ({}, State.STANDBY, ExitReason.COMMAND_INVALID),
    "implausible": ({"contradiction": "two speeds"}, State.FAULT, ExitReason.FUNCTION_FAULT),
    "overspeed": ({"speed_mps": 1.81}, State.FAULT, ExitReason.FUNCTION_FAULT),
}


@pytest.mark.parametrize("state", [State.ENGAGING, State.ENGAGED])
def test_every_exit_of_the_controller_is_tried_below(state):
    assert [row.condition for row in TRANSITIONS if row.source is state and row.target is not State.ENGAGED] == [*EXITS]


@pytest.mark.parametrize("begin", [engaging, engaged])
@pytest.mark.parametrize("condition", EXITS)
def test_every_exit_acts_in_one_step_says_why_and_does_not_come_back(begin, condition):
    fields, target, reason = EXITS[condition]
    engagement = begin()
    if condition == "setpoint_invalid":
        engagement.setpoint_mps = math.nan
    held = replace(READY, resume=True, set=True)
    assert engagement.step(replace(held, **fields)) is target
    assert (engagement.exit_condition, engagement.exit_reason) == (condition, reason)
    assert engagement.exit_detail == fields.get("contradiction", "")
    for k in range(100):  # the cause goes away while both buttons stay down, and then they are let go
        now = replace(held if k < 50 else READY, time_s=0.05 * k)
        assert not engagement.step(now).drives
    assert (engagement.exit_condition, engagement.exit_reason) == (condition, reason)


@pytest.mark.parametrize("fields", [{"lever_pct": 0.0}, {"lever_pct": 34.9}, {"gear": -1.0}, {"speed_mps": 5.0}])
def test_the_lever_backwards_reverse_gear_and_any_greater_speed_end_it_too(fields):
    assert not engaged().step(replace(DRIVEN_AT_SETPOINT, **fields)).drives


@pytest.mark.parametrize("fields", [{"lever_pct": 44.9}, {"lever_pct": 35.1}, {"speed_mps": 1.69}])
def test_what_is_less_than_a_limit_does_not_end_it(fields):
    assert engaged().step(replace(DRIVEN_AT_SETPOINT, **fields)) is State.ENGAGED


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


@pytest.mark.parametrize(
    ("fields", "target"), [({"healthy": False}, State.FAULT), ({"enable": False}, State.OFF), ({}, State.OVERRIDDEN)]
)
def test_fault_and_switch_count_in_an_override_too(fields, target):
    engagement = engaged()
    engagement.step(replace(READY, brake=True))
    assert engagement.step(replace(READY, **fields)) is target


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"signals_valid": False}, "signals are missing"),
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
        ({"requested_mps": math.nan}, "the setpoint is out of range"),
        ({"requested_mps": 20.0}, "the setpoint is out of range"),
        ({"operator_present": False}, "the panel's frames are missing"),
        ({"enable": False}, ""),
        ({"healthy": False}, ""),
    ],
)
def test_it_does_not_engage_and_says_what_is_in_the_way(fields, why):
    engagement = engaging(**fields)
    assert not engagement.state.drives
    assert engagement.refused == why


def test_only_the_operators_press_leads_into_a_state_that_drives():
    into = {row.condition for row in TRANSITIONS if row.target.drives and not row.source.drives}
    assert into == {"engage", "commission"}
    assert {row.source for row in TRANSITIONS if row.condition in into} == {State.STANDBY}


def test_every_way_out_of_driving_has_a_reason_and_no_other_way_out_pretends_one():
    for row in TRANSITIONS:
        if row.source.drives and not row.target.drives:
            assert row.reason is not ExitReason.NONE
        elif row.target is not State.FAULT:
            assert row.reason is ExitReason.NONE


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


EXPERIMENTS = {
    number: Experiment(
        name=f"ramp {number}",
        number=number,
        excitation=Ramp(low_ma=400.0, high_ma=900.0, rate_ma_per_s=20.0),
        conditions=Conditions(gear=gear),
        speed_max_mps=2.0,
    )
    for number, gear in ((7, 2), (8, 3))
}
ASKED = replace(READY, requested_experiment=7, lever_pct=0.0, speed_mps=0.02, requested_mps=math.nan)
DRIVEN = replace(ASKED, speed_mps=1.2)


def operator(*situations: Situation) -> Engagement:
    """An engagement on a machine that is being commissioned, after these situations."""
    engagement = Engagement(EngagementSettings(), CommissioningSettings(experiments="here"), EXPERIMENTS)
    for situation in (replace(READY, lever_pct=0.0, speed_mps=0.0), *situations):
        engagement.step(situation)
    return engagement


def commissioning() -> Engagement:
    engagement = operator(ASKED, replace(ASKED, set=True))
    assert engagement.state is State.COMMISSIONING
    return engagement


def test_an_experiment_begins_when_it_is_asked_for_and_then_set_is_pressed():
    engagement = commissioning()
    assert engagement.experiment is EXPERIMENTS[7]
    assert (engagement.refused, engagement.exit_condition, engagement.exit_reason) == ("", "", ExitReason.NONE)
    assert math.isnan(engagement.setpoint_mps)
    for situation in (
        replace(DRIVEN, set=True),
        DRIVEN,
        replace(DRIVEN, resume=True),
        replace(DRIVEN, accelerate=True),
    ):
        assert engagement.step(situation) is State.COMMISSIONING
    assert engagement.refused == ""


ENDS = {
    "unhealthy": ({"healthy": False}, State.FAULT, ExitReason.FUNCTION_FAULT),
    "operator_lost": ({"operator_present": False}, State.STANDBY, ExitReason.OPERATOR_LOST),
    "switched_off": ({"enable": False}, State.OFF, ExitReason.RELEASED),
    "brake": ({"brake": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "clutch": ({"clutch": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "lever_moved": ({"lever_pct": 6.0}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "neutral": ({"gear": 0.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "drive_signals_lost": ({"drive_signals_valid": False, "gear": math.nan}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    "gear_changed": ({"gear": 3.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "request_withdrawn": ({"requested_experiment": 0}, State.STANDBY, ExitReason.RELEASED),
    "too_fast": ({"speed_mps": 2.1}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    "finished": ({"experiment_over": True}, State.STANDBY, ExitReason.RELEASED),
}


def test_every_row_of_commissioning_is_tried_below():
    assert [row.condition for row in TRANSITIONS if row.source is State.COMMISSIONING] == list(ENDS)


@pytest.mark.parametrize("condition", ENDS)
def test_every_end_of_an_experiment_acts_in_one_step_says_why_and_does_not_come_back(condition):
    fields, target, reason = ENDS[condition]
    engagement = commissioning()
    engagement.step(DRIVEN)
    assert engagement.step(replace(DRIVEN, **fields)) is target
    assert (engagement.exit_condition, engagement.exit_reason) == (condition, reason)
    # The cause goes away, the request and even the button are still held, and the machine has come to rest.
    for situation in (replace(ASKED, **fields), ASKED, DRIVEN, ASKED, ASKED):
        assert engagement.step(situation) is not State.COMMISSIONING


@pytest.mark.parametrize("fields", [{"speed_mps": -2.1}, {"requested_experiment": 8}, {"lever_pct": -6.0}])
def test_rolling_backwards_another_request_and_the_lever_backwards_end_it_too(fields):
    engagement = commissioning()
    assert not engagement.step(replace(DRIVEN, **fields)).drives


def test_a_held_button_does_not_begin_the_experiment_again():
    engagement = commissioning()
    engagement.step(replace(DRIVEN, set=True, brake=True))
    for k in range(40):
        assert not engagement.step(replace(ASKED, time_s=0.05 * k, set=True)).drives
    assert engagement.step(replace(ASKED, time_s=2.0)) is State.STANDBY
    assert (
        engagement.step(replace(ASKED, time_s=2.1, set=True)) is State.COMMISSIONING
    )  # on purpose: released and pressed


def test_what_only_the_controller_needs_does_not_end_an_experiment():
    engagement = commissioning()
    assert engagement.step(replace(DRIVEN, signals_valid=False, model_ready=False)) is State.COMMISSIONING


REFUSALS = [
    ({"requested_experiment": 9}, "no experiment has this number"),
    ({"requested_experiment": 8}, "the experiment is for gear 3"),
    ({"set": False, "resume": True}, "an experiment begins with set, not with resume"),
    ({"drive_signals_valid": False}, "signals are missing"),
    ({"brake": True}, "brake or clutch is pressed"),
    ({"clutch": True}, "brake or clutch is pressed"),
    ({"gear": 0.0}, "the experiment is for gear 2"),
    ({"gear": 3.0}, "the experiment is for gear 2"),
    ({"lever_pct": 10.0}, "the lever is not at rest"),
    ({"lever_pct": -10.0}, "the lever is not at rest"),
    ({"lever_pct": math.nan}, "the lever is not at rest"),
    ({"speed_mps": 0.5}, "the machine is not near standstill"),
    ({"speed_mps": -0.5}, "the machine is not near standstill"),
    ({"speed_mps": math.nan}, "the machine is not near standstill"),
    ({"operator_present": False}, "the panel's frames are missing"),
]


@pytest.mark.parametrize(("fields", "why"), REFUSALS)
def test_an_experiment_does_not_begin_and_it_is_said_what_is_in_the_way(fields, why):
    before = replace(ASKED, requested_experiment=fields.get("requested_experiment", 7))
    engagement = operator(before, replace(ASKED, **({"set": True} | fields)))
    assert engagement.state is not State.COMMISSIONING
    assert engagement.refused == why


@pytest.mark.parametrize("fields", [{"enable": False}, {"healthy": False}])
def test_an_experiment_does_not_begin_with_the_switch_off_or_a_fault(fields):
    assert operator(ASKED, replace(ASKED, set=True, **fields)).state in (State.OFF, State.FAULT)


def test_the_request_has_to_stand_before_the_button():
    calm = replace(ASKED, requested_experiment=0)
    engagement = operator(calm, replace(ASKED, set=True))
    assert engagement.refused == "the experiment has to be asked for before the button"
    for _ in range(5):
        assert engagement.step(replace(ASKED, set=True)) is State.STANDBY


def test_a_request_alone_begins_nothing():
    assert operator(*[ASKED] * 20).state is State.STANDBY


def test_without_commissioning_in_the_settings_there_are_no_experiments():
    engagement = Engagement(EngagementSettings(), None, EXPERIMENTS)
    for situation in (READY, ASKED, replace(ASKED, set=True)):
        assert engagement.step(situation) is not State.COMMISSIONING
    assert engagement.refused == "the settings have no commissioning"


@pytest.mark.parametrize("button", ["set", "resume"])
def test_while_an_experiment_is_asked_for_the_cruise_control_does_not_engage(button):
    asked = replace(READY, requested_experiment=7)
    engagement = operator(asked, replace(asked, **{button: True}))
    assert engagement.state is State.STANDBY
    assert engagement.refused


def test_no_setpoint_is_left_over_in_an_experiment():
    engagement = operator(READY, replace(READY, resume=True))
    assert engagement.setpoint_mps == 1.4
    asked = replace(ASKED, time_s=4.0)
    for situation in (replace(READY, brake=True), replace(ASKED, time_s=2.0), asked, replace(asked, set=True)):
        engagement.step(situation)
    assert engagement.state is State.COMMISSIONING
    assert math.isnan(engagement.setpoint_mps)


def test_after_an_experiment_the_cruise_control_engages_as_ever():
    engagement = commissioning()
    for situation in (replace(DRIVEN, requested_experiment=0), READY, replace(READY, resume=True)):
        engagement.step(situation)
    assert (engagement.state, engagement.setpoint_mps) == (State.ENGAGING, 1.4)


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
