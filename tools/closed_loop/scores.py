"""The figures of drives, each from the definition that stands beside it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cruise.service.figures import above_1hz_rms

from .courses import Course
from .drive import FRAME_S, Driven

AWAY_S = 8.0  # s after a change of the setpoint that don't count as keeping the speed
CLOSE_MPS = 0.03
LEAST_OVERSHOOT_MPS, OVERSHOOT_SHARE = 0.02, 0.05
ACCEL_MPS2, JERK_MPS3 = 1.0, 2.0
LATER_S = 5.0


@dataclass(frozen=True)
class Step:
    """One change of the setpoint: overshoot in m/s over what is allowed, and how much later than the reference."""

    overshoot: float
    late_s: float


def to_reference(course: Driven) -> np.ndarray:
    """True speed less the delayed reference, the engagement left out."""
    return (course.speed_mps - course.reference_mps)[course.settled]


def to_setpoint(course: Driven) -> np.ndarray:
    """True speed less the raw setpoint, where the setpoint has stood for 8 s."""
    return (course.speed_mps - course.setpoint_mps)[course.settled & (course.since_change_s > AWAY_S)]


def steps(one: Driven) -> list[Step]:
    """Every change of the setpoint: the largest way beyond it over the allowed one, the delay after the reference."""
    changes = np.flatnonzero(np.diff(one.setpoint_mps, prepend=one.setpoint_mps[0]) != 0.0)
    ends = [*changes[1:], len(one.time_s)]
    found = []
    for start, end in zip(changes, ends, strict=True):
        size = float(one.setpoint_mps[start] - one.setpoint_mps[start - 1])
        beyond = math.copysign(1.0, size) * (one.speed_mps[start:end] - one.setpoint_mps[start])
        allowed = max(OVERSHOOT_SHARE * abs(size), LEAST_OVERSHOOT_MPS)
        found.append(Step(float(beyond.max()) / allowed, _late_s(one, int(start), int(end))))
    return found


def _late_s(one: Driven, start: int, end: int) -> float:
    """Time from the reference's last arrival within 3 cm/s of the setpoint to the speed's."""

    def arrival(speeds: np.ndarray) -> int:
        away = np.flatnonzero(np.abs(speeds[start:end] - one.setpoint_mps[start]) > CLOSE_MPS)
        return int(away[-1]) + 1 if len(away) else 0

    return (arrival(one.speed_mps) - arrival(one.reference_mps)) * FRAME_S


def field_cost(course: Course, one: Driven, later_s: float = 0.0) -> list[float]:
    """Largest way from the reference in m/s after each change of the field, from `later_s` after its end on."""
    rows = [row for row in course.field if row.at_s > 0.0]
    found = []
    for row, end in zip(rows, [*(row.at_s for row in rows[1:]), course.seconds], strict=True):
        begin = row.at_s + (row.over_s + later_s if later_s else 0.0)
        part = (one.time_s > begin) & (one.time_s <= end)
        found.append(float(np.abs((one.speed_mps - one.reference_mps)[part]).max()))
    return found


def held_cost(course: Course, held: Driven) -> list[float]:
    """What the same changes of the field cost at a fixed current, in m/s from the speed before each."""
    starts = [row.at_s for row in course.field if row.at_s > 0.0]
    found = []
    for start, end in zip(starts, [*starts[1:], course.seconds], strict=True):
        part = held.speed_mps[(held.time_s > start) & (held.time_s <= end)]
        found.append(float(np.abs(part - part[0]).max()))
    return found


def command_above_1hz_ma(one: Driven) -> float:
    """RMS of the command's content above 1 Hz, mean removed in windows of 20 s (mA)."""
    return above_1hz_rms(one.current_ma, FRAME_S)


def motion(one: Driven) -> tuple[np.ndarray, np.ndarray]:
    """True acceleration and jerk, from means over a frame."""
    accel = np.diff(one.speed_mps) / FRAME_S
    return accel, np.diff(accel) / FRAME_S


def within(values: Sequence[np.ndarray], limit: float) -> float:
    """Share of samples within a limit."""
    joined = np.concatenate(values) if values else np.full(1, np.nan)
    return float(np.mean(np.abs(joined) <= limit))
