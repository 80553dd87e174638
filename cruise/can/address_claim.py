"""Our address on the J1939 bus: claimed once there is one, defended against larger names, given up to smaller ones.

    NAME = arbitrary << 63 | industry << 60 | system instance << 56 | system << 49 | function << 40
           | function instance << 35 | ECU instance << 32 | manufacturer << 21 | identity

The smaller NAME keeps a contested address. Ours is fixed: who loses it says so (cannot claim), and sends nothing more.

Source: SAE J1939-81, 4.2 (NAME), 4.5 (address claim, initialisation and contention).
"""

from enum import StrEnum
from typing import Final

from cruise.can import j1939
from cruise.can.frame import Frame
from cruise.can.requests import EVERYBODY, PRIORITY, asked
from cruise.can.settings import NameSettings

ADDRESS_CLAIMED: Final = 0xEE00  # PGN 60928
WAIT_S: Final = 0.25  # s after a claim before an address that anybody may take is used
_AT_ONCE: Final = (*range(128), *range(248, 254))  # addresses that are assigned to one function
_CANNOT_CLAIM_STEP_S: Final = 0.0006  # s, of the random delay of "cannot claim", 0 to 255 steps
_DESTINATION_MASK: Final = 0x03FF0000  # PDU1: the PGN without the destination in its low byte


class Claim(StrEnum):
    """What the address is worth."""

    WAITING = "waiting"
    HELD = "held"
    LOST = "lost"


def name_of(settings: NameSettings) -> int:
    """Return the NAME, 64 bits."""
    return (
        settings.industry_group << 60
        | settings.vehicle_system_instance << 56
        | settings.vehicle_system << 49
        | settings.function << 40
        | settings.function_instance << 35
        | settings.ecu_instance << 32
        | settings.manufacturer_code << 21
        | settings.identity_number
    )


class AddressClaim:
    """`receive` every frame, `tick` at any rate and send what it returns."""

    def __init__(self, address: int, name: int) -> None:
        self.address, self.name = address, name
        self.begin()

    def begin(self) -> None:
        """Claim it, on a bus that has not heard of it yet."""
        self.claim = Claim.WAITING
        self.taken_by: int | None = None  # NAME of who has it instead
        self._due_s: float | None = -1.0  # when a claim, or that there is none, is to be sent
        self._usable_s = 0.0

    def receive(self, frame: Frame) -> None:
        """Take any frame in; never raises."""
        if not frame.is_extended_id or frame.is_error_frame or frame.is_remote_frame:
            return
        request, data = asked(frame), bytes(frame.data)
        if request is not None and request.pgn == ADDRESS_CLAIMED:
            ours = request.of == self.address and self.claim is not Claim.LOST  # a lost one is the winner's
            if ours or request.of == EVERYBODY:
                self._answer(frame.timestamp)
        pgn = (frame.arbitration_id & _DESTINATION_MASK) >> 8
        if pgn == ADDRESS_CLAIMED and frame.arbitration_id & 0xFF == self.address and len(data) == 8:
            name = int.from_bytes(data, "little")
            if name <= self.name and self.claim is not Claim.LOST:
                self.claim, self.taken_by = Claim.LOST, name  # a second one with our very name is no better
            self._answer(frame.timestamp)

    def tick(self, now_s: float) -> list[Frame]:
        """Return the claim, or that there is none, where it is due."""
        if self.claim is Claim.WAITING and self._due_s is None and now_s >= self._usable_s:
            self.claim = Claim.HELD
        if self._due_s is None or now_s < self._due_s:
            return []
        if self._due_s < 0.0:
            self._usable_s = now_s if self.address in _AT_ONCE else now_s + WAIT_S
        self._due_s = None
        source = j1939.NULL_ADDRESS if self.claim is Claim.LOST else self.address
        identifier = j1939.identifier(ADDRESS_CLAIMED | EVERYBODY, PRIORITY, source)
        data = self.name.to_bytes(8, "little")
        return [Frame(timestamp=now_s, arbitration_id=identifier, data=data, is_rx=False)]

    def _answer(self, now_s: float) -> None:
        # "Cannot claim" waits for a time that differs from one to the next, or all losers would speak at once.
        lost = self.claim is Claim.LOST
        if self._due_s is None:
            self._due_s = now_s + (_CANNOT_CLAIM_STEP_S * (self.name % 256) if lost else 0.0)
