"""Faults of what is measured: stuck, frozen, noisy, biased, scaled and drifting sensors, lies, and no value at all."""

import math
from random import Random
from typing import Final

from . import lies
from .bed import Fault
from .lies import ALL_SPEEDS, CURRENT, ENGINE, GEAR, LEVER, OTHER_SPEEDS, PEDALS, PITCH, SETPOINT, SPEED
from .row import COMMAND, MODEL, NONE, THREE, TIME_OUT, FaultRow


def _gear(rng: Random) -> Fault:
    return lies.constant(GEAR, float(rng.choice((1, 2, 3, 4))))


def _absent(name: str, where: lies.Where, what: str) -> FaultRow:
    return FaultRow(name, f"{what} is said to be not available", TIME_OUT, lambda r: lies.constant(where, math.nan))


SENSORS: Final = (
    FaultRow("speed stuck", "the drive's speed stands still", f"{THREE}; no noise", lambda r: lies.Frozen(SPEED)),
    FaultRow("speed zero", "the drive's speed falls to nothing", THREE, lambda r: lies.constant(SPEED, 0.0)),
    FaultRow("speed biased", "by 0.05 to 0.8 m/s", THREE, lambda r: lies.biased(SPEED, r, 0.05, 0.8)),
    FaultRow("speed scaled", "times or over 1.03 to 2", THREE, lambda r: lies.scaled(SPEED, r, 1.03, 2.0)),
    FaultRow("speed drifting", "by 0.02 to 0.2 m/s2", THREE, lambda r: lies.drifting(SPEED, r, 0.02, 0.2)),
    FaultRow("speed noisy", "0.05 to 0.6 m/s", "its own noise", lambda r: lies.noisy(SPEED, r, 0.05, 0.6)),
    FaultRow(
        "speed with spikes", "one in 20 by 0.5 to 5 m/s", "its own noise", lambda r: lies.spiked(SPEED, r, 0.5, 5.0)
    ),
    FaultRow(
        "every speed biased",
        "all three by the same",
        f"{MODEL}, or {NONE}",
        lambda r: lies.biased(ALL_SPEEDS, r, 0.05, 0.5),
        bounded=True,
    ),
    FaultRow(
        "every speed scaled",
        "all three alike, up to 1.3",
        f"{MODEL}, or {NONE}",
        lambda r: lies.scaled(ALL_SPEEDS, r, 1.02, 1.3),
        bounded=True,
    ),
    FaultRow(
        "every speed drifting",
        "all three alike",
        f"{MODEL}, or {NONE}",
        lambda r: lies.drifting(ALL_SPEEDS, r, 0.01, 0.1),
        bounded=True,
    ),
    FaultRow(
        "wheel and ground speed wrong",
        "times or over 1.1 to 2",
        "two of three",
        lambda r: lies.scaled(OTHER_SPEEDS, r, 1.1, 2.0),
    ),
    FaultRow("current stuck", "the measured one stands still", f"{COMMAND}; no noise", lambda r: lies.Frozen(CURRENT)),
    FaultRow("current biased", "by 10 to 250 mA", COMMAND, lambda r: lies.biased(CURRENT, r, 10.0, 250.0)),
    FaultRow("current scaled", "times or over 1.02 to 2", COMMAND, lambda r: lies.scaled(CURRENT, r, 1.02, 2.0)),
    FaultRow("current noisy", "5 to 150 mA", f"its own noise; {COMMAND}", lambda r: lies.noisy(CURRENT, r, 5.0, 150.0)),
    FaultRow("engine speed stuck", "while the throttle may move", f"no noise; {MODEL}", lambda r: lies.Frozen(ENGINE)),
    FaultRow(
        "engine speed lies", "times or over 1.03 to 2", f"inertia; {MODEL}", lambda r: lies.scaled(ENGINE, r, 1.03, 2.0)
    ),
    # Nothing else measures it, and a slow drift is taken for a machine that becomes faster or slower.
    FaultRow(
        "engine speed drifting",
        "by 10 to 200 rpm/s",
        f"{MODEL}, or {NONE}",
        lambda r: lies.drifting(ENGINE, r, 10.0, 200.0),
        bounded=True,
    ),
    FaultRow("engine speed noisy", "5 to 200 rpm", "its own noise", lambda r: lies.noisy(ENGINE, r, 5.0, 200.0)),
    FaultRow("gear lies", "any gear, at any time", f"no shift without clutch; {MODEL}", _gear),
    FaultRow(
        "slope lies", "by 1 to 15 degrees", "not needed by this model", lambda r: lies.biased(PITCH, r, 1.0, 15.0)
    ),
    FaultRow("lever noisy", "2 to 20 %", "an exit is safe", lambda r: lies.noisy(LEVER, r, 2.0, 20.0)),
    _absent("speed not available", SPEED, "the drive's speed"),
    _absent("current not available", CURRENT, "the measured current"),
    _absent("engine speed not available", ENGINE, "engine speed"),
    _absent("gear not available", GEAR, "the gear"),
    _absent("pedals not available", PEDALS, "brake and clutch"),
    _absent("setpoint not available", SETPOINT, "the setpoint"),
)
