"""What canopen's SDO server takes and CiA 301 does not: answered before the server sees it.

A request is 8 bytes: command specifier in the three high bits of byte 0, and where it begins a transfer index in bytes
1 and 2, subindex in byte 3. The server collects as many segments as come, whether or not such a transfer was begun or
aborted and however many bytes it was to have; it finds a variable under any subindex; and it answers a block upload
with another protocol, which a client may allow (byte 5) or not.

Source: CiA 301 4.2, 7.2.4.3 (SDO protocols), 7.2.4.3.17 (abort codes).
"""

from typing import Final

import canopen
from canopen.objectdictionary import ODVariable

from cruise.can.node_texts import MAX_BYTES

NOTHING_BEGUN: Final = bytes.fromhex("8000000001000405")  # SDO abort 0504 0001h: command specifier not valid
TOO_MUCH: Final = bytes.fromhex("8000000005000405")  # SDO abort 0504 0005h: out of memory
MOST_SEGMENTS: Final = 2 * MAX_BYTES // 7  # of a download
_SEGMENT_DOWN, _DOWNLOAD, _UPLOAD, _SEGMENT_UP, _ABORTED, _BLOCK_UPLOAD, _BLOCK_DOWNLOAD = range(7)  # by the client
_ABORT: Final = 0x80
_NOT_VALID: Final = 0x05040001  # SDO aborts: command specifier
_NO_SUBINDEX: Final = 0x06090011
_TOO_LONG, _TOO_SHORT = 0x06070012, 0x06070013
_EXPEDITED, _SIZE_GIVEN, _LAST = 0b10, 0b01, 0b01  # bits of byte 0


class SdoRules:
    """`refusal` of every request; what is not refused is the server's, whose answer `answered` has to see."""

    def __init__(self, dictionary: canopen.ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._segment: int | None = None  # the command of the transfer that is under way in segments
        self._object = bytes(3)  # its index and subindex
        self._segments = self._bytes = 0  # of a download
        self._announced: int | None = None  # bytes that it is to have

    def refusal(self, request: bytes) -> bytes | None:
        """Return the abort for a request that is not to be served; None for all others."""
        command = request[0] >> 5
        if command in (_SEGMENT_DOWN, _SEGMENT_UP):
            if command != self._segment:
                return NOTHING_BEGUN
            return self._too_much(request) if command == _SEGMENT_DOWN else None
        self._segment = None
        if command not in (_DOWNLOAD, _UPLOAD, _BLOCK_UPLOAD, _BLOCK_DOWNLOAD):
            return None
        self._object = request[1:4]
        if command == _BLOCK_UPLOAD and request[5] == 0:
            return self._abort(_NOT_VALID)
        variable = isinstance(self._dictionary.get(int.from_bytes(request[1:3], "little")), ODVariable)
        return self._abort(_NO_SUBINDEX) if request[3] and variable else None

    def answered(self, request: bytes, answer: bytes) -> None:
        """Note what the server has made of a request."""
        command = request[0] >> 5
        if answer[0] == _ABORT:
            self._segment = None
        elif command == _DOWNLOAD and not request[0] & _EXPEDITED:
            self._segment, self._segments, self._bytes = _SEGMENT_DOWN, 0, 0
            self._announced = (request[0] & _SIZE_GIVEN and int.from_bytes(request[4:8], "little")) or None
        elif command in (_UPLOAD, _BLOCK_UPLOAD) and not answer[0] & _EXPEDITED:
            self._segment = _SEGMENT_UP
        elif (command == _SEGMENT_DOWN and request[0] & _LAST) or (command == _SEGMENT_UP and answer[0] & _LAST):
            self._segment = None

    def _too_much(self, request: bytes) -> bytes | None:
        """Count the segments of a download; it has to have what was announced, and not more than anybody needs."""
        self._segments += 1
        self._bytes += 7 - (request[0] >> 1 & 0b111)
        if self._segments > MOST_SEGMENTS:
            return TOO_MUCH
        wanted = self._bytes if self._announced is None else self._announced
        if self._bytes > wanted or (request[0] & _LAST and self._bytes < wanted):
            self._segment = None
            return self._abort(_TOO_LONG if self._bytes > wanted else _TOO_SHORT)
        return None

    def _abort(self, code: int) -> bytes:
        return bytes([_ABORT]) + self._object + code.to_bytes(4, "little")
