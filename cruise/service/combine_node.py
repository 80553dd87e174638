"""The virtual combine on the bus: its sensors' readings out as frames, the pump current command in.

The drive's own electronics are here too, as any machine has them: a command counts only while it is marked active,
intact and younger than the time-out; otherwise the lever drives. When cruise lets go, the pump goes to neutral and
the lever counts again only once it has been moved; after a time-out an active command counts again only once an
inactive one has been seen. So nothing starts by itself.
"""

import math
from dataclasses import dataclass

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.plant import Combine, Inputs, SensorReading
from cruise.service.course import FieldRow, OperatorRow, value_at
from cruise.signals import SIGNALS

COMMAND_TIMEOUT_S = 0.2  # s, four periods of the command
LEVER_START_MA, LEVER_FULL_MA = 360.0, 1150.0  # mA, what the lever's electronics give at its first and last percent
LEVER_PLAY_PCT = 3.0  # %, rest position of the lever
LEVER_MOVED_PCT = 3.0  # %, change that takes the pump back from neutral


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message that the machine's controllers send: its period, and the signals in it, each from which sensor."""

    message: str
    period_s: float
    signals: tuple[tuple[str, str], ...]


MESSAGES = (
    Outgoing("EEC1", 0.02, (("engine_speed_rpm", "engine_speed_rpm"),)),
    Outgoing("EEC2", 0.05, (("engine_load_pct", "engine_load_pct"),)),
    Outgoing("ETC2", 0.1, (("gear", "gear"),)),
    Outgoing("WBSD", 0.1, (("wheel_speed_mps", "wheel_speed_mps"),)),
    Outgoing("GBSD", 0.1, (("ground_speed_mps", "ground_speed_mps"),)),
    Outgoing("SSI2", 0.01, (("pitch_deg", "pitch_deg"),)),
    Outgoing("VF", 1.0, (("oil_temperature_c", "oil_temperature_c"),)),
    Outgoing(
        "MachineState", 0.05, (("machine_mass_kg", "machine_mass_kg"), ("line_pressure_bar", "line_pressure_bar"))
    ),
)


class CombineNode:
    """The machine: `tick` every `period_s`, `receive` in between."""

    period_s = 0.01

    def __init__(
        self, combine: Combine, codec: Codec, field: tuple[FieldRow, ...], operator: tuple[OperatorRow, ...]
    ) -> None:
        self.combine = combine
        self.codec = codec
        self.field = field
        self.operator = operator
        self.shown: dict[tuple[str, str], float] = {}
        self.command_ma = math.nan
        self.command_s = -math.inf
        self.command_counts = True  # False from a time-out to the next inactive command
        self.lever_counts = True
        self.lever_pct = self._lever_at_exit = 0.0
        self.driven_by_cruise = False
        self.ticks = 0

    def receive(self, frame: Frame) -> None:
        """Take a command in; everything else on the bus is not for the machine."""
        decoded = self.codec.decode(frame)
        if decoded.message != "PumpCurrentCommand" or decoded.fault is not None:
            return
        values = {reading.name: reading.value for reading in decoded.readings}
        active = values.get("command_active", 0.0) == 1.0
        self.command_counts = self.command_counts or not active
        self.command_ma = values.get("pump_current_command_ma", math.nan) if active else math.nan
        self.command_s = frame.timestamp

    def tick(self, now_s: float) -> list[Frame]:
        """Drive on to `now_s` and send what is due."""
        inputs = self._inputs(now_s)
        frames = []
        for reading in self.combine.advance(inputs, now_s):
            assert isinstance(reading, SensorReading)
            signal = SIGNALS[reading.name]  # a sensor saturates at the ends of its range
            self.shown[reading.sensor, reading.name] = min(max(reading.value, signal.low), signal.high)
            if reading.sensor == "drive_feedback" and reading.name == "pump_current_ma":
                frames.append(self._feedback(reading.time_s))
        self.ticks += 1
        for outgoing in MESSAGES:
            if self.ticks % round(outgoing.period_s / self.period_s) == 0:
                values = {signal: self.shown.get((sensor, signal), math.nan) for sensor, signal in outgoing.signals}
                if outgoing.message == "MachineState":
                    values["lever_pct"] = self.lever_pct
                frames.append(self.codec.encode(outgoing.message, values, now_s))
        return frames

    def _feedback(self, time_s: float) -> Frame:
        values = {
            name: self.shown.get(("drive_feedback", name), math.nan) for name in ("ground_speed_mps", "pump_current_ma")
        }
        return self.codec.encode("DriveFeedback", values, time_s)

    def _inputs(self, now_s: float) -> Inputs:
        field, operator = self.field, self.operator
        lever_pct = value_at(operator, "lever_pct", 0.0, now_s)
        fresh = now_s - self.command_s <= COMMAND_TIMEOUT_S
        if self.driven_by_cruise and not fresh:
            self.command_counts = False
        by_cruise = fresh and self.command_counts and math.isfinite(self.command_ma)
        if self.driven_by_cruise and not by_cruise:
            self.lever_counts, self._lever_at_exit = False, lever_pct
        if not self.lever_counts and abs(lever_pct - self._lever_at_exit) > LEVER_MOVED_PCT:
            self.lever_counts = True
        self.driven_by_cruise, self.lever_pct = by_cruise, lever_pct
        current_ma = self.command_ma if by_cruise else self._lever_current_ma(lever_pct)
        return Inputs(
            pump_current_ma=current_ma,
            engine_speed_setpoint_rpm=value_at(field, "engine_speed_setpoint_rpm", 2100.0, now_s),
            gear=round(value_at(field, "gear", 2, now_s)),
            grade_deg=value_at(field, "grade_deg", 0.0, now_s),
            rolling_resistance=value_at(field, "rolling_resistance", 0.05, now_s),
            crop_power_kw=value_at(field, "crop_power_kw", 0.0, now_s),
            grain_flow_kgps=value_at(field, "grain_flow_kgps", 0.0, now_s),
            brake=value_at(operator, "brake_pedal", 0.0, now_s),
            clutch=value_at(operator, "clutch_pedal", 0.0, now_s) > 0.5,
        )

    def _lever_current_ma(self, lever_pct: float) -> float:
        if not self.lever_counts or abs(lever_pct) < LEVER_PLAY_PCT:
            return 0.0
        current_ma = LEVER_START_MA + (LEVER_FULL_MA - LEVER_START_MA) * abs(lever_pct) / 100.0
        return math.copysign(current_ma, lever_pct)
