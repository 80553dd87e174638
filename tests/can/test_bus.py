"""The bus: order and time on the virtual one; waiting, a full queue and a lost interface on SocketCAN.

This needs no kernel with CAN: python-can's own SocketcanBus runs over a pair of connected UDP sockets on the loopback
interface, which like a CAN socket hand over one whole frame at a time with the kernel's time of arrival.
"""

import errno
import socket
import struct
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import ClassVar

import can
import pytest
from can.interfaces.socketcan import SocketcanBus, socketcan

from cruise.can import bus as bus_module
from cruise.can.bus import Bus, BusLostError, KernelBus, PatientBus, Sent, open_bus
from cruise.can.error_frames import BusHealth
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError

VIRTUAL = CanSettings(channel="test_bus")
KERNEL = CanSettings(bus="socketcan", channel="vcan7")
CAN_FRAME = struct.Struct("=IB3x8s")  # struct can_frame of linux/can.h


def frame(number: int, time_s: float = 0.0) -> Frame:
    return Frame(arbitration_id=0x18FF1000 + number, data=bytes([number]), timestamp=time_s)


def test_order_and_timestamps_on_the_virtual_bus():
    with open_bus(VIRTUAL) as a, open_bus(VIRTUAL) as b, open_bus(VIRTUAL) as c:
        for number in range(100):
            assert (a if number % 2 else b).send(frame(number, 0.25 * number)) is Sent.SENT
        got = c.drain()
        assert [(f.data[0], f.timestamp) for f in got] == [(number, 0.25 * number) for number in range(100)]
        assert [f.data[0] for f in a.drain()] == list(range(0, 100, 2)), "nobody hears itself"
        assert c.drain() == []


def test_a_received_frame_is_the_receivers_own():
    with open_bus(VIRTUAL) as a, open_bus(VIRTUAL) as b, open_bus(VIRTUAL) as c:
        a.send(frame(1, 5.0))
        b.drain()[0].timestamp = 99.0
        assert c.drain()[0].timestamp == 5.0


def test_channels_do_not_hear_each_other():
    with open_bus(VIRTUAL) as a, open_bus(CanSettings(channel="test_bus_2")) as b:
        a.send(frame(1))
        assert b.drain() == []


def test_closing_twice():
    bus = open_bus(VIRTUAL)
    bus.close()
    bus.close()


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[KernelBus, socket.socket]]:
    """A SocketCAN bus, and the socket at the other end of its wire."""
    near, far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    near.bind(("127.0.0.1", 0))
    far.bind(("127.0.0.1", 0))
    near.connect(far.getsockname())
    far.connect(near.getsockname())
    far.settimeout(5.0)
    monkeypatch.setattr(socketcan, "create_socket", lambda: near)
    monkeypatch.setattr(socketcan, "bind_socket", lambda sock, channel: None)
    bus = open_bus(KERNEL, connect=lambda interface, **options: SocketcanBus(**options))
    assert isinstance(bus, KernelBus)
    with bus, far:
        yield bus, far


def packed(number: int) -> bytes:
    return CAN_FRAME.pack(0x98FF1000 + number, 1, bytes([number]))


def soon() -> float:
    return time.monotonic() + 5.0


def test_sending_and_receiving(wire: tuple[KernelBus, socket.socket]):
    bus, far = wire
    assert bus.send(frame(3)) is Sent.SENT
    assert CAN_FRAME.unpack(far.recv(100)) == (0x98FF1003, 1, b"\x03" + bytes(7))
    far.send(packed(4))
    before = time.time()
    received = bus.receive(soon())
    assert received is not None
    assert (received.arbitration_id, received.data) == (0x18FF1004, b"\x04")
    assert abs(received.timestamp - before) < 5.0


def test_all_that_is_pending(wire: tuple[KernelBus, socket.socket]):
    bus, far = wire
    for number in range(20):
        far.send(packed(number))
    assert [f.data[0] for f in bus.drain()] == list(range(20))


def test_an_error_frame_is_handed_on(wire: tuple[KernelBus, socket.socket]):
    bus, far = wire
    far.send(CAN_FRAME.pack(0x20000040, 8, bytes(8)))  # CAN_ERR_FLAG | CAN_ERR_BUSOFF
    received = bus.receive(soon())
    assert received is not None
    assert received.is_error_frame


def error_frame(identifier: int, detail: int = 0) -> bytes:
    return CAN_FRAME.pack(0x20000000 | identifier, 8, bytes([0, detail, 0, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize(
    ("reported", "health"),
    [
        ([(0x004, 0x08)], BusHealth.WARNING),
        ([(0x004, 0x20)], BusHealth.PASSIVE),
        ([(0x004, 0x20), (0x004, 0x40)], BusHealth.ACTIVE),
        ([(0x040, 0)], BusHealth.OFF),
        ([(0x040, 0), (0x008, 0x80)], BusHealth.OFF),  # a single error of the protocol brings nobody back
        ([(0x040, 0), (0x100, 0)], BusHealth.ACTIVE),
        ([(0x008, 0x80), (0x020, 0), (0x004, 0x01)], BusHealth.ACTIVE),  # a bit, no acknowledgement, an overflow
    ],
)
def test_error_frames_tell_the_health_of_the_bus(wire, reported: list[tuple[int, int]], health: BusHealth):
    bus, far = wire
    for identifier, detail in reported:
        far.send(error_frame(identifier, detail))
    bus.drain()
    assert bus.health is health


@pytest.mark.parametrize("step_s", [-3600.0, 0.0, 3600.0])
def test_a_step_of_the_wall_clock_moves_no_deadline(wire, monkeypatch: pytest.MonkeyPatch, step_s: float):
    bus, _ = wire
    readings = iter([time.time()] + [time.time() + step_s] * 1000)
    monkeypatch.setattr("can.bus.time", lambda: next(readings))
    begin = time.monotonic()
    assert bus.receive(begin + 0.05) is None
    assert 0.05 <= time.monotonic() - begin < 2.0


@pytest.mark.parametrize("kind", ["virtual", "kernel"])
def test_a_deadline_in_the_past_takes_nothing(wire: tuple[KernelBus, socket.socket], kind: str):
    with open_bus(VIRTUAL) as a, open_bus(VIRTUAL) as b:
        bus: Bus = b if kind == "virtual" else wire[0]
        a.send(frame(1))
        wire[1].send(packed(1))
        assert bus.receive(time.monotonic()) is None
        assert bus.receive(soon()) is not None


def test_waiting_on_the_virtual_bus_ends():
    with open_bus(VIRTUAL) as bus:
        begin = time.monotonic()
        assert bus.receive(begin + 0.05) is None
        assert 0.05 <= time.monotonic() - begin < 2.0


class Broken:
    """A socket whose every call fails as the kernel would let it fail."""

    def __init__(self, real: socket.socket, code: int) -> None:
        self.real = real
        self.code = code

    def fileno(self) -> int:
        return self.real.fileno()

    def close(self) -> None:
        self.real.close()

    def send(self, data: bytes) -> int:
        raise OSError(self.code, "as the kernel says")

    def recvmsg(self, *sizes: int) -> tuple:
        raise OSError(self.code, "as the kernel says")


def test_a_full_transmit_queue_is_counted(wire: tuple[KernelBus, socket.socket]):
    bus, _ = wire
    bus._bus.socket = Broken(bus._bus.socket, errno.ENOBUFS)  # pyright: ignore[reportAttributeAccessIssue]
    assert [bus.send(frame(number)) for number in range(3)] == [Sent.NO_ROOM] * 3
    assert bus.no_room == 3


def test_a_socket_that_takes_nothing_is_counted(wire, monkeypatch: pytest.MonkeyPatch):
    bus, _ = wire
    monkeypatch.setattr(
        "can.interfaces.socketcan.socketcan.select.select", lambda reading, writing, other, timeout: ([], [], [])
    )
    assert bus.send(frame(1)) is Sent.NO_ROOM
    assert bus.no_room == 1


@pytest.mark.parametrize("code", [errno.ENODEV, errno.ENETDOWN, errno.ENXIO])
def test_a_lost_interface(wire: tuple[KernelBus, socket.socket], code: int):
    bus, far = wire
    bus._bus.socket = Broken(bus._bus.socket, code)  # pyright: ignore[reportAttributeAccessIssue]
    far.send(packed(1))
    for use in (lambda: bus.send(frame(1)), lambda: bus.receive(soon()), bus.drain):
        with pytest.raises(BusLostError, match=r"CAN interface vcan7.*`ip -details link show vcan7`") as caught:
            use()
        cause = caught.value.__cause__
        assert isinstance(cause, can.CanOperationError)
        assert isinstance(cause.__cause__, OSError)
        assert cause.error_code == code


@pytest.mark.parametrize(
    ("code", "advice"),
    [
        (errno.EAFNOSUPPORT, r"this kernel has no CAN .*modprobe can_raw"),
        (errno.EPROTONOSUPPORT, r"this kernel has no CAN .*modprobe can_raw"),
        (errno.ENODEV, r"no interface vcan7; .*type can bitrate 250000 .*ip link add vcan7 type vcan"),
        (errno.EPERM, r"interface vcan7 cannot be opened: not allowed"),
    ],
)
def test_what_the_user_has_to_set_up(code: int, advice: str):
    def connect(**options: object) -> can.BusABC:
        raise OSError(code, "not allowed")

    with pytest.raises(SettingsError, match=advice) as caught:
        open_bus(KERNEL, connect=connect)
    assert isinstance(caught.value.__cause__, OSError)


def test_the_kernel_at_hand_gives_a_bus_or_advice():
    """Either way nothing else than what is documented comes out: this machine has CAN, or it has not."""
    with pytest.raises(SettingsError, match=r"can\.(bus|channel): "):
        open_bus(CanSettings(bus="socketcan", channel="no_such_can"))


class Fleeting(Bus):
    """A bus that a test takes away and gives back; `opened` counts how often it was opened, `there` says whether."""

    there = True
    opened = 0
    waiting: ClassVar[list[can.Message]]

    def send(self, frame: can.Message) -> Sent:
        if not type(self).there:
            raise BusLostError("gone")
        return Sent.SENT

    def close(self) -> None:
        pass

    def _take(self, timeout_s: float) -> can.Message | None:
        if not type(self).there:
            raise BusLostError("gone")
        if type(self).waiting:
            return type(self).waiting.pop(0)
        bus_module.time.sleep(timeout_s)
        return None


def test_a_bus_that_went_away_is_opened_again_after_ever_longer_pauses(monkeypatch: pytest.MonkeyPatch):
    class Ours(Fleeting):
        waiting: ClassVar[list[can.Message]] = []

    now_s, tries = 100.0, []

    def open_again() -> Bus:
        tries.append(round(now_s, 6))
        if not Ours.there and len(tries) > 1:
            raise SettingsError("no interface")
        return Ours("vcan7")

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds

    class Clock:
        monotonic = staticmethod(lambda: now_s)

    Clock.sleep = staticmethod(sleep)  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(bus_module, "time", Clock)
    bus = PatientBus("vcan7", open_again)
    assert bus.send(frame(1)) is Sent.SENT
    Ours.there = False
    assert bus.send(frame(1)) is Sent.LOST
    assert bus.health is BusHealth.LOST
    for _ in range(12):
        assert bus.receive(now_s + 1.0) is None
        assert bus.send(frame(1)) is Sent.LOST
    pauses = [round(later - earlier, 6) for earlier, later in pairwise(tries[1:])]
    assert tries[1] == 100.1
    assert pauses[:5] == [0.2, 0.4, 0.8, 1.6, 3.2]
    assert pauses[5:] == [5.0] * len(pauses[5:])
    Ours.there, Ours.waiting = True, []
    while len(tries) < 12 and bus.send(frame(1)) is Sent.LOST:
        bus.receive(now_s + 1.0)
    assert bus.health is BusHealth.LOST, "nothing has been heard yet"
    Ours.waiting = [frame(5)]
    heard = bus.receive(now_s + 1.0)
    assert heard is not None
    assert bus.health is BusHealth.ACTIVE
