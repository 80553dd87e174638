"""Drives without any fault: no exit may come by itself, and no press may be refused."""

import math
from dataclasses import dataclass
from typing import Final

from tools.benchmarks.figures import Figure

from .bed import Bed
from .manoeuvres import manoeuvre

DRIVE_S: Final = 300.0  # s of one drive
HOURS: Final = 20.0


@dataclass(frozen=True)
class Clean:
    """One drive without fault; `how` says why it ended, empty where it did not."""

    seed: int
    hours: float
    how: str
    overspeed_mps: float
    accel_mps2: float


def drive(seed: int, seconds: float = DRIVE_S) -> Clean:
    """Five minutes of manoeuvres."""
    bed = Bed(manoeuvre(seed, seconds)).run(seconds, after_s=0.0)
    rows = [row for row in bed.rows if math.isfinite(row.allowed_mps)]
    how = bed.exit.how if bed.exit is not None else bed.died or ("" if rows else bed.node.engagement.refused or "idle")
    return Clean(
        seed,
        bed.rows[-1].time_s / 3600.0,
        how,
        max((row.speed_mps - row.allowed_mps for row in rows), default=math.nan),
        max((abs(row.accel_mps2) for row in rows), default=math.nan),
    )


def figures(drives: list[Clean], target_hours: float = HOURS) -> list[Figure]:
    """What is claimed of them."""
    return [
        Figure(
            "clean_hours",
            round(sum(one.hours for one in drives), 6),
            "h",
            "driven without faults",
            at_least=target_hours,
        ),
        Figure("false_exits", sum(bool(one.how) for one in drives), "1", "exits or refusals without a fault", 0.0),
        Figure("clean_overspeed_mps", max(one.overspeed_mps for one in drives), "m/s", "overspeed without faults"),
        Figure("clean_accel_mps2", max(one.accel_mps2 for one in drives), "m/s2", "acceleration without faults"),
    ]
