"""Combine, panel and cruise control in lockstep on one wire, with a place for every kind of fault.

The nodes are the service's own, and so are the frames. The wire is faster than a bus of a library, and can be tampered
with: an end hears a frame at the step in which it arrives, with that time as its timestamp, as on a real bus.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from cruise import settings as strict
from cruise.can import database
from cruise.can.codec import Codec
from cruise.can.database import Layout
from cruise.can.frame import Frame
from cruise.control.engagement import State
from cruise.control.reference import Reference, ReferenceSettings
from cruise.model import files
from cruise.model.model import Model
from cruise.plant import Combine, Inputs, PlantSettings
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.cruise_node import CruiseNode
from cruise.service.operator_node import OperatorNode
from cruise.service.settings import CruiseSettings
from cruise.signals import Reading

from .manoeuvres import Manoeuvre

CONFIG: Final = Path(__file__).resolve().parents[2] / "config"
STEP_S: Final = 0.01
LATE_ROWS: Final = 16  # frames, 0.8 s: by so much a machine is behind a reference that falls, with dead time and lags
Spoken = TypeVar("Spoken", bound=Codec)
MACHINE, PANEL, CRUISE = "machine", "panel", "cruise"  # the ends of the wire
INTRUDER: Final = "intruder"  # who has none of them, and is heard by all


class Fault:
    """Something that goes wrong; each method is called while the fault is there, and changes nothing by itself."""

    def begin(self, bed: "Bed") -> None:
        """The fault comes."""

    clock_off_s = 0.0  # what the service's clock shows more than it should

    def said(self, message: str, values: dict[str, float], now_s: float) -> dict[str, float]:
        """What machine and panel say in a message, before it is protected."""
        return values

    def inputs(self, inputs: Inputs, now_s: float) -> Inputs:
        """What the machine is given."""
        return inputs

    def frame(self, sender: str, message: str, frame: Frame, wire: "Wire") -> bool:
        """A frame that is sent; whether it goes its usual way."""
        return True

    def turn(self, bed: "Bed", now_s: float) -> bool:
        """Whether the service gets its turn."""
        return True

    def end(self, bed: "Bed") -> None:
        """The fault goes."""


class Wire:
    """Frames on their way, each to everyone but its sender."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.late: list[tuple[float, str, Frame]] = []
        self.waiting: dict[str, deque[Frame]] = {name: deque() for name in (MACHINE, PANEL, CRUISE)}
        self.heard: Callable[[str, Frame], None] = lambda sender, frame: None

    def put(self, sender: str, frame: Frame, late_s: float = 0.0) -> None:
        """Send, to arrive now or later."""
        if late_s > 0.0:
            self.late.append((self.now_s + late_s, sender, copy(frame)))
            return
        self.heard(sender, frame)
        for name, waiting in self.waiting.items():
            if name != sender:
                waiting.append(frame)

    def deliver(self, now_s: float) -> None:
        """Let arrive what is due."""
        self.now_s = now_s
        if not self.late:
            return
        due = [one for one in self.late if one[0] <= now_s + 1e-9]
        self.late = [one for one in self.late if one[0] > now_s + 1e-9]
        for _, sender, frame in sorted(due, key=lambda one: one[0]):
            frame.timestamp = now_s
            self.put(sender, frame)


@dataclass(frozen=True, slots=True)
class Row:
    """One frame period as it was."""

    time_s: float
    state: State
    speed_mps: float  # true
    accel_mps2: float  # true, mean over the period
    allowed_mps: float  # what the operator asked for, as a machine can follow it; NaN while another commands
    command_ma: float
    obeyed: bool  # the machine does what a command of the service says


@dataclass(frozen=True, slots=True)
class Exit:
    """The moment at which cruise let go, or the machine of it."""

    time_s: float
    how: str
    intact_s: dict[str, float]  # when each message was last heard


class Machine(Combine):
    """The combine behind an actuator that may not obey."""

    fault: Fault | None = None

    def advance(self, inputs: Inputs, until_s: float) -> list[Reading]:
        """As Combine's."""
        return super().advance(inputs if self.fault is None else self.fault.inputs(inputs, until_s), until_s)


class Voice(Codec):
    """A codec whose owner may lie."""

    fault: Fault | None = None

    def encode(self, message: str, values: Mapping[str, float], time_s: float) -> Frame:
        """As Codec's."""
        said = values if self.fault is None else self.fault.said(message, dict(values), time_s)
        return super().encode(message, said, time_s)


class Bed:
    """One drive. `rows` is what happened."""

    def __init__(self, manoeuvre: Manoeuvre, fault: Fault | None = None) -> None:
        self.manoeuvre, self.fault = manoeuvre, fault
        plant = msgspec.structs.replace(plant_settings(), road=manoeuvre.road(plant_settings().road))
        self.machine = Machine(plant, manoeuvre.seed)
        self.voices = (codec(Voice), codec(Voice))
        operator = manoeuvre.operator
        self.combine_node = CombineNode(self.machine, self.voices[0], manoeuvre.field, operator)
        self.panel = OperatorNode(self.voices[1], operator)
        self.node = CruiseNode(cruise_settings(), factory_model(), codec())
        self.wire = Wire()
        self.wire.heard = self._hear
        self.listener = codec()
        self.rows: list[Row] = []
        self.commands: list[tuple[float, bool, float]] = []  # of the service: time, active, current
        self.intact_s: dict[str, float] = {}  # when each message was last heard by the service as it should be
        self.there = False  # the fault
        self.started = True  # the service; False where it refused to
        self.died = ""  # the exception that ended the service, or why it did not start
        self.exit: Exit | None = None
        self.left_s = math.inf  # when the service itself let go
        self.reference: Reference | None = None
        self.wished: deque[float] = deque(maxlen=LATE_ROWS)
        self._speed_mps = 0.0

    def run(self, until_s: float, from_s: float = math.inf, to_s: float = math.inf, after_s: float = math.inf) -> "Bed":
        """Drive to `until_s`, or `after_s` beyond the exit, with the fault there from `from_s` to `to_s`."""
        nodes = ((MACHINE, self.combine_node, 1), (PANEL, self.panel, 10), (CRUISE, self.node, 5))
        wire = self.wire
        for k in range(1, round(until_s / STEP_S) + 1):
            now_s = k * STEP_S
            wire.deliver(now_s)
            self._come_and_go(from_s <= now_s < to_s)
            for name, node, every in nodes:
                waiting = wire.waiting[name]
                if name == CRUISE and self.died:
                    waiting.clear()
                    continue
                off_s = self.fault.clock_off_s if name == CRUISE and self.fault is not None else 0.0
                while waiting:
                    node.receive(_later(waiting.popleft(), off_s))
                if k % every == 0:
                    self._turn(name, node, now_s)
            if k % 5 == 0:
                self._write(now_s)
                if self.exit is not None and now_s > self.exit.time_s + after_s:
                    break
        self._come_and_go(False)
        return self

    def _come_and_go(self, there: bool) -> None:
        fault = self.fault
        if fault is None or there == self.there:
            return
        self.there = there
        for liar in (self.machine, *self.voices):
            liar.fault = fault if there else None
        (fault.begin if there else fault.end)(self)

    def _turn(self, name: str, node: CombineNode | OperatorNode | CruiseNode, now_s: float) -> None:
        fault = self.fault
        if name == CRUISE and self.there and fault is not None and not fault.turn(self, now_s):
            return
        try:
            frames = node.tick(now_s + (fault.clock_off_s if name == CRUISE and fault is not None else 0.0))
        except Exception as error:
            if name != CRUISE:
                raise
            self.died = f"{type(error).__name__}: {error}"
            return
        for frame in frames:
            frame.timestamp = now_s if name == CRUISE else frame.timestamp
            if name == CRUISE:
                self._note(frame)
            if not self.there or fault is None or fault.frame(name, message_of(frame), frame, self.wire):
                self.wire.put(name, frame)

    def _hear(self, sender: str, frame: Frame) -> None:
        if sender != INTRUDER:
            self.intact_s[message_of(frame)] = self.wire.now_s

    def _note(self, frame: Frame) -> None:
        """Write down what the service commands, whatever becomes of it on the wire."""
        if message_of(frame) == "PumpCurrentCommand":
            values = {reading.name: reading.value for reading in self.listener.decode(frame).readings}
            self.commands.append((self.wire.now_s, values["command_active"] == 1.0, values["pump_current_command_ma"]))

    def _write(self, now_s: float) -> None:
        speed_mps = self.machine.truth.ground_speed_mps
        accel_mps2, self._speed_mps = (speed_mps - self._speed_mps) / 0.05, speed_mps
        commanded = self.combine_node.driven_by_cruise
        obeyed = commanded and bool(self.commands) and self.commands[-1][1]
        if obeyed and self.reference is None:
            self.reference = Reference(ReferenceSettings())
            self.reference.reset(speed_mps)
        allowed_mps = math.nan
        if self.reference is not None:
            asked_mps = self.manoeuvre.setpoint_mps(now_s)
            self.wished.append(max(self.reference.step(asked_mps, 0.05), asked_mps))
            allowed_mps = max(self.wished) if obeyed or not commanded else math.nan
        current_ma = self.commands[-1][2] if self.commands else 0.0
        last = self.rows[-1] if self.rows else None
        state = self.node.engagement.state
        self.rows.append(Row(now_s, state, speed_mps, accel_mps2, allowed_mps, current_ma, obeyed))
        if last is not None and last.state.controls and not state.controls:
            self.left_s = min(self.left_s, now_s)
        if self.exit is None and last is not None:
            if last.state.controls and not state.controls:
                self.exit = Exit(now_s, self._why(), dict(self.intact_s))
            elif last.obeyed and not obeyed:
                self.exit = Exit(now_s, self.died or "time-out of the drive", dict(self.intact_s))

    def _why(self) -> str:
        engagement = self.node.engagement
        if engagement.exit_condition == "signals_lost":
            return f"lost: {engagement.exit_detail}"
        implausible = engagement.exit_condition == "implausible"
        return engagement.exit_detail if implausible else engagement.exit_condition.replace("_", " ")


@cache
def cruise_settings() -> CruiseSettings:
    """config/cruise.yaml, without its CANopen node, which has no part in these trials."""
    return msgspec.structs.replace(service_settings.load(CONFIG / "cruise.yaml"), canopen=None)


@cache
def plant_settings() -> PlantSettings:
    """config/plant.yaml."""
    return strict.load(CONFIG / "plant.yaml", PlantSettings)


@cache
def factory_model() -> Model:
    """config/factory_model.yaml."""
    return files.load(cruise_settings().model)


@cache
def layouts() -> tuple[Layout, ...]:
    """The database, read once."""
    return database.layouts(cruise_settings().database, cruise_settings().can)


def codec(kind: type[Spoken] = Codec) -> Spoken:
    """A codec of its own counters."""
    return kind(layouts(), cruise_settings().can.max_counter_step)


def message_of(frame: Frame) -> str:
    """The name of one of our messages, empty for others."""
    return _by_id().get(frame.arbitration_id, "")


@cache
def _by_id() -> dict[int, str]:
    return {layout.arbitration_id: layout.name for layout in layouts()}


def _later(frame: Frame, off_s: float) -> Frame:
    if off_s == 0.0:
        return frame
    later = copy(frame)
    later.timestamp += off_s
    return later
