"""Faults inside: the actuator, the machine, the program's turn and clock, its memory and its files."""

import math
from random import Random
from typing import Final

from . import insides
from .bed import Fault
from .row import COMMAND, MODEL, NONE, FaultRow


def _upset_model(rng: Random) -> Fault:
    return insides.Upset(gain=rng.choice((rng.uniform(0.2, 0.8), rng.uniform(1.3, 5.0), -1.0)))


def _upset_disturbance(rng: Random) -> Fault:
    return insides.Upset(disturbance_mps=rng.choice((math.nan, rng.uniform(-3.0, 3.0), rng.uniform(-50.0, 50.0))))


INSIDE: Final = (
    FaultRow("current hangs", "the pump keeps its current", COMMAND, lambda r: insides.Current(stuck=True)),
    FaultRow(
        "current off",
        "by 20 to 250 mA",
        COMMAND,
        lambda r: insides.Current(offset_ma=r.choice((-1, 1)) * r.uniform(20, 250)),
    ),
    FaultRow(
        "current scaled in the output stage",
        "0.5 to 1.5",
        COMMAND,
        lambda r: insides.Current(scale=r.uniform(0.5, 1.5)),
    ),
    FaultRow("current late", "by 0.1 to 0.8 s", COMMAND, lambda r: insides.Current(late_s=r.uniform(0.1, 0.8))),
    # In a fast gear a little more flow looks like the end of a hill: only the line's pressure, which the service does
    # not need, could tell them apart. The observer takes it back within some seconds.
    FaultRow(
        "pump worn",
        "0.5 to 1.3 of its displacement",
        f"{MODEL}; in fast gears {NONE}",
        lambda r: insides.Worn(r.uniform(0.5, 1.3)),
        bounded=True,
    ),
    FaultRow(
        "drum plugged",
        "it takes 150 to 350 kW, more than the engine has left",
        "engine load; a machine that stands",
        lambda r: insides.Plugged(r.uniform(150.0, 350.0)),
    ),
    FaultRow("brake acts unseen", "its switch says nothing", MODEL, lambda r: insides.Held(brake=r.uniform(0.1, 0.6))),
    FaultRow(
        "drive line opens unseen",
        "the clutch's switch says nothing",
        MODEL,
        lambda r: insides.Held(clutch=True),
        lasting=True,
    ),
    FaultRow(
        "process paused", "no turn at all", "time between two turns; time-out of the drive", lambda r: insides.Paused()
    ),
    FaultRow(
        "processor starved",
        "30 to 80 % of its turns",
        "time between two turns",
        lambda r: insides.Starved(r, r.uniform(0.3, 0.8)),
    ),
    FaultRow(
        "clock steps forward",
        "by 0.2 to 100 s",
        "time between two turns",
        lambda r: insides.Clock(r.uniform(0.2, 100.0)),
    ),
    FaultRow(
        "clock steps back", "by 0.2 to 100 s", "time between two turns", lambda r: insides.Clock(-r.uniform(0.2, 100.0))
    ),
    FaultRow(
        "frames stamped wrong", "by up to 5 s, either way", "their age", lambda r: insides.Stamps(r.uniform(-5.0, 5.0))
    ),
    FaultRow(
        "disk full",
        "neither what is kept nor the black box can be written",
        "the system's error; nothing that drives needs the disk",
        lambda r: insides.FullDisk(),
    ),
    FaultRow(
        "parameter file cut off",
        "1 to 99 % of it",
        "strict reading",
        lambda r: insides.ModelFile(cut=r.uniform(0.01, 0.99)),
        from_start=True,
    ),
    FaultRow(
        "parameters of another machine",
        "gain 0.4 to 2.5",
        MODEL,
        lambda r: insides.ModelFile(gain=r.uniform(0.4, 2.5)),
        from_start=True,
    ),
    FaultRow(
        "estimator sure of nonsense",
        "gain 0.35 to 2.9",
        "errors 3 s ahead",
        lambda r: insides.Nonsense(r.uniform(0.35, 2.9)),
    ),
    FaultRow("estimator not a number", "NaN", "errors 3 s ahead", lambda r: insides.Nonsense(math.nan)),
    FaultRow("driving model upset", "gain 0.2 to 5, or negative", "kept twice", _upset_model),
    FaultRow("disturbance upset", "by up to 50 m/s, or NaN", MODEL, _upset_disturbance),
    FaultRow(
        "limits upset", "their past is another", "kept twice", lambda r: insides.Upset(last_ma=r.uniform(1.0, 1200.0))
    ),
)
