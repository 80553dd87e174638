"""Objects of the CANopen node whose value is a text that the service makes when it is asked for: settings, what was
learned, statistics. And the commands of CiA 301 to store what was learned or to go back to the factory's.

Source: CiA 301 4.2, 7.5.2.13 (object 1010h, "save") and 7.5.2.14 (object 1011h, "load").
"""

from collections.abc import Callable, Mapping
from typing import Final

import canopen
from canopen.objectdictionary import ODVariable

STORE, RESTORE = 0x1010, 0x1011
TEXTS: Final = {"settings": 0x2F00, "learned": 0x2F01, "statistics": 0x2F02}
_SIGNATURES: Final = {STORE: b"save", RESTORE: b"load"}
_CANNOT_NOW: Final = 0x08000022  # SDO abort: because of the present device state
_CANNOT: Final = 0x08000020  # SDO abort: data cannot be transferred or stored


class NodeTexts:
    """Callbacks of a LocalNode. `may_restore` is asked before anything is taken away from a machine that drives."""

    def __init__(
        self,
        texts: Mapping[str, Callable[[], str]],
        store: Callable[[], None],
        restore: Callable[[], None],
        may_restore: Callable[[], bool],
    ) -> None:
        self._texts = {TEXTS[name]: text for name, text in texts.items()}
        self._commands = {STORE: store, RESTORE: restore}
        self._may_restore = may_restore

    def read(self, index: int, subindex: int, od: ODVariable) -> bytes | int | None:
        """Answer an SDO upload; None where the object is none of these."""
        if index in self._commands and subindex == 1:
            return 1  # stored, or restored, on command
        text = self._texts.get(index)
        return None if text is None else text().encode("ascii", "replace")

    def write(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        """Carry out an SDO download. Raises SdoAbortedError where it must not be."""
        command = self._commands.get(index)
        if command is None:
            return
        if bytes(data) != _SIGNATURES[index]:
            raise canopen.SdoAbortedError(_CANNOT)
        if index == RESTORE and not self._may_restore():
            raise canopen.SdoAbortedError(_CANNOT_NOW)
        command()
