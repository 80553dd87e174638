"""A CANopen node: heartbeat, NMT, SDO; setpoint and switch in (RPDO 1), state of the cruise control out (TPDO 1).

The library's protocol machines, without its threads: frames are handed in, `tick` gives what is to be sent, time is an
argument. Raw values are 0.001 m/s and 0.05 mA a bit; 0xFFFF, 0x8000 and 0xFF are "not available".

A master starts the node (NMT start): before that, and after NMT stop, PDOs are neither taken nor sent. NMT stop asks
for neutral (`neutral_requested`), and so does the loss of the heartbeat of the node that object 1016h names. An
emergency message says when something goes wrong, and another when all of it is right again.

Sources: CiA 301 4.2, 7.2.8 (NMT, heartbeat), 7.2.7 (EMCY), 7.2.2 (PDO), 7.2.4 (SDO); the objects are described in
config/cruise.eds.
"""

import configparser
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import canopen
import msgspec
from canopen.objectdictionary import ODVariable

from cruise.can.bus import Filter
from cruise.can.frame import Frame
from cruise.can.heartbeat import HEARTBEAT_CONSUMER, HEARTBEAT_ID, HeartbeatConsumer
from cruise.can.node_network import Network, is_due, next_due
from cruise.can.node_sdo import NOTHING_BEGUN, SdoRules
from cruise.can.node_texts import NodeTexts
from cruise.settings import SettingsError
from cruise.signals import SIGNALS, Reading

STANDARD_MASK: Final = 0x7FF
NMT_ID: Final = 0x000
SDO_REQUEST_ID: Final = 0x600
SDO_ANSWER_ID: Final = 0x580
ERROR_REGISTER: Final = 0x1001
COMMUNICATION: Final = range(0x1000, 0x2000)  # the profile's objects of communication, CiA 301, table 15
NMT_COMMANDS: Final = {1, 2, 128, 129, 130}  # start, stop, enter pre-operational, reset node, reset communication
FAULT_STATE: Final = 3.0  # engagement_state
EMERGENCIES: Final = {  # code of CiA 301, table 26, and bits of the error register 1001h
    "heartbeat": (0x8130, 0x11),  # heartbeat of the operator's panel lost; communication
    "fault": (0xFF00, 0x81),  # cruise control in the state fault; specific to the device
}
STATUS: Final = {  # TPDO object: scale in its unit per bit, lowest and highest raw value, raw value for "not available"
    "ground_speed_mps": (0.001, -32767, 32767, -32768),
    "followed_setpoint_mps": (0.001, 0, 0xFAFF, 0xFFFF),
    "pump_current_ma": (0.05, -32767, 32767, -32768),
    "engagement_state": (1.0, 0, 0xFA, 0xFF),
}
COMMANDS: Final = {"setpoint_mps": 0.001, "cruise_enable": 1.0}  # RPDO object: scale in its unit per bit


class CanopenSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the node is on the bus."""

    node_id: Annotated[int, msgspec.Meta(ge=1, le=127)] = 17  # CiA 301: 1..127, unique on the bus
    panel_node_id: Annotated[int, msgspec.Meta(ge=0, le=127)] = 0  # whose heartbeat is watched; 0: nobody's
    panel_timeout_ms: Annotated[int, msgspec.Meta(ge=10, le=65535)] = 250  # ms; object 1016h takes both over


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """What the node tells of the cruise control; NaN: not available."""

    ground_speed_mps: float
    followed_setpoint_mps: float
    pump_current_ma: float
    engagement_state: float  # as in config/cruise.eds: 0 off .. 6 overridden


class CanopenNode:
    """The node: `receive` every frame of the bus, `tick` at any rate of 10 Hz or more; send what they have to say."""

    def __init__(self, dictionary: canopen.ObjectDictionary, settings: CanopenSettings) -> None:
        self._network = Network()
        self._dictionary, self._settings = dictionary, settings
        self._node_id = settings.node_id
        self._node = canopen.LocalNode(settings.node_id, dictionary)
        self._network[settings.node_id] = self._node
        self._node.rpdo.read()
        self._node.tpdo.read()
        self._node.add_write_callback(self._written)
        self._shortest = {NMT_ID: 2, SDO_REQUEST_ID + settings.node_id: 8}
        self._rpdo = self._node.rpdo[1]
        self._tpdo = self._node.tpdo[1]
        self._readings: list[Reading] = []
        self._received_s = 0.0
        self._sdo = SdoRules(dictionary)
        self._status_due_s = -math.inf
        self._panel = HeartbeatConsumer()
        self._errors: tuple[str, ...] = ()
        self._power_on()

    @classmethod
    def load(cls, path: str | Path, settings: CanopenSettings) -> "CanopenNode":
        """Read the EDS file at `path`. Raises SettingsError where it is none or lacks an object."""
        try:
            dictionary = canopen.import_od(str(path), settings.node_id)
            if not dictionary:
                raise ValueError("it describes no object")
            node = cls(dictionary, settings)
        except OSError as error:
            raise SettingsError(
                f"{path}: cannot be read: {error.strerror}; let the setting `dictionary` name the node's EDS file, a "
                "copy of config/cruise.eds, or remove the section `canopen`"
            ) from error
        except (configparser.Error, ValueError, LookupError, canopen.SdoAbortedError) as error:
            raise SettingsError(f"{path}: not an EDS file that can be used: {error}; see config/cruise.eds") from error
        for names, pdo in ((COMMANDS, node._rpdo), (STATUS, node._tpdo)):
            missing = names.keys() - {variable.name for variable in pdo}
            if missing:
                raise SettingsError(f"{path}: {', '.join(sorted(missing))} not mapped in {pdo.name}; map it")
        return node

    def anew(self) -> "CanopenNode":
        """One that has yet to start, with the same objects and settings: nothing is left of this one's time."""
        return CanopenNode(self._dictionary, self._settings)

    @property
    def filters(self) -> tuple[Filter, ...]:
        """What the kernel has to let pass for `receive` to see all that concerns the node."""
        wanted = (NMT_ID, SDO_REQUEST_ID + self._node_id, self._rpdo.cob_id or 0)
        heartbeats = Filter(HEARTBEAT_ID, HEARTBEAT_ID, False)  # object 1016h may name another node at any time
        return (*(Filter(identifier, STANDARD_MASK, False) for identifier in wanted), heartbeats)

    @property
    def state(self) -> str:
        """NMT state: INITIALISING, PRE-OPERATIONAL, OPERATIONAL or STOPPED."""
        return self._node.nmt.state

    @property
    def neutral_requested(self) -> bool:
        """Whether a master stopped the node, or the panel's heartbeat is lost."""
        return self.state == "STOPPED" or "heartbeat" in self._errors

    def describe(self, texts: NodeTexts) -> None:
        """Let `texts` answer for the objects that it knows."""
        self._node.add_read_callback(texts.read)
        self._node.add_write_callback(texts.write)

    def receive(self, frame: Frame) -> tuple[Reading, ...]:
        """Take any frame in and return what it sets, NaN where it says "not available"; never raises."""
        if frame.is_extended_id or frame.is_error_frame or frame.is_remote_frame:
            return ()
        self._panel.receive(frame)
        if not self._concerns(frame):
            return ()
        self._received_s = frame.timestamp
        if frame.arbitration_id == SDO_REQUEST_ID + self._node_id:
            self._answer(bytes(frame.data), frame.timestamp)
        else:
            self._network.notify(frame.arbitration_id, frame.data, frame.timestamp)
        if frame.arbitration_id == self._rpdo.cob_id:
            for variable in self._rpdo:
                self._node.set_data(variable.index, variable.subindex, variable.data)
        readings, self._readings = tuple(self._readings), []
        return readings

    def _answer(self, request: bytes, time_s: float) -> None:
        """Have an SDO request answered, by the server unless it takes what it must not."""
        answer, sent = self._sdo.refusal(request), len(self._network.outbox)
        if answer is None:
            try:
                self._network.notify(SDO_REQUEST_ID + self._node_id, bytearray(request), time_s)
            except struct.error:  # canopen's server can't name the object of a transfer that nobody has begun
                answer = NOTHING_BEGUN
        if answer is not None:
            self._network.send_message(SDO_ANSWER_ID + self._node_id, answer)
        for identifier, data in self._network.outbox[sent:]:
            if identifier == SDO_ANSWER_ID + self._node_id:
                self._sdo.answered(request, data)

    def tick(self, now_s: float, status: NodeStatus) -> list[Frame]:
        """Return what is to be sent at `now_s`: boot-up, heartbeat, status, answers to what was received."""
        if self.state == "INITIALISING":
            self._power_on()
            self._node.nmt.state = "INITIALISING"  # sends the boot-up message
            self._node.nmt.state = "PRE-OPERATIONAL"
        self._warn(now_s, status)
        self._network.tick(now_s)
        if is_due(self._status_due_s, now_s):
            self._status_due_s = next_due(self._status_due_s, (self._tpdo.event_timer or 100) / 1000.0, now_s)
            self._publish(status)
        return self._sent(now_s)

    def answers(self) -> list[Frame]:
        """Return what has to be answered to the last frame that was received."""
        return self._sent(self._received_s) if self._network.outbox else []

    def _power_on(self) -> None:
        """What a master wrote about communication (1000h to 1FFFh) is forgotten, as CiA 301 wants it of both resets."""
        for index in [one for one in self._node.data_store if one in COMMUNICATION]:
            del self._node.data_store[index]
        self._panel, self._errors = HeartbeatConsumer(), ()
        if HEARTBEAT_CONSUMER in self._dictionary and self._settings.panel_node_id:
            entry = self._settings.panel_node_id << 16 | self._settings.panel_timeout_ms
            self._node.set_data(HEARTBEAT_CONSUMER, 1, entry.to_bytes(4, "little"))
            self._panel.watch(entry)

    def _sent(self, now_s: float) -> list[Frame]:
        outbox, self._network.outbox = self._network.outbox, []
        return [Frame(now_s, can_id, is_extended_id=False, data=data, is_rx=False) for can_id, data in outbox]

    def _warn(self, now_s: float, status: NodeStatus) -> None:
        """Tell of what has gone wrong since the last tick, or that nothing is wrong any more."""
        there = {"heartbeat": self._panel.lost(now_s), "fault": status.engagement_state == FAULT_STATE}
        errors = tuple(name for name in EMERGENCIES if there[name])
        if errors == self._errors:
            return
        new = [name for name in errors if name not in self._errors]
        self._errors = errors
        register = 0
        for name in errors:
            register |= EMERGENCIES[name][1]
        self._node.set_data(ERROR_REGISTER, 0, bytes([register]))
        if self.state == "STOPPED":
            return
        for name in new:
            self._node.emcy.send(EMERGENCIES[name][0], register)
        if not errors:
            self._node.emcy.reset()

    def _concerns(self, frame: Frame) -> bool:
        if frame.arbitration_id == self._rpdo.cob_id:
            return self.state == "OPERATIONAL" and len(frame.data) * 8 >= self._rpdo.length
        if len(frame.data) < self._shortest.get(frame.arbitration_id, math.inf):
            return False
        if frame.arbitration_id == NMT_ID:
            return frame.data[0] in NMT_COMMANDS
        return self.state != "STOPPED"

    def _written(self, index: int, od: ODVariable, data: bytes, **_: object) -> None:
        if index == HEARTBEAT_CONSUMER:
            self._panel.watch(int.from_bytes(data, "little"))
            return
        scale = COMMANDS.get(od.name)
        if scale is not None:
            value = int.from_bytes(data, "little") * scale  # both are unsigned
            signal = SIGNALS[od.name]
            if not signal.low <= value <= signal.high:
                value = math.nan
            self._readings.append(Reading(od.name, self._received_s, value))

    def _publish(self, status: NodeStatus) -> None:
        for variable in self._tpdo:
            variable.raw = _raw(variable.name, getattr(status, variable.name))
            self._node.set_data(variable.index, variable.subindex, variable.data)
        if self.state == "OPERATIONAL":
            self._tpdo.transmit()


def _raw(name: str, value: float) -> int:
    scale, low, high, not_available = STATUS[name]
    raw = value / scale
    return round(raw) if low <= raw <= high else not_available
