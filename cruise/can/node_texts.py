"""Objects of the CANopen node whose value is a text that the service makes when it is asked for: settings, what was
learned, statistics. The settings take a text too: those that are to change. And the commands of CiA 301 to store what
was learned and written, or to go back to the factory's and the file's.

Sources: CiA 301 4.2, 7.2.4.3.17 (SDO abort codes), 7.5.2.13 (object 1010h, "save") and 7.5.2.14 (object 1011h, "load").
"""

from collections.abc import Callable, Mapping
from typing import Final

import canopen
from canopen.objectdictionary import ODVariable

STORE, RESTORE = 0x1010, 0x1011
MAX_BYTES: Final = 2000  # of a text that is written; the loop stands still while it is read, 10 ms
TEXTS: Final = {"settings": 0x2F00, "learned": 0x2F01, "statistics": 0x2F02}
_SIGNATURES: Final = {STORE: b"save", RESTORE: b"load"}
_CANNOT_NOW: Final = 0x08000022  # SDO abort: because of the present device state
_CANNOT: Final = 0x08000020  # SDO abort: data cannot be transferred or stored
_READ_ONLY: Final = 0x06010002  # SDO abort: attempt to write a read only object
_TOO_LONG: Final = 0x06070012  # SDO abort: length of service parameter too high
_OUT_OF_RANGE: Final = 0x06090030  # SDO abort: invalid value for parameter


class NodeTexts:
    """Callbacks of a LocalNode. `may_change` is asked before anything is changed or taken away: not while it drives.

    `change` is handed what is written to the settings, None where they are read only; it raises ValueError, and has
    changed nothing, where that can't be. `store` raises it where nothing can be stored.
    """

    def __init__(
        self,
        texts: Mapping[str, Callable[[], str]],
        store: Callable[[], None],
        restore: Callable[[], None],
        may_change: Callable[[], bool],
        change: Callable[[str], None] | None = None,
    ) -> None:
        self._texts = {TEXTS[name]: text for name, text in texts.items()}
        self._commands = {STORE: store, RESTORE: restore}
        self._may_change, self._change = may_change, change

    def read(self, index: int, subindex: int, od: ODVariable) -> bytes | int | None:
        """Answer an SDO upload; None where the object is none of these."""
        if index in self._commands and subindex == 1:
            return 1  # stored, or restored, on command
        text = self._texts.get(index)
        return None if text is None else text().encode("ascii", "replace")

    def write(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        """Carry out an SDO download. Raises SdoAbortedError where it must not be."""
        command = self._commands.get(index)
        if command is not None:
            if bytes(data) != _SIGNATURES[index]:
                raise canopen.SdoAbortedError(_CANNOT)
            if not self._may_change():  # nor is stored then: the disk would hold up the loop
                raise canopen.SdoAbortedError(_CANNOT_NOW)
            _try(command, _CANNOT)
        elif index == TEXTS["settings"]:
            change = self._change
            if change is None:
                raise canopen.SdoAbortedError(_READ_ONLY)
            if not self._may_change():
                raise canopen.SdoAbortedError(_CANNOT_NOW)
            if len(data) > MAX_BYTES:
                raise canopen.SdoAbortedError(_TOO_LONG)
            _try(lambda: change(bytes(data).decode("ascii")), _OUT_OF_RANGE)


def _try(act: Callable[[], None], code: int) -> None:
    try:
        act()
    except ValueError as error:
        raise canopen.SdoAbortedError(code) from error
