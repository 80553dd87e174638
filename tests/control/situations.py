"""A situation in which the cruise control may engage, and engagements that did."""

from dataclasses import replace

from cruise.control.engagement import Engagement, State
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
    missing=(),
    model_ready=True,
    ailment="",
    contradiction="",
    contradiction_in_experiment="",
    brake=False,
    clutch=False,
    gear=2.0,
    alpha=1.0,
    lever_pct=40.0,
    speed_mps=1.1,
    fastest_mps=1.15,
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
