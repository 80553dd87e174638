"""Requests for a parameter group: one that we don't have is refused, so that whoever asked need not wait for it.

    request: PGN, 3 bytes;    acknowledgment: control 1 (negative), FF FF FF, address of who asked, PGN, to everybody

What is asked of everybody is refused by nobody, and what we send by ourselves comes within its period.

Source: SAE J1939-21, 5.4.2 (request) and 5.4.4 (acknowledgment).
"""

from collections.abc import Collection
from typing import Final, NamedTuple

from cruise.can import j1939
from cruise.can.frame import Frame

REQUEST, ACKNOWLEDGMENT = 0xEA00, 0xE800  # PGNs 59904 and 59392
EVERYBODY: Final = 0xFF
PRIORITY: Final = 6
MOST: Final = 8  # refusals between two ticks: who asks more often has to wait
_REFUSED: Final = 1
_DESTINATION_MASK: Final = 0x03FF0000  # PDU1: the PGN without the destination in its low byte


class Asked(NamedTuple):
    """Who asks whom for what."""

    by: int
    of: int
    pgn: int


def asked(frame: Frame) -> Asked | None:
    """Return the request in a frame, None where it is none; never raises."""
    if not frame.is_extended_id or frame.is_error_frame or frame.is_remote_frame or len(frame.data) < 3:
        return None
    identifier = frame.arbitration_id
    if (identifier & _DESTINATION_MASK) >> 8 != REQUEST:
        return None
    return Asked(identifier & 0xFF, identifier >> 8 & 0xFF, int.from_bytes(frame.data[:3], "little"))


class Requests:
    """Refuses what is asked of `address` and not among the `known` PGNs: `receive` every frame, `tick` at any rate."""

    def __init__(self, address: int, known: Collection[int]) -> None:
        self._address, self._known = address, frozenset(known)
        self._refused: list[Asked] = []

    def receive(self, frame: Frame) -> None:
        """Take any frame in; never raises."""
        request = asked(frame)
        if request is None or request.of != self._address or request.pgn in self._known:
            return
        if len(self._refused) < MOST and request not in self._refused:
            self._refused.append(request)

    def tick(self, now_s: float) -> list[Frame]:
        """Return the refusals that are due."""
        refused, self._refused = self._refused, []
        identifier = j1939.identifier(ACKNOWLEDGMENT | EVERYBODY, PRIORITY, self._address)
        return [
            Frame(
                timestamp=now_s,
                arbitration_id=identifier,
                data=bytes([_REFUSED, 0xFF, 0xFF, 0xFF, one.by]) + one.pgn.to_bytes(3, "little"),
                is_rx=False,
            )
            for one in refused
        ]
