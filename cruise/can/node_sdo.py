"""What canopen's SDO server takes and CiA 301 does not: answered before the server sees it.

A request is 8 bytes: command specifier in the three high bits of byte 0, index in bytes 1 and 2, subindex in byte 3.

Source: CiA 301 4.2, 7.2.4.3 (SDO protocols), 7.2.4.3.17 (abort codes).
"""

import struct
from typing import Final

import canopen
from canopen.objectdictionary import ODVariable

_DOWNLOAD, _UPLOAD, _BLOCK_UPLOAD, _BLOCK_DOWNLOAD = 1, 2, 5, 6  # client command specifiers that name an object
_NO_SUBINDEX: Final = 0x06090011  # SDO abort: subindex does not exist
_NO_SUCH_COMMAND: Final = 0x05040001  # SDO abort: command specifier not valid
_ABORT: Final = 0x80


def refusal(dictionary: canopen.ObjectDictionary, request: bytes) -> bytes | None:
    """Return the abort for a request of 8 bytes that is not to be served; None for all others.

    The server finds a variable under any subindex, and answers a block upload with another protocol, which a client may
    allow (byte 5) or not.
    """
    command, index, subindex = request[0] >> 5, int.from_bytes(request[1:3], "little"), request[3]
    if command not in (_DOWNLOAD, _UPLOAD, _BLOCK_UPLOAD, _BLOCK_DOWNLOAD):
        return None
    code = None
    if command == _BLOCK_UPLOAD and request[5] == 0:
        code = _NO_SUCH_COMMAND
    elif subindex and isinstance(dictionary.get(index), ODVariable):
        code = _NO_SUBINDEX
    return None if code is None else struct.pack("<BHBL", _ABORT, index, subindex, code)
