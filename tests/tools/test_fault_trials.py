"""The fault trials: the table is whole, a selection of it runs, and what they measure can fail."""

import json
import math
from dataclasses import replace
from functools import cache
from random import Random

import pytest
from typer.testing import CliRunner

from cruise.can.frame import Frame
from cruise.control.engagement import State
from tools.faults import clean, scores, trial
from tools.faults.__main__ import app, plans
from tools.faults.bed import Bed, Fault
from tools.faults.insides import FullDisk
from tools.faults.manoeuvres import manoeuvre
from tools.faults.table import FAULTS
from tools.faults.trial import Outcome, Plan

CALM = Outcome("speed stuck", 1, 8.0, math.inf, "harmless", "", math.nan, math.nan, 0.1, 0.5, False)


def test_there_are_thirty_faults_and_each_says_what_could_reveal_it():
    assert len(FAULTS) >= 30
    for row in FAULTS.values():
        assert row.does
        assert row.redundancy
        assert isinstance(row.make(Random(1)), Fault)


def _happened(fault: Fault | None, from_s: float) -> tuple:
    """Every frame that anybody heard, what the machine did, what was commanded and what the service has learned."""
    bed = Bed(manoeuvre(3), fault)
    heard = []

    def hear(sender: str, frame: Frame) -> None:
        heard.append((bed.wire.now_s, sender, frame.arbitration_id, bytes(frame.data)))
        bed._hear(sender, frame)

    bed.wire.heard = hear
    bed.run(11.5, from_s)
    return heard, bed.rows, bed.commands, bed.died, repr(bed.node.estimator.rls.theta)


@cache
def _without_fault() -> tuple:
    return _happened(None, math.inf)


@pytest.mark.parametrize("name", [name for name in FAULTS if name != "disk full"])  # that one has a test of its own
def test_every_fault_does_something(name):
    row = FAULTS[name]
    assert _happened(row.make(Random(name)), 0.0 if row.from_start else 8.0) != _without_fault()


def test_a_fault_that_passes_is_still_there_when_the_operator_engages():
    for name in ("speed zero", "CCVS lost"):
        for seed in range(200):
            plan, engage_s = Plan.of(FAULTS[name], seed), manoeuvre(seed).engage_s
            assert plan.to_s > engage_s
            assert plan.to_s - max(plan.from_s, engage_s) >= 0.2


def test_an_exit_before_the_fault_is_none_of_its_work():
    plan = Plan(FAULTS["speed zero"], 3, 16.0, math.inf)
    bed = Bed(manoeuvre(3), FAULTS["CCVS lost"].make(Random(1))).run(plan.seconds, 9.0, math.inf, trial.AFTER_S)
    found = trial.judge(plan, bed)
    assert (found.verdict, found.failed) == ("void", True)
    figures = {figure.key: figure for figure in scores.figures([found, CALM])}
    assert (figures["void"].value, figures["void"].verdict) == (1, "missed")
    assert figures["harmless_by_measure"].value == 1


def test_plans_go_round_by_round_and_are_those_of_their_seed():
    names = list(FAULTS)[:3]
    found = plans(names, 7, 5)
    assert [(plan.row.name, plan.seed) for plan in found] == [(name, seed) for seed in (5, 6, 7) for name in names][:7]
    assert found == plans(names, 7, 5)
    assert len({plan.from_s for plan in found}) == 7


SELECTION = {  # fault, and what has to become of it; the seeds are such that it comes while cruise drives
    "CCVS lost": "operator lost",
    "frames cut off": "",
    "bus-off of the service": "",
    "drive feedback forged, CRC known": "",
    "setpoint inserted": "two setpoints take turns",
    "pump worn": "the speed changes as no command did",
    "disturbance upset": "the program's memory changed by itself",
    "command forged": "another node sends our messages",
    "speed zero": "",
    "speed stuck": "a sensor is frozen",
    "current biased": "its command",
    "engine speed noisy": "a sensor is too noisy",
    "gear not available": "lost: gear",
    "clock steps back": "unhealthy",
    "processor starved": "",
}


@pytest.mark.parametrize("fault", SELECTION)
def test_a_fault_is_noticed(fault):
    plan = next(plan for seed in range(99) if _is_heavy(plan := Plan.of(FAULTS[fault], seed)))
    found = trial.run(plan)
    assert found.verdict == "detected"
    assert not found.failed
    assert SELECTION[fault] in found.how


@pytest.mark.parametrize(
    ("fault", "seed", "how"),
    [
        ("traffic played back", 50005, "the drive's frames were heard before"),  # its counters jump in one of 11 frames
        ("current late", 9008, "the current is late behind its command"),  # by 0.34 s, while it moves slowly
        ("every speed biased", 9008, "the speed changes as no command did"),  # by 0.2 m/s at once, in fourth gear
        ("speed biased", 20008, "the drive's speed has left that of wheel and ground"),  # by 0.17 m/s, so too
        ("brake acts unseen", 110047, "a force came at once"),  # in fourth gear, of 0.5 m/s2, let go within a second
    ],
)
def test_what_was_silent_once_is_noticed(fault, seed, how):
    found = trial.run(Plan.of(FAULTS[fault], seed))
    assert found.verdict in ("detected", "refused")
    assert how in found.how


@pytest.mark.parametrize("seed", [110020, 410106])
def test_a_light_brake_that_is_let_go_after_seconds_is_noticed_or_leaves_the_machine_little_too_fast(seed):
    """In fourth gear and in third; both were silent with an observer that took what it does for a hill sooner."""
    assert trial.run(Plan.of(FAULTS["brake acts unseen"], seed)).verdict in ("detected", "harmless")


@pytest.mark.parametrize("seed", [502, 410911, 411010])
def test_a_drum_that_plugs_and_is_free_again_leaves_the_machine_little_too_fast(seed):
    """While the setpoint falls; silent while the guard waited for the load and foresaw an engine without end.

    The first braked with 1.5 m/s2, the others made up for an engine that lugged and were 0.3 to 0.4 m/s too fast.
    """
    found = trial.run(Plan.of(FAULTS["drum plugged"], seed))
    assert found.verdict == "harmless"
    assert found.accel_mps2 < 1.3


def _is_heavy(plan: Plan) -> bool:
    """While cruise drives, and for good."""
    return plan.from_s > manoeuvre(plan.seed).engage_s + 2.0 and math.isinf(plan.to_s)


def test_a_full_disk_ends_nothing():
    plan = next(plan for seed in range(99) if _is_heavy(plan := Plan.of(FAULTS["disk full"], seed)))
    bed = trial.driven(plan)
    assert trial.judge(plan, bed).verdict == "harmless"
    assert isinstance(bed.fault, FullDisk)
    assert "No space left on device" in bed.fault.box.problem
    assert "No space left on device" in bed.fault.keeper.problem


def test_what_another_node_commands_is_no_command_of_the_service():
    plan = Plan(FAULTS["command forged"], 1, 3.0, math.inf)  # before the operator engages
    bed = trial.driven(plan)
    assert bed.combine_node.driven_by_cruise
    assert not any(row.obeyed for row in bed.rows)
    assert trial.judge(plan, bed).verdict == "refused"


def test_a_fault_that_does_no_more_than_the_drive_without_it_is_harmless(monkeypatch: pytest.MonkeyPatch):
    plan = Plan(FAULTS["slope lies"], 2, 9.0, math.inf)
    bed = trial.driven(plan)
    monkeypatch.setattr(trial, "ACCEL_MPS2", 1e-3)
    assert trial.judge(plan, bed).verdict == "harmless"
    monkeypatch.setattr(trial, "_harm_without", lambda plan: (0.0, 0.0))
    assert trial.judge(plan, bed).verdict == "silent"


def test_fourth_gear_is_the_roads():
    for seed in range(60):
        field = manoeuvre(seed).field
        road = field[0].gear == 4
        assert all(not row.crop_power_kw for row in field) or not road
        assert all((row.rolling_resistance or 0.0) <= 0.055 for row in field) or not road


def test_a_parameter_file_that_is_cut_off_is_no_start():
    found = trial.run(Plan.of(FAULTS["parameter file cut off"], 2))
    assert found.verdict == "refused"
    assert found.how.startswith("does not start")
    assert not found.crashed


class Blind(Fault):
    """Every speed is half of what it is, and nobody compares anything."""

    def begin(self, bed: Bed) -> None:
        bed.node.plausibility = None

    def said(self, message: str, values: dict[str, float], now_s: float) -> dict[str, float]:
        return {name: value * (0.5 if name.endswith("speed_mps") else 1.0) for name, value in values.items()}


def test_a_fault_that_lasts_has_its_time_to_show():
    """Downhill in third gear: half a second before it is noticed an open drive line still looks like the hill."""
    plan = replace(Plan.of(FAULTS["drive line opens unseen"], 281114), seconds=20.5)
    assert trial.judge(plan, trial.driven(plan)).verdict == "silent"
    found = trial.run(plan)
    assert (found.verdict, found.how) == ("detected", "overspeed")
    assert plan.from_s + found.after_s > plan.seconds


def test_without_redundancy_the_trial_says_silent_failure():
    row = replace(FAULTS["every speed scaled"], make=lambda rng: Blind(), bounded=False)
    plan = Plan(row, 1, manoeuvre(1).engage_s + 2.0, math.inf)
    found = trial.run(plan)
    assert found.verdict == "silent"
    assert found.overspeed_mps > trial.OVERSPEED_MPS
    assert found.failed


class Ends(Fault):
    """Something of the service is gone, and it does not catch that."""

    def begin(self, bed: Bed) -> None:
        del bed.node.pace


@pytest.mark.parametrize(("fault", "from_s"), [("CCVS lost", 8.0), ("parameters of another machine", 0.0)])
def test_a_service_that_ends_by_an_exception_has_detected_nothing(fault, from_s):
    plan = Plan(replace(FAULTS[fault], make=lambda rng: Ends()), 1, from_s, math.inf)
    found = trial.run(plan)
    assert found.crashed
    assert found.failed
    assert {figure.key: figure for figure in scores.figures([found])}["crashed"].verdict == "missed"


def test_a_service_that_commands_after_its_exit_fails():
    plan = Plan.of(FAULTS["CCVS lost"], 3)
    bed = trial.driven(plan)
    assert not trial.judge(plan, bed).active_after
    bed.commands.append((bed.left_s + 0.1, True, 500.0))
    assert trial.judge(plan, bed).failed


@pytest.mark.parametrize(
    ("fault", "silence_s", "in_time"),
    [
        ("EEC1 lost", 0.30, True),
        ("EEC1 lost", 0.31, False),
        ("operator lost", 0.31, False),
        ("speed stuck", math.nan, True),
    ],
)
def test_a_time_out_has_300_ms_or_three_periods(fault, silence_s, in_time):
    assert replace(CALM, fault=fault, silence_s=silence_s).in_time is in_time


def test_the_figures_count_what_there_is():
    late = replace(CALM, fault="speed zero", verdict="detected", how="a", after_s=0.4, overspeed_mps=0.5)
    silent = replace(CALM, verdict="silent", accel_mps2=2.0)
    found = {figure.key: figure for figure in scores.figures([CALM, late, silent])}
    assert (found["faults"].value, found["trials"].value) == (2, 3)
    assert (found["silent"].value, found["silent"].verdict) == (1, "missed")
    assert (found["detected_late"].value, found["until_detected_overspeed_mps"].value) == (1, 0.5)
    assert found["harmless_by_measure_overspeed_mps"].value == 0.1


def test_a_drive_without_fault_ends_with_its_time():
    found = clean.drive(4, 25.0)
    assert (found.how, found.hours) == ("", pytest.approx(25.0 / 3600.0))
    assert found.overspeed_mps < trial.OVERSPEED_MPS


def test_a_manoeuvre_moves_what_there_is_to_move_and_is_that_of_its_seed():
    assert manoeuvre(3) == manoeuvre(3) != manoeuvre(4)
    gears = {manoeuvre(seed).field[0].gear for seed in range(40)}
    assert gears == {1, 2, 3, 4}
    bed = Bed(manoeuvre(3)).run(8.0)
    assert bed.rows[-1].state.controls
    assert {row.state for row in bed.rows} >= {State.OFF, State.STANDBY, State.ENGAGING}


def test_the_command_line_prints_json_and_fails_where_a_trial_does(monkeypatch: pytest.MonkeyPatch):
    def run(arguments: list[str]) -> tuple[int, dict]:
        result = CliRunner().invoke(app, arguments)
        return result.exit_code, json.loads(result.stdout)

    code, printed = run(["--count", "2", "--faults", "CCVS lost", "--seed", "3", "--json"])
    assert code == 0
    assert [one["fault"] for one in printed["trials"]] == ["CCVS lost"] * 2
    assert printed["seeds"] == [3]
    monkeypatch.setattr("tools.faults.__main__.run", lambda plan: replace(CALM, verdict="silent"))
    code, printed = run(["--count", "1", "--faults", "speed stuck", "--json"])
    assert code == 1
    assert printed["figures"]["silent"]["value"] == 1


def test_a_machine_that_slows_down_sooner_than_the_reference_is_not_behind():
    bed = Bed(manoeuvre(3)).run(9.0)
    node = bed.node
    node.engagement.setpoint_mps = 0.5
    assert node.controller.past_references[0] > 0.6
    assert node._seen(node._frame(9.05)).followed_mps == 0.5
