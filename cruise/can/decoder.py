"""Frames to readings by all that a DBC file describes: our messages by the codec, any other as the file says.

    value = scale raw + offset,    NaN for a raw value that SAE J1939-71 keeps for "error" and "not available"

Other messages are those of the machine's own controllers, which recordings hold and nothing drives by: no counter, no
CRC and no address of them is known. Those of J1939 (VFrameFormat in the file) are found by their PGN and the address
that the file has them sent from, or whoever sends them where the file knows one of that PGN only: proprietary PGNs mean
something else from every controller. What isn't J1939 has no value that means "not available".
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from cantools.database.can import Message
from cantools.database.errors import Error as DatabaseError

from cruise.can import database, j1939
from cruise.can.codec import Codec, CodecState, Decoded
from cruise.can.frame import Frame, FrameFault
from cruise.can.settings import CanSettings
from cruise.signals import Reading

J1939: Final = "j1939"
_PDU1_MASK: Final = 0x03FF0000  # the PGN's low byte is the destination
_SOURCE: Final = 0xFF  # the identifier's low byte
_ANYBODY: Final = 0xFE  # the null address: a file that has a message sent from there has it sent by whomever


class Decoder:
    """Decodes every message of a DBC file; `problems` says which of ours it describes otherwise than we know them."""

    def __init__(
        self, codec: Codec, ours: Iterable[str], others: Iterable[Message], problems: tuple[str, ...] = ()
    ) -> None:
        self.ours = frozenset(ours)
        self.problems = problems
        self._codec = codec
        self._counters: dict[str, CodecState] = {}  # by bus
        self._exact: dict[tuple[int, bool], Message] = {}
        self._by_pgn: dict[int, dict[int, Message]] = {}  # and by its source address
        for message in others:
            if message.protocol == J1939:
                same = self._by_pgn.setdefault(_pgn_bits(message.frame_id), {})
                same[message.frame_id & _SOURCE] = message
            else:
                self._exact[message.frame_id, message.is_extended_frame] = message

    @classmethod
    def load(cls, path: str | Path, settings: CanSettings) -> "Decoder":
        """Read the DBC file at `path`. Raises SettingsError where it can't be read."""
        found = database.described(path, settings)
        codec = Codec(found.layouts, settings.max_counter_step)
        return cls(codec, (layout.name for layout in found.layouts), found.others, found.problems)

    def decode(self, frame: Frame) -> Decoded:
        """Return the readings in `frame`, at its timestamp; never raises, whatever was on the bus.

        A frame whose counter jumped has its readings beside that fault: loggers thin out.
        """
        self._codec.state = self._counters.setdefault(str(frame.channel), CodecState())
        decoded = self._codec.decode(frame)
        if decoded.fault is FrameFault.COUNTER_JUMPED and decoded.message is not None:
            return replace(decoded, readings=self._codec.readings(frame, decoded.message))
        if decoded.fault is not FrameFault.UNKNOWN:
            return decoded
        message = self._exact.get((frame.arbitration_id, frame.is_extended_id))
        if message is None and frame.is_extended_id:
            message = self._of_j1939(frame.arbitration_id)
        if message is None or message.is_container:
            return decoded
        try:
            raws = message.decode_simple(bytes(frame.data), decode_choices=False, scaling=False)
        except (DatabaseError, ValueError):
            return Decoded(message.name, fault=FrameFault.TOO_SHORT)
        return Decoded(message.name, tuple(_readings(message, raws, frame.timestamp)))

    def _of_j1939(self, arbitration_id: int) -> Message | None:
        same = self._by_pgn.get(_pgn_bits(arbitration_id), {})
        anybody = next(iter(same.values())) if len(same) == 1 else same.get(_ANYBODY)
        return same.get(arbitration_id & _SOURCE, anybody)


def _pgn_bits(arbitration_id: int) -> int:
    broadcast = j1939.is_broadcast(j1939.pgn_of(arbitration_id))
    return arbitration_id & (j1939.PGN_MASK if broadcast else _PDU1_MASK)


def _readings(message: Message, raws: Mapping[str, object], time_s: float) -> Iterable[Reading]:
    for signal in message.signals:
        raw = raws.get(signal.name)  # none: the multiplexer has others in this frame
        if isinstance(raw, int | float):
            measured = message.protocol != J1939 or raw <= _last_valid(signal.length)  # no signed one gets there
            value = signal.conversion.raw_to_scaled(raw, decode_choices=False) if measured else float("nan")
            yield Reading(signal.name, time_s, float(value))  # pyright: ignore[reportArgumentType]


def _last_valid(bits: int) -> float:
    try:
        return j1939.last_valid(bits)
    except ValueError:
        return float("inf")
