"""The J1939 side of the running service, seen by the kernel's own J1939 sockets: address, DM1, selected speed."""

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator

import pytest

from cruise.can.address_claim import name_of
from cruise.service.settings import CruiseSettings
from tests.real_bus.conftest import BUS, Peer, ended, serve

SOL_CAN_J1939 = socket.SOL_CAN_BASE + socket.CAN_J1939  # linux/can/j1939.h
OURS, TESTER, EVERYBODY = 0x11, 0x80, 0xFF
CLAIMED, REQUEST, DM1, SELECTED_SPEED, COMMAND = 0xEE00, 0xEA00, 0xFECA, 0xF022, 0xFF12
WAIT_S = 5.0


class Kernel:
    """A J1939 socket that hears everything on the bus."""

    def __init__(self, address: int, name: int = socket.J1939_NO_NAME) -> None:
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_J1939)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self.socket.setsockopt(SOL_CAN_J1939, socket.SO_J1939_PROMISC, 1)
        self.socket.bind((BUS, name, socket.J1939_NO_PGN, address))

    def send(self, pgn: int, data: bytes, to: int = EVERYBODY) -> None:
        self.socket.sendto(data, (BUS, socket.J1939_NO_NAME, pgn, to))

    def hear(self, pgn: int, within_s: float = WAIT_S) -> tuple[int, bytes] | None:
        """Return sender and data of the next message with this PGN."""
        deadline_s = time.monotonic() + within_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            self.socket.settimeout(left_s)
            try:
                data, (_, _, heard, sender) = self.socket.recvfrom(2000)
            except TimeoutError:
                return None
            if heard == pgn:
                return sender, data
        return None


@pytest.fixture
def kernel() -> Iterator[Kernel]:
    kernel = Kernel(TESTER)
    yield kernel
    kernel.socket.close()


@pytest.fixture(scope="module")
def service(in_process: Callable, settings: CruiseSettings) -> int:
    return in_process(lambda: serve(settings))


def test_a_request_for_the_address_is_answered_with_our_name(kernel: Kernel, service: int, settings: CruiseSettings):
    assert kernel.hear(COMMAND, 30.0) is not None, "it is up"
    kernel.send(REQUEST, CLAIMED.to_bytes(3, "little"))
    assert kernel.hear(CLAIMED) == (OURS, name_of(settings.can.name).to_bytes(8, "little"))


def test_what_is_missing_is_a_trouble_code_and_the_speed_is_not_available(kernel: Kernel, service: int):
    sender, trouble = kernel.hear(DM1) or (0, b"")
    assert sender == OURS
    assert trouble[:2] == b"\x01\xff"
    assert trouble[2] | trouble[3] << 8 | (trouble[4] >> 5) << 16 == 520193
    assert trouble[4] & 0x1F == 9
    sender, speed = kernel.hear(SELECTED_SPEED) or (0, b"")
    assert sender == OURS
    assert speed[:2] == b"\xff\xff"


def test_a_larger_name_does_not_get_our_address(kernel: Kernel, service: int, peer: Peer):
    peer.send(0x98EEFF00 | OURS, (2**64 - 2).to_bytes(8, "little"))
    sender, _ = kernel.hear(CLAIMED) or (0, b"")
    assert sender == OURS
    answer = kernel.hear(CLAIMED, 0.5) or (OURS, b"")
    assert answer[0] == OURS
    assert kernel.hear(COMMAND) is not None


def test_a_smaller_name_gets_it_and_we_fall_silent(kernel: Kernel, service: int):
    other = Kernel(OURS, name=1)
    try:
        other.send(CLAIMED, (1).to_bytes(8, "little"))
        heard = [kernel.hear(CLAIMED), kernel.hear(CLAIMED)]
        assert (0xFE, True) in [(one[0], True) for one in heard if one], "cannot claim"
        assert kernel.hear(COMMAND, 0.5) is None
        assert kernel.hear(SELECTED_SPEED, 0.5) is None
    finally:
        other.socket.close()
    os.kill(service, signal.SIGTERM)
    assert ended(service, WAIT_S) == 0
