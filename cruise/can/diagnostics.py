"""DM1, the active diagnostic trouble code: the worst one; a frame without one says that all is well.

It is sent once a second, and at once where the code changes, though not more than once a second for that.

    byte 1: lamps, two bits each (malfunction, red stop, amber warning, protect), byte 2: 0xFF (none flashes)
    bytes 3 to 6: SPN 19 bits, FMI 5 bits, conversion method 0, occurrences 7 bits (0x7F: not counted)

More than one code would take the transport protocol of J1939-21, which is not here.

Source: SAE J1939-73, 5.7.1 (DM1); SPN 520192 to 524287 are the maker's own.
"""

from dataclasses import dataclass
from typing import Final

from cruise.can import j1939
from cruise.can.frame import Frame

DM1: Final = 0xFECA  # PGN 65226
PERIOD_S: Final = 1.0
PRIORITY: Final = 6
_NOT_COUNTED: Final = 0x7F
_AMBER, _PROTECT = 0b01 << 2, 0b01


@dataclass(frozen=True, slots=True)
class TroubleCode:
    """What is wrong (SPN), how (FMI), and which lamp shows it."""

    spn: int
    fmi: int
    lamps: int


FAULT: Final = TroubleCode(520192, 31, _AMBER)  # cruise control in the state fault: condition exists
SIGNALS_MISSING: Final = TroubleCode(520193, 9, _PROTECT)  # what it drives by is missing: abnormal update rate


class Diagnostics:
    """Says the worst of the trouble codes that hold."""

    def __init__(self, address: int) -> None:
        self._identifier = j1939.identifier(DM1, PRIORITY, address)
        self._due_s = self._change_s = 0.0  # when it is sent whatever holds, and when a change is
        self._told: TroubleCode | None = None

    def ask(self) -> None:
        """Somebody wants to know now."""
        self._due_s = 0.0

    def tick(self, now_s: float, code: TroubleCode | None) -> list[Frame]:
        """Return DM1 where it is due."""
        changes = code != self._told and now_s >= self._change_s
        if now_s < self._due_s and not changes:
            return []
        self._due_s = now_s + PERIOD_S
        if changes:
            self._change_s = now_s + PERIOD_S
        self._told = code
        lamps, packed = 0, 0
        if code is not None:
            lamps = code.lamps
            packed = code.spn & 0xFFFF | (code.spn >> 16 & 0x7) << 21 | code.fmi << 16 | _NOT_COUNTED << 24
        data = bytes([lamps, 0xFF]) + packed.to_bytes(4, "little") + b"\xff\xff"
        return [Frame(timestamp=now_s, arbitration_id=self._identifier, data=data, is_rx=False)]
