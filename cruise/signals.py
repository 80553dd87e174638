"""The vocabulary: every measured signal once, with its unit in its name.

The same names are the columns of a recording, the signals of the CAN database and the names in Python. A value that
was not measured is NaN, everywhere.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec

Signals = Mapping[str, Any]
"""Signal name to value: a float online, an array over time offline."""


@dataclass(frozen=True, slots=True)
class Signal:
    """One measured or commanded quantity and the range in which a value of it can be believed.

    `low` and `high` bound what the quantity can physically be on a combine harvester; outside of them a value is
    treated as not measured.
    """

    name: str
    unit: str
    low: float
    high: float
    meaning: str


class Reading(msgspec.Struct, frozen=True, gc=False):
    """One value of one signal, valid at one instant: what a sensor emits and what a CAN frame decodes to."""

    name: str
    time_s: float
    value: float


@dataclass(frozen=True, slots=True)
class Sample:
    """The machine over one model period that ends at `time_s`: means over that period, aligned in time.

    `current_ma` and `speed_mps` are NaN where the period holds no fresh measurement of them. `engaged`: the controller
    owned the current and followed `reference_mps`, NaN where that is not the operator's alone; `overridden`: a brake
    or clutch acted beside the drive.
    """

    time_s: float
    current_ma: float
    speed_mps: float
    signals: Mapping[str, float] = field(default_factory=dict)
    reference_mps: float = math.nan
    engaged: bool = False
    overridden: bool = False


_ALL = (
    Signal("pump_current_ma", "mA", -1500.0, 1500.0, "current through the pump's proportional solenoid (+ forward)"),
    Signal("pump_current_command_ma", "mA", -1500.0, 1500.0, "current that the controller asks for (+ forward)"),
    Signal("ground_speed_mps", "m/s", -12.0, 12.0, "speed over ground (+ forward)"),
    Signal("wheel_speed_mps", "m/s", -12.0, 12.0, "speed at the circumference of the driven wheels (+ forward)"),
    Signal("engine_speed_rpm", "rpm", 0.0, 3000.0, "speed of the diesel engine's crankshaft"),
    Signal("gear", "-", -4.0, 8.0, "engaged gear of the mechanical transmission, 0 is neutral"),
    Signal("pitch_deg", "deg", -45.0, 45.0, "pitch of the machine (+ uphill); acceleration shows in it as slope"),
    Signal("machine_mass_kg", "kg", 5000.0, 40000.0, "mass of the machine with what is in the bin"),
    Signal("oil_temperature_c", "degC", -40.0, 150.0, "temperature of the hydraulic oil"),
    Signal("engine_load_pct", "%", 0.0, 125.0, "engine torque in percent of the torque available at this speed"),
    Signal("line_pressure_bar", "bar", -600.0, 600.0, "pressure difference of the lines, + driving forward"),
    Signal("setpoint_mps", "m/s", -64.255, 64.255, "speed that the operator asks for, however great"),
    Signal("lever_pct", "%", -100.0, 100.0, "deflection of the hydrostatic lever from its rest position"),
    Signal("brake_pedal", "0/1", 0.0, 1.0, "service brake pressed"),
    Signal("clutch_pedal", "0/1", 0.0, 1.0, "drive line opened by the operator"),
    Signal("cruise_enable", "0/1", 0.0, 1.0, "operator's main switch of the cruise control"),
    Signal("cruise_set", "0/1", 0.0, 1.0, "button: engage at the present speed"),
    Signal("cruise_resume", "0/1", 0.0, 1.0, "button: engage at the setpoint asked for; without one, at the last"),
    Signal("cruise_accelerate", "0/1", 0.0, 1.0, "button: raise the setpoint"),
    Signal("cruise_coast", "0/1", 0.0, 1.0, "button: lower the setpoint"),
    Signal("requested_experiment", "-", 0.0, 250.0, "commissioning experiment that the operator asks for, 0 is none"),
)

SIGNALS: Final[dict[str, Signal]] = {signal.name: signal for signal in _ALL}
"""Every signal that the project knows, by name."""

INPUT: Final = "pump_current_ma"
OUTPUT: Final = "ground_speed_mps"
CONTEXT: Final = (
    "wheel_speed_mps",
    "engine_speed_rpm",
    "gear",
    "pitch_deg",
    "machine_mass_kg",
    "oil_temperature_c",
    "engine_load_pct",
    "line_pressure_bar",
)
"""The recorded signals beside input and output that an effect may need."""
ASKED: Final = frozenset(
    {
        "pump_current_command_ma",
        "setpoint_mps",
        "lever_pct",
        "cruise_enable",
        "cruise_set",
        "cruise_resume",
        "cruise_accelerate",
        "cruise_coast",
        "requested_experiment",
    }
)
"""What somebody asks for. It moves the machine through the current alone, and so is no cause beside it."""
PEDALS: Final = ("brake_pedal", "clutch_pedal")
"""Pressed, they act on the machine beside the drive: what it does then says nothing of the drive."""
