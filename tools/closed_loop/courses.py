"""The courses as rows of data: what the operator asks for, what the field does, what is different on the machine."""

from pathlib import Path
from typing import Any, Literal

import msgspec

from cruise import settings
from cruise.plant import Inputs, PlantSettings
from cruise.service.course import FieldRow, value_at

COURSES = Path(__file__).with_name("courses.yaml")
Judged = Literal["steps", "hill", "rpm"]


class SetpointRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One change of the setpoint, in m/s."""

    at_s: float
    to: float


class Begin(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The approach by hand and the first setpoint."""

    gear: int = 2
    current_ma: float = 790.0
    setpoint_mps: float = 1.2


class Course(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One course; `plant` is laid over the machine's settings."""

    name: str
    seconds: float
    begin: Begin = Begin()
    setpoints: tuple[SetpointRow, ...] = ()
    field: tuple[FieldRow, ...] = ()
    plant: dict[str, Any] = {}
    judged: tuple[Judged, ...] = ()
    pooled: bool = True

    def setpoint_mps(self, time_s: float) -> float:
        """What the operator asks for."""
        return next((row.to for row in reversed(self.setpoints) if row.at_s <= time_s), self.begin.setpoint_mps)

    def inputs(self, current_ma: float, time_s: float) -> Inputs:
        """What acts on the machine; before the first row everything is as in it."""
        rows = self.field

        def value(name: str, start: float) -> float:
            return value_at(rows, name, start, max(time_s, 0.0))

        return Inputs(
            pump_current_ma=current_ma,
            engine_speed_setpoint_rpm=value("engine_speed_setpoint_rpm", 2100.0),
            gear=round(value("gear", self.begin.gear)),
            grade_deg=value("grade_deg", 0.0),
            rolling_resistance=value("rolling_resistance", 0.05),
            crop_power_kw=value("crop_power_kw", 0.0),
            grain_flow_kgps=value("grain_flow_kgps", 0.0) if time_s >= 0.0 else 0.0,
        )

    def machine(self, plant: PlantSettings) -> PlantSettings:
        """The machine that this course is driven with."""
        return laid_over(plant, self.plant)


class Courses(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file of all courses."""

    courses: tuple[Course, ...]


def load(path: Path = COURSES) -> tuple[Course, ...]:
    """All courses, in their order."""
    return settings.load(path, Courses).courses


def laid_over(whole: Any, changes: dict[str, Any]) -> Any:
    """`whole` with the nested fields that `changes` names."""
    new = {}
    for name, value in changes.items():
        old = getattr(whole, name)
        new[name] = laid_over(old, value) if isinstance(value, dict) else value
    return msgspec.structs.replace(whole, **new)
