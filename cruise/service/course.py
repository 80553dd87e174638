"""A drive as rows of data: what the field does to the machine, and what the operator does in the cab.

Every row holds from `at_s` on; a number moves there linearly over `over_s`. What a row doesn't name stays as it was.
"""

from itertools import pairwise
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from cruise import settings


class FieldRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One change of the field, the engine or the transmission."""

    at_s: float
    over_s: float = 0.0
    engine_speed_setpoint_rpm: float | None = None
    gear: int | None = None
    grade_deg: float | None = None
    rolling_resistance: float | None = None
    crop_power_kw: float | None = None
    grain_flow_kgps: float | None = None


class OperatorRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One action of the operator. A pressed button is held for `press_s`."""

    at_s: float
    over_s: float = 0.0
    lever_pct: float | None = None
    brake_pedal: float | None = None
    clutch_pedal: float | None = None
    cruise_enable: float | None = None
    setpoint_mps: float | None = None
    requested_experiment: int | None = None
    press: Literal["", "set", "resume", "accelerate", "coast"] = ""
    press_s: float = 0.5


class Drive(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A whole drive."""

    seconds: float
    field: tuple[FieldRow, ...] = ()
    operator: tuple[OperatorRow, ...] = ()

    def __post_init__(self) -> None:
        for rows in (self.field, self.operator):
            for before, row in pairwise(rows):
                if row.at_s < before.at_s:
                    raise ValueError(f"rows have to be in the order of at_s: {row.at_s} s stands after {before.at_s} s")


def load(path: str | Path) -> Drive:
    """Read a drive from YAML."""
    return settings.load(path, Drive)


def value_at(rows: tuple[FieldRow, ...] | tuple[OperatorRow, ...], name: str, start: float, time_s: float) -> float:
    """The value of one column at one time, `start` before the first row that names it."""
    value = start
    for row in rows:
        target = getattr(row, name)
        if target is None or time_s < row.at_s:
            continue
        passed_s = time_s - row.at_s
        value = target if passed_s >= row.over_s else value + passed_s / row.over_s * (target - value)
    return value


def pressed(rows: tuple[OperatorRow, ...], button: str, time_s: float) -> bool:
    """Whether a button is held down at one time."""
    return any(row.press == button and row.at_s <= time_s < row.at_s + row.press_s for row in rows)


def vary(drive: Drive, seed: int) -> Drive:
    """The same drive as another day would bring it: seed 0 as written, others with shifted times and other sizes.

    Times move by up to 1.5 s, less where rows would come out of their order; setpoints and slopes by up to 10 %.
    """
    if seed == 0:
        return drive
    rng = np.random.default_rng(seed)

    def size(value: float | None) -> float | None:
        factor = 1.0 + 0.1 * float(rng.uniform(-1.0, 1.0))
        return None if value is None else round(value * factor, 3)

    def later(rows: tuple[FieldRow, ...] | tuple[OperatorRow, ...], i: int) -> float:
        at_s = rows[i].at_s
        if at_s <= 0.0:
            return at_s
        # Less than half the way to either neighbour: what is released must have been pressed before.
        gaps_s = [abs(other.at_s - at_s) for other in (*rows[max(i - 1, 0) : i], *rows[i + 1 : i + 2])]
        reach_s = min(1.5, *(0.4 * gap_s for gap_s in gaps_s), at_s)
        return round(at_s + reach_s * float(rng.uniform(-1.0, 1.0)), 2)

    field = tuple(
        msgspec.structs.replace(row, at_s=later(drive.field, i), grade_deg=size(row.grade_deg))
        for i, row in enumerate(drive.field)
    )
    operator = tuple(
        msgspec.structs.replace(row, at_s=later(drive.operator, i), setpoint_mps=size(row.setpoint_mps))
        for i, row in enumerate(drive.operator)
    )
    return msgspec.structs.replace(drive, field=field, operator=operator)
