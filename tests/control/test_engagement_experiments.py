"""An experiment is driven after two deliberate acts only, and ends with either."""

import math
from dataclasses import replace

import pytest

from cruise.control.commissioning import CommissioningSettings, Conditions, Experiment
from cruise.control.engagement import TRANSITIONS, Engagement, ExitReason, State
from cruise.control.excitation import Ramp
from cruise.control.situation import EngagementSettings, Situation
from tests.control.situations import READY

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
    "unhealthy": ({"ailment": "no bus"}, State.FAULT, ExitReason.FUNCTION_FAULT),
    "operator_lost": ({"operator_present": False}, State.STANDBY, ExitReason.OPERATOR_LOST),
    "switched_off": ({"enable": False}, State.OFF, ExitReason.RELEASED),
    "brake": ({"brake": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "clutch": ({"clutch": True}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "lever_moved": ({"lever_pct": 6.0}, State.OVERRIDDEN, ExitReason.OVERRIDE),
    "neutral": ({"gear": 0.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "drive_signals_lost": (
        {"drive_signals_valid": False, "missing": ("gear",)},
        State.STANDBY,
        ExitReason.FUNCTION_FAULT,
    ),
    "gear_changed": ({"gear": 3.0}, State.STANDBY, ExitReason.CONTROL_POSITION),
    "request_withdrawn": ({"requested_experiment": 0}, State.STANDBY, ExitReason.RELEASED),
    "too_fast": ({"fastest_mps": 2.1}, State.STANDBY, ExitReason.FUNCTION_FAULT),
    "implausible": ({"contradiction_in_experiment": "two speeds"}, State.FAULT, ExitReason.FUNCTION_FAULT),
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
    assert engagement.exit_detail == fields.get(
        "contradiction_in_experiment", fields.get("ailment", ", ".join(fields.get("missing", ())))
    )
    # The cause goes away, the request and even the button are still held, and the machine has come to rest.
    for situation in (replace(ASKED, **fields), ASKED, DRIVEN, ASKED, ASKED):
        assert engagement.step(situation) is not State.COMMISSIONING


@pytest.mark.parametrize("fields", [{"requested_experiment": 8}, {"lever_pct": -6.0}])
def test_another_request_and_the_lever_backwards_end_it_too(fields):
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
    only = {"signals_valid": False, "model_ready": False, "contradiction": "too noisy"}
    assert engagement.step(replace(DRIVEN, **only)) is State.COMMISSIONING
    assert operator(ASKED, replace(ASKED, set=True, **only)).state is State.COMMISSIONING


REFUSALS = [
    ({"requested_experiment": 9}, "no experiment has this number"),
    ({"requested_experiment": 8}, "the experiment is for gear 3"),
    ({"set": False, "resume": True}, "an experiment begins with set, not with resume"),
    ({"drive_signals_valid": False, "missing": ("gear",)}, "signals are missing: gear"),
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
    ({"contradiction_in_experiment": "two speeds"}, "signals contradict each other: two speeds"),
]


@pytest.mark.parametrize(("fields", "why"), REFUSALS)
def test_an_experiment_does_not_begin_and_it_is_said_what_is_in_the_way(fields, why):
    before = replace(ASKED, requested_experiment=fields.get("requested_experiment", 7))
    engagement = operator(before, replace(ASKED, **({"set": True} | fields)))
    assert engagement.state is not State.COMMISSIONING
    assert engagement.refused == why


@pytest.mark.parametrize("fields", [{"enable": False}, {"ailment": "no bus"}])
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
