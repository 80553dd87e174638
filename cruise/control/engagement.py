"""Who drives: off, standby, engaged, commissioning or fault, as one table of transitions.

Rows are tried from the top and the first that holds is taken, so the order is the priority. The machine engages on a
rising edge of a button only, never because a condition went away. Exit reasons are those of ISO 11783-7, SPN 5818.

Commissioning takes two deliberate acts: the panel asks for an experiment by its number, and keeps asking, and then the
operator presses `set`, near standstill with the lever at rest. Letting go of either the request or the machine's
controls ends it. While an experiment is asked for, the buttons do not engage the cruise control.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final

import msgspec

from cruise.control.commissioning import CommissioningSettings, Experiment
from cruise.settings import Positive


class State(StrEnum):
    """Who owns the current."""

    OFF = "off"  # main switch off
    STANDBY = "standby"  # ready, a person drives
    ENGAGED = "engaged"  # the controller drives
    FAULT = "fault"  # a person drives; only switching off and on leads out
    COMMISSIONING = "commissioning"  # an experiment drives, for identification


class ExitReason(IntEnum):
    """ISO 11783-7, SPN 5818: why a function was left. Only those that we use."""

    NONE = 0  # all clear
    OPERATOR_LOST = 1  # required level of operator presence not detected
    RELEASED = 2  # control of the function released
    OVERRIDE = 3  # operator override of the function
    CONTROL_POSITION = 4  # operator control not in a valid position
    COMMAND_INVALID = 6  # remote command out of range or invalid
    FUNCTION_FAULT = 9  # fault of the function


class EngagementSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Within what the machine may be driven."""

    speed_min_mps: Positive = 0.3  # m/s, slower is manoeuvring, a person's work
    speed_max_mps: Positive = 8.5  # m/s, just over 30 km/h, the road limit of most machines
    setpoint_step_mps: Positive = 0.1  # m/s, of the buttons accelerate and coast
    lever_moved_pct: Positive = 5.0  # %, change of the lever that means the operator wants it
    overspeed_mps: Positive = 0.6  # m/s above setpoint and reference: something else drives


@dataclass(frozen=True, slots=True)
class Situation:
    """What a decision needs to know, at one instant. NaN and False where nothing is known."""

    enable: bool  # main switch
    set: bool  # buttons as they stand
    resume: bool
    accelerate: bool
    coast: bool
    operator_present: bool  # the panel's frames are fresh
    signals_valid: bool  # everything that estimator and controller need is fresh and measured
    drive_signals_valid: (
        bool  # current, speed, gear, lever and pedals are fresh and measured: an experiment needs these
    )
    model_ready: bool  # the observer has caught up with the machine
    healthy: bool  # bus and program
    brake: bool
    clutch: bool
    gear: float
    lever_pct: float
    speed_mps: float
    requested_mps: float  # setpoint on the bus
    reference_mps: float  # what the controller follows now
    requested_experiment: int  # number that the panel asks for, 0: none
    experiment_over: bool  # the running experiment has come to its end


@dataclass(frozen=True, slots=True)
class Transition:
    """One row: from `source`, if the condition holds, to `target`."""

    source: State
    condition: str
    target: State
    reason: ExitReason


_ANY_EXIT: Final = (
    ("unhealthy", State.FAULT, ExitReason.FUNCTION_FAULT),
    ("operator_lost", State.STANDBY, ExitReason.OPERATOR_LOST),
    ("switched_off", State.OFF, ExitReason.RELEASED),
    ("brake", State.STANDBY, ExitReason.OVERRIDE),
    ("clutch", State.STANDBY, ExitReason.OVERRIDE),
    ("lever_moved", State.STANDBY, ExitReason.OVERRIDE),
    ("neutral", State.STANDBY, ExitReason.CONTROL_POSITION),
    ("signals_lost", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("setpoint_invalid", State.STANDBY, ExitReason.COMMAND_INVALID),
    ("overspeed", State.FAULT, ExitReason.FUNCTION_FAULT),
)

_ANY_END: Final = (
    ("unhealthy", State.FAULT, ExitReason.FUNCTION_FAULT),
    ("operator_lost", State.STANDBY, ExitReason.OPERATOR_LOST),
    ("switched_off", State.OFF, ExitReason.RELEASED),
    ("brake", State.STANDBY, ExitReason.OVERRIDE),
    ("clutch", State.STANDBY, ExitReason.OVERRIDE),
    ("lever_moved", State.STANDBY, ExitReason.OVERRIDE),
    ("neutral", State.STANDBY, ExitReason.CONTROL_POSITION),
    ("drive_signals_lost", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("gear_changed", State.STANDBY, ExitReason.CONTROL_POSITION),
    ("request_withdrawn", State.STANDBY, ExitReason.RELEASED),
    ("too_fast", State.STANDBY, ExitReason.FUNCTION_FAULT),
    ("finished", State.STANDBY, ExitReason.RELEASED),
)

TRANSITIONS: Final[tuple[Transition, ...]] = (
    *(Transition(State.ENGAGED, condition, target, reason) for condition, target, reason in _ANY_EXIT),
    *(Transition(State.COMMISSIONING, condition, target, reason) for condition, target, reason in _ANY_END),
    Transition(State.OFF, "switched_on", State.STANDBY, ExitReason.NONE),
    Transition(State.STANDBY, "unhealthy", State.FAULT, ExitReason.FUNCTION_FAULT),
    Transition(State.STANDBY, "switched_off", State.OFF, ExitReason.NONE),
    Transition(State.STANDBY, "commission", State.COMMISSIONING, ExitReason.NONE),
    Transition(State.STANDBY, "engage", State.ENGAGED, ExitReason.NONE),
    Transition(State.FAULT, "switched_off", State.OFF, ExitReason.NONE),
)


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
        self.refused = ""  # why the last press of a button neither engaged nor began an experiment
        self._last: Situation | None = None
        self._requested_mps = math.nan  # last setpoint on the bus; a pause of its frames is no new word
        self._lever_pct = math.nan  # where the lever stood when the controller or the experiment took over

    def step(self, now: Situation) -> State:
        """One instant on."""
        last, self._last = self._last, now
        holds = self._conditions(now, last)
        for row in TRANSITIONS:
            if row.source is self.state and holds[row.condition]:
                self._enter(row, now)
                break
        if self.state is State.ENGAGED and last is not None:
            self._follow(now, last)
        if math.isfinite(now.requested_mps):
            self._requested_mps = now.requested_mps
        return self.state

    def _conditions(self, now: Situation, last: Situation | None) -> dict[str, bool]:
        settings, experiment = self.settings, self.experiment
        edge = last is not None and ((now.set and not last.set) or (now.resume and not last.resume))
        pressed = edge and self.state is State.STANDBY
        asked = now.requested_experiment != 0
        target_mps = self.setpoint_mps
        return {
            "unhealthy": not now.healthy,
            "operator_lost": not now.operator_present,
            "switched_on": now.operator_present and now.enable,
            "switched_off": now.operator_present and not now.enable,
            "brake": now.brake,
            "clutch": now.clutch,
            "lever_moved": abs(now.lever_pct - self._lever_pct) > settings.lever_moved_pct,
            "neutral": now.gear <= 0,
            "signals_lost": not now.signals_valid,
            "setpoint_invalid": not settings.speed_min_mps <= target_mps <= settings.speed_max_mps,
            "overspeed": now.speed_mps - max(target_mps, now.reference_mps) > settings.overspeed_mps,
            "drive_signals_lost": not now.drive_signals_valid,
            "gear_changed": experiment is not None and now.gear != experiment.conditions.gear,
            "request_withdrawn": experiment is not None and now.requested_experiment != experiment.number,
            "too_fast": experiment is not None and abs(now.speed_mps) > experiment.speed_max_mps,
            "finished": now.experiment_over,
            "commission": pressed and asked and self._may_commission(now, last),
            "engage": pressed and not asked and self._may_engage(now),
        }

    def _may_engage(self, now: Situation) -> bool:
        settings = self.settings
        wanted = now.speed_mps if now.set else now.requested_mps
        obstacles = {
            "signals are missing": not now.signals_valid,
            "the panel's frames are missing": not now.operator_present,
            "the observer has not caught up yet": not now.model_ready,
            "brake or clutch is pressed": now.brake or now.clutch,
            "no gear is engaged": not now.gear > 0,
            "the machine is too slow or too fast": not settings.speed_min_mps
            <= now.speed_mps
            <= settings.speed_max_mps,
            "the setpoint is out of range": not settings.speed_min_mps <= wanted <= settings.speed_max_mps,
        }
        return self._unless(obstacles)

    def _may_commission(self, now: Situation, last: Situation | None) -> bool:
        settings, experiment = self.commissioning, self.experiments.get(now.requested_experiment)
        if settings is None or experiment is None:
            what = "the settings have no commissioning" if settings is None else "no experiment has this number"
            return self._unless({what: True})
        gear = experiment.conditions.gear
        obstacles = {
            "an experiment begins with set, not with resume": not now.set,
            "the experiment has to be asked for before the button": last is None
            or last.requested_experiment != now.requested_experiment,
            "signals are missing": not now.drive_signals_valid,
            "the panel's frames are missing": not now.operator_present,
            "brake or clutch is pressed": now.brake or now.clutch,
            f"the experiment is for gear {gear}": now.gear != gear,
            "the lever is not at rest": not abs(now.lever_pct) <= settings.lever_rest_pct,
            "the machine is not near standstill": not abs(now.speed_mps) <= settings.start_speed_max_mps,
        }
        return self._unless(obstacles)

    def _unless(self, obstacles: Mapping[str, bool]) -> bool:
        """Whether none of the obstacles is there; the first one that is says why the button was refused."""
        self.refused = next((reason for reason, there in obstacles.items() if there), "")
        return not self.refused

    def _enter(self, row: Transition, now: Situation) -> None:
        if row.source in (State.ENGAGED, State.COMMISSIONING):
            self.exit_reason, self.exit_condition = row.reason, row.condition
        if row.target is State.ENGAGED:
            self.setpoint_mps = now.speed_mps if now.set else now.requested_mps
            self.exit_reason, self.exit_condition = ExitReason.NONE, ""
            self._lever_pct = now.lever_pct
        if row.target is State.COMMISSIONING:
            self.experiment = self.experiments[now.requested_experiment]
            self.setpoint_mps = math.nan  # none holds, and none is left over for later
            self.exit_reason, self.exit_condition = ExitReason.NONE, ""
            self._lever_pct = now.lever_pct
        self.state = row.target

    def _follow(self, now: Situation, last: Situation) -> None:
        """The operator's newest word is the setpoint: a new request on the bus, or a press of a button."""
        settings = self.settings
        wanted = self.setpoint_mps
        if math.isfinite(now.requested_mps) and now.requested_mps != self._requested_mps:
            wanted = now.requested_mps
        wanted += settings.setpoint_step_mps * (now.accelerate and not last.accelerate)
        wanted -= settings.setpoint_step_mps * (now.coast and not last.coast)
        if settings.speed_min_mps <= wanted <= settings.speed_max_mps:
            self.setpoint_mps = wanted
