"""Who drives, as one table of transitions; nothing engages by itself.

    off ── standby ── engaging ── engaged          the controller drives in engaging and engaged
              │           └──────────┴── overridden ── standby
              └── commissioning                    an experiment drives
    fault: from any of them; only switching off and on leads out

Rows are tried from the top and the first that holds is taken, so the order is the priority. A row acts in the cycle in
which its condition is seen. The machine engages on a rising edge of a button in standby only, never because a condition
went away. Exit reasons are those of ISO 11783-7, SPN 5818.

Engaging is the take-over: it begins with the current and the speed that the machine has, and gently, and is over once
the speed has reached the setpoint; a machine that can't get there stays in it and says so. Overridden is what ISO 11783
calls an operator's override: brake, clutch or lever. The controller has let go for good by then; the state says that a
person is acting, and until pedals and lever have been left alone for a while no button is taken. It is not the override
of a car's cruise control, which comes back when the pedal is released: here release never engages again.

A machine that is driven and stands, plugged or with its engine stalled, is let go: when what held it gives way, nobody
expects it to start. A setpoint on the bus that is out of range ends the drive, too; it is not passed over.

Commissioning takes two deliberate acts: the panel asks for an experiment by its number, and keeps asking, and then the
operator presses `set`, near standstill with the lever at rest. Letting go of either the request or the machine's
controls ends it. While an experiment is asked for, the buttons do not engage the cruise control.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final

from cruise.control.commissioning import CommissioningSettings, Experiment
from cruise.control.situation import (
    WAVERING_MPS,
    EngagementSettings,
    Situation,
    against_commissioning,
    against_engaging,
)


class State(StrEnum):
    """Who owns the current. Their order is their number on the bus: new ones are appended."""

    OFF = "off"  # main switch off
    STANDBY = "standby"  # ready, a person drives
    ENGAGED = "engaged"  # the controller drives
    FAULT = "fault"  # a person drives; only switching off and on leads out
    COMMISSIONING = "commissioning"  # an experiment drives, for identification
    ENGAGING = "engaging"  # the controller drives, and is not yet at the setpoint
    OVERRIDDEN = "overridden"  # a person took over and still acts

    @property
    def controls(self) -> bool:
        """Whether the controller drives."""
        return self in (State.ENGAGING, State.ENGAGED)

    @property
    def drives(self) -> bool:
        """Whether the program owns the current, by controller or experiment."""
        return self.controls or self is State.COMMISSIONING


class ExitReason(IntEnum):
    """ISO 11783-7, SPN 5818: why a function was left. Only those that we use."""

    NONE = 0  # all clear
    OPERATOR_LOST = 1  # required level of operator presence not detected
    RELEASED = 2  # control of the function released
    OVERRIDE = 3  # operator override of the function
    CONTROL_POSITION = 4  # operator control not in a valid position
    COMMAND_TIMEOUT = 5  # remote command timed out
    COMMAND_INVALID = 6  # remote command out of range or invalid
    FUNCTION_FAULT = 9  # fault of the function


@dataclass(frozen=True, slots=True)
class Transition:
    """One row: from `source`, if the condition holds, to `target`."""

    source: State
    condition: str
    target: State
    reason: ExitReason


_ANY_END: Final = (
    ("unhealthy", State.FAULT, ExitReason.FUNCTION_FAULT),
    ("operator_lost", State.STANDBY, ExitReason.OPERATOR_LOST),
    ("switched_off", State.OFF, ExitReason.RELEASED),
    ("brake", State.OVERRIDDEN, ExitReason.OVERRIDE),
    ("clutch", State.OVERRIDDEN, ExitReason.OVERRIDE),
    ("lever_moved", State.OVERRIDDEN, ExitReason.OVERRIDE),
    ("neutral", State.STANDBY, ExitReason.CONTROL_POSITION),
)

_ANY_EXIT: Final = (
    *_ANY_END,
    ("signals_lost", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("shifted", State.STANDBY, ExitReason.CONTROL_POSITION),
    ("setpoint_lost", State.STANDBY, ExitReason.COMMAND_TIMEOUT),
    ("setpoint_invalid", State.STANDBY, ExitReason.COMMAND_INVALID),
    ("standing", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("implausible", State.FAULT, ExitReason.FUNCTION_FAULT),
    ("overspeed", State.FAULT, ExitReason.FUNCTION_FAULT),
)

_EXPERIMENT_END: Final = (
    *_ANY_END,
    ("drive_signals_lost", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("gear_changed", State.STANDBY, ExitReason.CONTROL_POSITION),
    ("request_withdrawn", State.STANDBY, ExitReason.RELEASED),
    ("too_fast", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("implausible", State.FAULT, ExitReason.FUNCTION_FAULT),
    ("finished", State.STANDBY, ExitReason.RELEASED),
)

TRANSITIONS: Final[tuple[Transition, ...]] = (
    *(Transition(State.ENGAGED, *row) for row in _ANY_EXIT),
    *(Transition(State.ENGAGING, *row) for row in _ANY_EXIT),
    Transition(State.ENGAGING, "reached", State.ENGAGED, ExitReason.NONE),
    *(Transition(State.COMMISSIONING, *row) for row in _EXPERIMENT_END),
    Transition(State.OFF, "switched_on", State.STANDBY, ExitReason.NONE),
    Transition(State.STANDBY, "unhealthy", State.FAULT, ExitReason.FUNCTION_FAULT),
    Transition(State.STANDBY, "switched_off", State.OFF, ExitReason.NONE),
    Transition(State.STANDBY, "commission", State.COMMISSIONING, ExitReason.NONE),
    Transition(State.STANDBY, "engage", State.ENGAGING, ExitReason.NONE),
    Transition(State.OVERRIDDEN, "unhealthy", State.FAULT, ExitReason.FUNCTION_FAULT),
    Transition(State.OVERRIDDEN, "switched_off", State.OFF, ExitReason.NONE),
    Transition(State.OVERRIDDEN, "left_alone", State.STANDBY, ExitReason.NONE),
    Transition(State.FAULT, "switched_off", State.OFF, ExitReason.NONE),
)


_NOT_NOW: Final = {  # what a press is told in states in which no button is taken
    State.OFF: "the main switch is off",
    State.FAULT: "after a fault it has to be switched off and on",
    State.OVERRIDDEN: "brake, clutch or lever was in use just now",
}


class Engagement:
    """The state, the setpoint or the experiment, and why the last engagement or experiment ended.

    `experiments` by number; without `commissioning` none can be driven.
    """

    def __init__(
        self,
        settings: EngagementSettings,
        commissioning: CommissioningSettings | None = None,
        experiments: Mapping[int, Experiment] | None = None,
    ) -> None:
        self.settings = settings
        self.commissioning = commissioning
        self.experiments = dict(experiments or {})
        self.experiment: Experiment | None = None  # the last one that was begun
        self.state = State.OFF
        self.setpoint_mps = math.nan
        self.exit_reason = ExitReason.NONE
        self.exit_condition = ""
        self.exit_detail = ""  # which signals were missing or contradicted each other, or what ailed bus or program
        self.ailed = ""  # what ailed them when the last fault began, whoever drove
        self.exits = 0  # since the start
        self.refused = ""  # why the last press of a button neither engaged nor began an experiment
        self.refusals = 0  # presses that were refused since the start
        self._last: Situation | None = None
        self._requested_mps = math.nan  # last setpoint on the bus that was heeded; a pause of its frames is no new word
        self._by_panel = False  # the setpoint is the panel's, and not that of a button
        self._commanded = False  # a setpoint was heard while the controller drives: from then on it must not be missing
        self._lever_pct = math.nan  # where the lever stood at the take-over, or when it was moved last
        self._gear = math.nan  # at the take-over
        self._allowed_mps = -math.inf  # setpoint and reference as slowly as the machine may follow them down
        self._acted_s = -math.inf  # when a pedal or the lever was last seen in use while overridden
        self._moved_s = -math.inf  # when the machine was last seen to move

    @property
    def ended_by(self) -> str:
        """Why the last engagement or experiment ended, in words; empty while one drives and where there was none."""
        if not self.exit_condition:
            return ""
        detail = f", {self.exit_detail}" if self.exit_detail else ""
        reason = self.exit_reason
        return f"{_words(self.exit_condition)}{detail} (ISO exit reason {reason:d}, {_words(reason.name.lower())})"

    def step(self, now: Situation) -> State:
        """One instant on."""
        last, self._last = self._last, now
        if self.state is State.OVERRIDDEN:
            self._watch_operator(now)
        self._allow(now, last)
        if not abs(now.speed_mps) < self.settings.standing_mps:
            self._moved_s = now.time_s
        pressed = self._pressed(now, last)
        if pressed:
            self.refused = ""
        holds = self._conditions(now, last)
        for row in TRANSITIONS:
            if row.source is self.state and holds[row.condition]:
                self._enter(row, now)
                break
        if pressed and not self.refused:
            self.refused = _NOT_NOW.get(self.state, "")
        self.refusals += pressed and bool(self.refused)
        if self.state.controls and last is not None:
            self._follow(now, last)
        elif math.isfinite(now.requested_mps):
            self._requested_mps = now.requested_mps
        return self.state

    def _conditions(self, now: Situation, last: Situation | None) -> dict[str, bool]:
        settings, experiment = self.settings, self.experiment
        pressed = self.state is State.STANDBY and self._pressed(now, last)
        asked = now.requested_experiment != 0
        target_mps = self.setpoint_mps
        word_mps = now.requested_mps if self._is_new(now.requested_mps) else target_mps
        return {
            "unhealthy": bool(now.ailment),
            "operator_lost": not now.operator_present,
            "switched_on": now.operator_present and now.enable,
            "switched_off": now.operator_present and not now.enable,
            "brake": now.brake,
            "clutch": now.clutch,
            "lever_moved": self._lever_moved(now),
            "left_alone": now.time_s - self._acted_s > settings.override_s,
            "neutral": now.gear <= 0,
            "shifted": now.gear != self._gear and not settings.shifts_under_way,
            "signals_lost": not now.signals_valid,
            "setpoint_lost": self._commanded and math.isnan(now.requested_mps),
            "setpoint_invalid": not settings.speed_min_mps <= word_mps <= settings.speed_max_mps,
            "standing": now.time_s - self._moved_s > settings.standing_s,
            "implausible": bool(self._contradiction(now)),
            "overspeed": now.speed_mps - self._allowed_mps > settings.hill_mps(now.alpha),
            "reached": abs(now.speed_mps - target_mps) <= settings.reached_mps,
            "drive_signals_lost": not now.drive_signals_valid,
            "gear_changed": experiment is not None and now.gear != experiment.conditions.gear,
            "request_withdrawn": experiment is not None and now.requested_experiment != experiment.number,
            "too_fast": experiment is not None and now.fastest_mps > experiment.speed_max_mps,
            "finished": now.experiment_over,
            "commission": pressed and asked and self._may_commission(now, last),
            "engage": pressed and not asked and self._may_engage(now),
        }

    def _pressed(self, now: Situation, last: Situation | None) -> bool:
        """Whether a button that engages goes down; one that was held while the panel was lost does not."""
        if last is None or not last.operator_present:
            return False
        return (now.set and not last.set) or (now.resume and not last.resume)

    def _contradiction(self, now: Situation) -> str:
        return now.contradiction_in_experiment if self.state is State.COMMISSIONING else now.contradiction

    def _detail(self, condition: str, now: Situation) -> str:
        if condition == "unhealthy":
            return now.ailment
        if condition in ("signals_lost", "drive_signals_lost"):
            return ", ".join(now.missing)
        return self._contradiction(now) if condition == "implausible" else ""

    def _may_engage(self, now: Situation) -> bool:
        self.refused = against_engaging(now, self.settings, self._wanted_mps(now))
        return not self.refused

    def _wanted_mps(self, now: Situation) -> float:
        """With `set` the speed that it has; with `resume` what the panel asks for, or, if it never does, what held."""
        if now.set:
            return now.speed_mps
        asks = math.isfinite(now.requested_mps) or self._commanded
        return now.requested_mps if asks else self.setpoint_mps

    def _may_commission(self, now: Situation, last: Situation | None) -> bool:
        assert last is not None
        experiment = self.experiments.get(now.requested_experiment)
        self.refused = against_commissioning(now, last, self.commissioning, experiment)
        return not self.refused

    def _allow(self, now: Situation, last: Situation | None) -> None:
        """A wish for less is no overspeed before the machine can have followed."""
        if self.state.controls and last is not None:
            slower_mps = self._allowed_mps - self.settings.slowing_mps2 * (now.time_s - last.time_s)
            self._allowed_mps = max(self.setpoint_mps, now.reference_mps, slower_mps)

    def _lever_moved(self, now: Situation) -> bool:
        return abs(now.lever_pct - self._lever_pct) > self.settings.lever_moved_pct

    def _watch_operator(self, now: Situation) -> None:
        """Note when pedals or lever were last in use."""
        unknown = math.isnan(now.lever_pct) or not now.operator_present
        if now.brake or now.clutch or self._lever_moved(now) or unknown:
            self._act(now)

    def _act(self, now: Situation) -> None:
        self._acted_s = now.time_s
        if math.isfinite(now.lever_pct):
            self._lever_pct = now.lever_pct

    def _enter(self, row: Transition, now: Situation) -> None:
        if row.source.drives and not row.target.drives:
            self.exits += 1
            self.exit_reason, self.exit_condition = row.reason, row.condition
            self.exit_detail = self._detail(row.condition, now)
        if row.target is State.FAULT:
            self.ailed = now.ailment
        if row.target is State.OVERRIDDEN:
            self._act(now)
        if row.target.drives and not row.source.drives:
            self.exit_reason, self.exit_condition, self.exit_detail = ExitReason.NONE, "", ""
            self._lever_pct, self._gear = now.lever_pct, now.gear
        if row.target is State.ENGAGING:
            self.setpoint_mps = self._wanted_mps(now)
            self._allowed_mps = max(self.setpoint_mps, now.speed_mps)  # of this drive: nothing is left of the last
            self._commanded, self._by_panel = False, not now.set
        if row.target is State.COMMISSIONING:
            self.experiment = self.experiments[now.requested_experiment]
            self.setpoint_mps = math.nan  # none holds, and none is left over for later
        if row.target is State.OFF:
            self.setpoint_mps = math.nan  # nor after the main switch
        self.state = row.target

    def _follow(self, now: Situation, last: Situation) -> None:
        """The operator's newest word is the setpoint: a new request on the bus, or a press of a button."""
        settings, word_mps = self.settings, now.requested_mps
        self._commanded = self._commanded or math.isfinite(word_mps)
        if self._is_new(word_mps):
            self.setpoint_mps, self._requested_mps, self._by_panel = word_mps, word_mps, True
        presses = (now.accelerate and not last.accelerate) - (now.coast and not last.coast)
        if presses:
            wanted_mps = self.setpoint_mps + settings.setpoint_step_mps * presses
            self.setpoint_mps = min(max(wanted_mps, settings.speed_min_mps), settings.speed_max_mps)
            self._by_panel = False

    def _is_new(self, word_mps: float) -> bool:
        """Whether a setpoint on the bus is a new word: where a button had the last one, more than a knob's wavering."""
        apart_mps = 0.0 if self._by_panel else WAVERING_MPS
        return math.isfinite(word_mps) and not abs(word_mps - self._requested_mps) <= apart_mps


def _words(name: str) -> str:
    return name.replace("_", " ")
