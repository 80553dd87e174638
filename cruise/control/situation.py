"""What is known at one instant, and what of it stands in the way of the controller or of an experiment."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final

import msgspec

from cruise.control.commissioning import CommissioningSettings, Experiment
from cruise.settings import Positive, refuse_wide

WAVERING_MPS: Final = 0.05  # m/s, less than which a knob between two of its steps changes what the panel asks for
WIDEST: Final = 3.0  # times its default that a setting may be


class EngagementSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Within what the machine may be driven."""

    speed_min_mps: Positive = 0.3  # m/s, slower is manoeuvring, a person's work
    speed_max_mps: Annotated[float, msgspec.Meta(gt=0, le=11.2)] = 8.5  # m/s, just over 30 km/h; no combine passes 40
    setpoint_step_mps: Positive = 0.1  # m/s, of the buttons accelerate and coast
    standing_mps: Positive = 0.1  # m/s: slower, a machine that is driven stands, be it plugged or its engine stalled,
    standing_s: Positive = 1.0  # s after which it does not start again by itself
    lever_moved_pct: Positive = 5.0  # %, change of the lever that means the operator wants it
    override_s: Positive = 1.0  # s that pedals and lever have to be left alone before an override is over
    reached_mps: Positive = 0.1  # m/s, speed to setpoint at which the take-over is done: 5 % of a usual speed
    # m/s above what was wished while the machine follows: a hill of 8 degrees within 2.5 s adds 0.1 in first gear, 0.2
    # in second, 0.45 in third and 0.7 in fourth, times sqrt(alpha) of equation 12 of the paper 0.1 to 0.26; 0.3 is
    # harm, and a sensor may show 0.02 less than there is
    overspeed_mps: Positive = 0.28
    slowing_mps2: Positive = 0.2  # m/s2, a deceleration that every machine can follow, dead time and hill included
    coming_mps2: Positive = 1.0  # m/s2 that is on its way to the wheels: more is beyond what the law may do or can undo
    shifts_under_way: bool = False  # a gearbox that changes gear under load; with others a changed gear is an exit

    def __post_init__(self) -> None:
        refuse_wide(self, WIDEST)
        if self.speed_min_mps >= self.speed_max_mps:
            raise ValueError(
                f"speed_min_mps is {self.speed_min_mps:g} and speed_max_mps {self.speed_max_mps:g}: it would never "
                "engage; let the lower be less"
            )

    def hill_mps(self, alpha: float) -> float:
        """What a hill may add to a speed that is wished, in a gear that slows the drive down by alpha of equation 12.

        The hill takes 1/alpha as much of the steady speed and comes as quickly; the law undoes sqrt(alpha) of that.
        """
        return self.overspeed_mps / math.sqrt(min(alpha, 1.0))


@dataclass(frozen=True, slots=True)
class Situation:
    """What a decision needs to know, at one instant. NaN and False where nothing is known."""

    time_s: float
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
    missing: tuple[str, ...]  # which of these are not
    model_ready: bool  # the observer has caught up with the machine
    ailment: str  # what is wrong with bus or program; empty where nothing is
    contradiction: str  # which signals can't all be true; empty where they can
    contradiction_in_experiment: str  # the same by the checks that hold while an experiment drives
    brake: bool
    clutch: bool
    gear: float
    alpha: float  # equation 12: 1 in the slow gears, less in those that a hill slows down more
    lever_pct: float
    speed_mps: float
    fastest_mps: float  # the greatest of the speeds that are fresh, of drive, wheel and radar, whatever their direction
    coming_mps2: float  # acceleration that the current has caused already and that has not come yet
    requested_mps: float  # setpoint on the bus
    reference_mps: float  # what the controller follows now
    requested_experiment: int  # number that the panel asks for, 0: none
    experiment_over: bool  # the running experiment has come to its end


def against_engaging(now: Situation, settings: EngagementSettings, wanted_mps: float) -> str:
    """The first thing that stands in the way of the controller, in words; empty where nothing does."""
    low, high = settings.speed_min_mps, settings.speed_max_mps
    return _first(
        {
            _missing(now): not now.signals_valid,
            "the panel's frames are missing": not now.operator_present,
            "the observer has not caught up yet": not now.model_ready,
            f"signals contradict each other: {now.contradiction}": bool(now.contradiction),
            "brake or clutch is pressed": now.brake or now.clutch,
            "no gear is engaged": not now.gear > 0,
            "the machine is too slow or too fast": not low <= now.speed_mps <= high,
            "the current was changed too quickly just now": now.coming_mps2 > settings.coming_mps2,
            "there is no setpoint to resume": math.isnan(wanted_mps),
            "the setpoint is out of range": not low <= wanted_mps <= high,
        }
    )


def against_commissioning(
    now: Situation, last: Situation, settings: CommissioningSettings | None, experiment: Experiment | None
) -> str:
    """The first thing that stands in the way of the experiment that is asked for; empty where nothing does."""
    if settings is None:
        return "the settings have no commissioning"
    if experiment is None:
        return "no experiment has this number"
    gear = experiment.conditions.gear
    return _first(
        {
            "an experiment begins with set, not with resume": not now.set,
            "the experiment has to be asked for before the button": last.requested_experiment
            != now.requested_experiment,
            _missing(now): not now.drive_signals_valid,
            "the panel's frames are missing": not now.operator_present,
            f"signals contradict each other: {now.contradiction_in_experiment}": bool(now.contradiction_in_experiment),
            "brake or clutch is pressed": now.brake or now.clutch,
            f"the experiment is for gear {gear}": now.gear != gear,
            "the lever is not at rest": not abs(now.lever_pct) <= settings.lever_rest_pct,
            "the machine is not near standstill": not abs(now.speed_mps) <= settings.start_speed_max_mps,
        }
    )


def _missing(now: Situation) -> str:
    return f"signals are missing: {', '.join(now.missing)}"


def _first(obstacles: Mapping[str, bool]) -> str:
    return next((reason for reason, there in obstacles.items() if there), "")
