"""Frames to readings and back, by the DBC file and the contracts of `messages`.

    value = scale raw + offset,    NaN where raw is above the last valid one or value is outside of the signal's range

cantools reads the DBC file and packs and unpacks the raw values; the rules of the whole bus (what counts as a
measurement, direction and magnitude in one, source address, counter and CRC) are applied here. One Codec belongs to
one end of the bus: its counters are those of what this end has sent and received.

Sources: SAE J1939-71 5.1.4, ISO 11783-7, AUTOSAR E2E profile 1.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from cruise.can import database, j1939, protection
from cruise.can.bus import Filter
from cruise.can.database import Field, Layout
from cruise.can.frame import Frame, FrameFault
from cruise.can.messages import FORWARD, OPEN, REVERSE, Direction
from cruise.can.settings import CanSettings
from cruise.signals import Reading

_LAST_COUNT: Final = protection.COUNTS - 1  # so that the first frame carries 0


@dataclass(frozen=True, slots=True)
class Decoded:
    """What one frame says: which message it is (None: none of ours), the readings in it, or why there are none."""

    message: str | None
    readings: tuple[Reading, ...] = ()
    fault: FrameFault | None = None


@dataclass(slots=True)
class CodecState:
    """The alive counters, by message: of the last frame sent, and of the last intact one received."""

    sent: dict[str, int] = field(default_factory=dict)
    received: dict[str, int] = field(default_factory=dict)


class Codec:
    """Decodes and encodes the messages of one end of the bus; `state` is all that changes."""

    def __init__(self, layouts: Iterable[Layout], max_counter_step: int) -> None:
        self.state = CodecState()
        self._max_counter_step = max_counter_step
        self._by_name = {layout.name: layout for layout in layouts}
        self._by_pgn = {layout.arbitration_id & j1939.PGN_MASK: layout for layout in self._by_name.values()}

    @classmethod
    def load(cls, path: str | Path, settings: CanSettings) -> "Codec":
        """Read the DBC file at `path`.

        Raises SettingsError that names file, message and signal where one is missing or has another width.
        """
        return cls(database.layouts(path, settings), settings.max_counter_step)

    @property
    def filters(self) -> tuple[Filter, ...]:
        """What the kernel has to let pass for `decode` to see all of its messages, whoever sends them."""
        return tuple(Filter(pgn_bits, j1939.PGN_MASK, True) for pgn_bits in self._by_pgn)

    def decode(self, frame: Frame) -> Decoded:
        """Return the readings in `frame`, at its timestamp; never raises, whatever was on the bus."""
        if frame.is_error_frame:
            return _ERROR_FRAME
        if frame.is_remote_frame:
            return _REMOTE_FRAME
        layout = self._by_pgn.get(frame.arbitration_id & j1939.PGN_MASK) if frame.is_extended_id else None
        if layout is None:
            return _UNKNOWN
        data = frame.data[: database.FRAME_BYTES]
        fault = self._fault_of(layout, frame.arbitration_id & 0xFF, data)
        return Decoded(layout.name, self.readings(frame, layout.name) if fault is None else (), fault)

    def readings(self, frame: Frame, message: str) -> tuple[Reading, ...]:
        """Return what `frame` holds as `message`, whatever its counter and CRC say; it has to be long enough."""
        layout, data = self._by_name[message], bytes(frame.data[: database.FRAME_BYTES])
        raw = layout.message.decode_simple(data, decode_choices=False, scaling=False)
        return _readings(layout, raw, frame.timestamp)

    def encode(self, message: str, values: Mapping[str, float], time_s: float) -> Frame:
        """Return the frame of `message` with `values` by signal name, in the signals' units; NaN: not available.

        Signals without a value are sent as not available. Raises ValueError for a message or signal that is not
        known and for a value that the signal cannot hold; nothing is clipped here.
        """
        layout = self._by_name.get(message)
        if layout is None:
            raise ValueError(f"no message {message}; known are {', '.join(self._by_name)}")
        raw = layout.blank.copy()
        left = len(values)
        for entry in layout.fields:
            value = values.get(entry.name)
            if value is None:
                continue
            left -= 1
            if value == value:  # not NaN
                direction = layout.direction
                if direction is not None and direction.speed == entry.name:
                    raw[direction.signal] = REVERSE if value < 0.0 else FORWARD
                    value = abs(value)
                raw[entry.name] = _raw(entry, value, message)
        if left:
            unknown = values.keys() - {entry.name for entry in layout.fields}
            raise ValueError(f"message {message} has no signal {', '.join(sorted(unknown))}")
        data = bytearray(layout.message.encode(raw, scaling=False, padding=True, strict=False))
        if layout.data_id is not None:
            last = self.state.sent.get(message, _LAST_COUNT)
            self.state.sent[message] = protection.protect(data, layout.data_id, last)
        return Frame(timestamp=time_s, arbitration_id=layout.arbitration_id, data=data, is_rx=False)

    def _fault_of(self, layout: Layout, source_address: int, data: bytearray) -> FrameFault | None:
        if layout.source_address is not None and source_address != layout.source_address:
            return FrameFault.WRONG_SOURCE
        if len(data) < database.FRAME_BYTES:
            return FrameFault.TOO_SHORT
        if layout.data_id is None:
            return None
        last = self.state.received.get(layout.name)
        fault = protection.fault_of(data, layout.data_id, last, self._max_counter_step)
        if fault is not FrameFault.BAD_CRC:
            self.state.received[layout.name] = protection.counter_of(data)
        return fault


def _readings(layout: Layout, raw: Mapping[str, Any], time_s: float) -> tuple[Reading, ...]:
    return tuple([Reading(entry.name, time_s, _value(entry, raw, layout.direction)) for entry in layout.fields])


def _value(entry: Field, raws: Mapping[str, Any], direction: Direction | None) -> float:
    raw: int = raws[entry.name]
    if raw > entry.last_valid:
        return math.nan
    value = entry.scale * raw + entry.offset
    if direction is not None and direction.speed == entry.name and value != 0.0:
        state = raws[direction.signal]
        value *= {FORWARD: 1.0, REVERSE: -1.0, OPEN: direction.sign_if_open}.get(state, math.nan)
    return value if entry.low <= value <= entry.high else math.nan


def _raw(entry: Field, value: float, message: str) -> int:
    raw = (value - entry.offset) / entry.scale
    if not -0.5 <= raw < entry.last_valid + 0.5:
        high = entry.scale * entry.last_valid + entry.offset
        raise ValueError(f"message {message}: {entry.name} = {value} does not fit into {entry.offset} to {high}")
    return round(raw)


_ERROR_FRAME: Final = Decoded(None, fault=FrameFault.ERROR_FRAME)
_REMOTE_FRAME: Final = Decoded(None, fault=FrameFault.REMOTE_FRAME)
_UNKNOWN: Final = Decoded(None, fault=FrameFault.UNKNOWN)
