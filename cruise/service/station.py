"""The cruise control as a member of the J1939 bus: it claims its address, says what is wrong, refuses what it is asked
for and does not have, and speaks only while the address is its own.
"""

from cruise.can.address_claim import ADDRESS_CLAIMED, AddressClaim, Claim, name_of
from cruise.can.bus import Filter
from cruise.can.diagnostics import DM1, FAULT, SIGNALS_MISSING, Diagnostics, TroubleCode
from cruise.can.frame import Frame
from cruise.can.messages import CONTRACTS
from cruise.can.requests import EVERYBODY, REQUEST, Requests, asked
from cruise.can.settings import CanSettings
from cruise.control.engagement import State
from cruise.service.cruise_node import CruiseNode

FILTERS = tuple(Filter(pgn << 8, 0x03FF0000, True) for pgn in (REQUEST, ADDRESS_CLAIMED))  # whatever the destination


class Station:
    """The node with its address; without a fixed address (null in the settings) there is none to claim."""

    def __init__(self, node: CruiseNode, settings: CanSettings) -> None:
        address = settings.addresses.cruise
        self.node = node
        self.period_s = node.period_s
        self.address = None if address is None else AddressClaim(address, name_of(settings.name))
        self.diagnostics = None if address is None else Diagnostics(address)
        self.requests = None if address is None else Requests(address, (ADDRESS_CLAIMED, DM1, *_sent(settings)))

    @property
    def may_speak(self) -> bool:
        """Whether nobody else has our address."""
        return self.address is None or self.address.claim is Claim.HELD

    @property
    def lost(self) -> bool:
        """Whether another one has it."""
        return self.address is not None and self.address.claim is Claim.LOST

    @property
    def loss(self) -> str:
        """Who has our address instead, in words, and what to do; empty where nobody has."""
        address = self.address
        if address is None or address.taken_by is None:
            return ""
        if address.taken_by == address.name:
            return (
                f"address {address.address:#04x} is claimed by another with our very NAME: a second service on this "
                "bus? stop it, or give each a can.name.identity_number and an address of its own"
            )
        return (
            f"address {address.address:#04x} is lost to NAME {address.taken_by:016X}, smaller than ours, "
            f"{address.name:016X}; give one of both another address (can.addresses.cruise) and start again"
        )

    def begin(self) -> None:
        """There is a bus, which has heard nothing of us."""
        if self.address is not None:
            self.address.begin()

    def receive(self, frame: Frame) -> list[Frame]:
        """Take one frame in; returns the answer of the CANopen node, which has an address of its own."""
        if self.address is not None and self.diagnostics is not None and self.requests is not None:
            self.address.receive(frame)
            self.requests.receive(frame)
            request = asked(frame)
            if request is not None and request.pgn == DM1 and request.of in (self.address.address, EVERYBODY):
                self.diagnostics.ask()
        return self.node.receive(frame)

    def tick(self, now_s: float) -> list[Frame]:
        """One period on: what the node says, if it may."""
        return self._said(now_s, self.node.tick(now_s))

    def stop(self, now_s: float) -> list[Frame]:
        """The last frames."""
        return self._said(now_s, self.node.stop(now_s))

    def _said(self, now_s: float, frames: list[Frame]) -> list[Frame]:
        if self.address is None or self.diagnostics is None or self.requests is None:
            return frames
        claim, refusals = self.address.tick(now_s), self.requests.tick(now_s)
        if not self.may_speak:  # CANopen has addresses of its own
            return [*claim, *(frame for frame in frames if not frame.is_extended_id)]
        return [*claim, *frames, *refusals, *self.diagnostics.tick(now_s, self._trouble())]

    def _trouble(self) -> TroubleCode | None:
        if self.node.engagement.state is State.FAULT:
            return FAULT
        return SIGNALS_MISSING if self.node.missing else None


def _sent(settings: CanSettings) -> list[int]:
    """The PGNs that we send by ourselves, all the time."""
    ours = (contract for contract in CONTRACTS if contract.sender == "cruise")
    return [contract.pgn or getattr(settings.pgns, contract.own or "") for contract in ours]
