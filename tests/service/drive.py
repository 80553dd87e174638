"""A whole drive in lockstep on a wire that a test may tamper with, and what was heard on it."""

from collections import deque
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cruise import settings as strict
from cruise.can.bus import Bus, Sent
from cruise.can.codec import Codec
from cruise.can.frame import Frame, FrameFault
from cruise.can.settings import CanSettings
from cruise.control.engagement import State
from cruise.model import files
from cruise.plant import Combine, PlantSettings
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.course import FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lockstep
from cruise.service.operator_node import OperatorNode
from cruise.service.settings import CruiseSettings

CONFIG = Path(__file__).resolve().parents[2] / "config"
CAN = CanSettings()

Tamper = Callable[[str | None, Frame], Iterable[Frame]]
"""Message and frame to what comes out at the other ends of the wire."""


class Wire:
    """A bus without any library: ends hear each other in the order of sending, through `tamper`."""

    def __init__(self, tamper: Tamper) -> None:
        self.ends: list[End] = []
        self.tamper = tamper
        self.names = codec()

    def end(self) -> "End":
        """One more end."""
        self.ends.append(End(self))
        return self.ends[-1]


class End(Bus):
    """One end of a Wire."""

    def __init__(self, wire: Wire) -> None:
        super().__init__("wire")
        self.wire = wire
        self.waiting: deque[Frame] = deque()

    def send(self, frame: Frame) -> Sent:
        for passed in self.wire.tamper(self.wire.names.decode(frame).message, frame):
            for other in self.wire.ends:
                if other is not self:
                    other.waiting.append(copy(passed))
        return Sent.SENT

    def close(self) -> None:
        self.waiting.clear()

    def _take(self, timeout_s: float) -> Frame | None:
        return self.waiting.popleft() if self.waiting else None


@dataclass(frozen=True, slots=True)
class Heard:
    """One command on the bus."""

    time_s: float
    active: bool
    current_ma: float


class Listener:
    """Writes down what cruise says."""

    period_s = 1.0

    def __init__(self) -> None:
        self.codec = codec()
        self.commands: list[Heard] = []
        self.reasons: list[tuple[float, int]] = []
        self.faults = 0

    def receive(self, frame: Frame) -> None:
        decoded = self.codec.decode(frame)
        values = {reading.name: reading.value for reading in decoded.readings}
        if decoded.message == "PumpCurrentCommand":
            if decoded.fault is None:
                current_ma = values["pump_current_command_ma"]
                self.commands.append(Heard(frame.timestamp, values["command_active"] == 1.0, current_ma))
            elif decoded.fault is not FrameFault.WRONG_SOURCE:
                self.faults += 1
        elif decoded.message == "MachineSelectedSpeed" and decoded.fault is None:
            self.reasons.append((frame.timestamp, int(values["exit_reason"])))

    def tick(self, now_s: float) -> list[Frame]:
        return []


@cache
def layouts() -> Codec:
    """The database, read once."""
    return Codec.load(CONFIG / "cruise.dbc", CAN)


def codec() -> Codec:
    """A codec of its own counters."""
    return Codec(layouts()._by_name.values(), CAN.max_counter_step)


@cache
def cruise_settings() -> CruiseSettings:
    """config/cruise.yaml."""
    return service_settings.load(CONFIG / "cruise.yaml")


@cache
def plant_settings() -> PlantSettings:
    """config/plant.yaml."""
    return strict.load(CONFIG / "plant.yaml", PlantSettings)


ENGAGE_S = 5.0  # s, when the operator presses the button
FIELD = (FieldRow(at_s=0.0, engine_speed_setpoint_rpm=2100.0, gear=2),)
OPERATOR = (
    OperatorRow(at_s=0.2, cruise_enable=1.0, setpoint_mps=1.2),
    OperatorRow(at_s=0.5, over_s=1.5, lever_pct=55.0),
    OperatorRow(at_s=ENGAGE_S, press="resume"),
)


class Whole:
    """Combine, panel and cruise on one wire; `states` are the changes of the state, with their times."""

    def __init__(
        self,
        tamper: Tamper = lambda name, frame: (frame,),
        field: tuple[FieldRow, ...] = (),
        operator: tuple[OperatorRow, ...] = (),
    ) -> None:
        self.wire = Wire(tamper)
        self.combine = Combine(plant_settings(), 7)
        self.machine = CombineNode(self.combine, codec(), FIELD + field, OPERATOR + operator)
        self.panel = OperatorNode(codec(), OPERATOR + operator)
        self.node = CruiseNode(cruise_settings(), files.load(cruise_settings().model), codec())
        self.listener = Listener()
        nodes = (self.machine, self.panel, self.node, self.listener)
        self.loop = Lockstep([(node, self.wire.end()) for node in nodes])
        self.states: list[tuple[float, State]] = []

    def run(self, until_s: float) -> "Whole":
        """Drive on to `until_s`."""

        def each_step(now_s: float) -> None:
            state = self.node.engagement.state
            if not self.states or self.states[-1][1] is not state:
                self.states.append((now_s, state))

        self.loop.run(until_s, each_step)
        return self

    @property
    def now_s(self) -> float:
        return self.loop.now_s

    def engaged_at(self, time_s: float) -> bool:
        """Whether the command on the bus was active at one time."""
        return [heard for heard in self.listener.commands if heard.time_s <= time_s + 1e-6][-1].active
