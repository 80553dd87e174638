"""Our end of the kernel's bus: filters, times, error frames, an interface that goes down and comes back."""

import subprocess
import time

from cruise.can.bus import Filter, PatientBus, Sent, open_bus
from cruise.can.error_frames import BusHealth
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings
from tests.real_bus.conftest import BUS, ERROR, EXTENDED, Peer

SETTINGS = CanSettings(bus="socketcan", channel=BUS)


def soon() -> float:
    return time.monotonic() + 5.0


def link(state: str) -> None:
    subprocess.run(["ip", "link", "set", BUS, state], check=True)


def test_the_kernel_lets_pass_what_the_filters_name_and_stamps_it(peer: Peer):
    wanted = (Filter(0x00FF1000, 0x03FFFF00, True), Filter(0x211, 0x7FF, False))
    with open_bus(SETTINGS, filters=wanted) as bus:
        before_s = time.time()
        for identifier in (0x18FF1003 | EXTENDED, 0x18FF1103 | EXTENDED, 0x211, 0x212, 0x0CFF1077 | EXTENDED):
            peer.send(identifier, b"\x01\x02")
        frames = bus.drain()
        after_s = time.time()
    assert [(frame.arbitration_id, frame.is_extended_id) for frame in frames] == [
        (0x18FF1003, True),
        (0x211, False),
        (0x0CFF1077, True),
    ]
    times_s = [frame.timestamp for frame in frames]
    assert before_s <= times_s[0] <= times_s[-1] <= after_s, "the kernel's own time of arrival"


def test_what_is_sent_reaches_others_and_not_ourselves(peer: Peer):
    with open_bus(SETTINGS) as bus:
        assert bus.send(Frame(arbitration_id=0x18FF1203, data=b"\x07")) is Sent.SENT
        assert bus.drain() == []
    assert peer.hear(lambda identifier, data: True, 1.0) == (0x18FF1203 | EXTENDED, b"\x07")


def test_waiting_ends_at_the_deadline(peer: Peer):
    with open_bus(SETTINGS) as bus:
        begin_s = time.monotonic()
        assert bus.receive(begin_s + 0.1) is None
        assert 0.1 <= time.monotonic() - begin_s < 0.2


def test_error_frames_pass_every_filter_and_tell_the_health(peer: Peer):
    with open_bus(SETTINGS, filters=[Filter(0x211, 0x7FF, False)]) as bus:
        peer.send(ERROR | 0x004, bytes([0, 0x20, 0, 0, 0, 0, 0, 0]))
        assert bus.receive(soon()) is not None
        assert bus.health is BusHealth.PASSIVE
        peer.send(ERROR | 0x040, bytes(8))
        bus.receive(soon())
        assert bus.health is BusHealth.OFF
        peer.send(ERROR | 0x100, bytes(8))
        bus.receive(soon())
        assert bus.health is BusHealth.ACTIVE


def test_an_interface_that_goes_down_is_lost_and_comes_back(peer: Peer):
    bus = PatientBus(BUS, lambda: open_bus(SETTINGS))
    try:
        link("down")
        assert bus.receive(time.monotonic() + 0.3) is None
        assert bus.health is BusHealth.LOST
        assert bus.send(Frame(arbitration_id=0x1, is_extended_id=False)) is Sent.LOST
        link("up")
        deadline_s, heard = soon(), None
        late = Peer()
        while heard is None and time.monotonic() < deadline_s:
            late.send(0x123, b"\x01")
            heard = bus.receive(time.monotonic() + 0.1)
        assert heard is not None
        assert bus.health is BusHealth.ACTIVE
        late.socket.close()
    finally:
        link("up")
        bus.close()
