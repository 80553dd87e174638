"""The bus as the loop sees it: send, wait for a frame until a monotonic deadline, take all that is pending.

Within one process it is python-can's virtual bus, between processes a SocketCAN interface. Every wait ends at a time
of time.monotonic(): python-can's own waits count on the wall clock and stall when that is set back. What the kernel
has to say about a bus is sorted into three: no room for a frame now (`Sent.NO_ROOM`, counted), a bus that went away
(`BusLostError`), and what the user has to set up first (`SettingsError`). Bus-off and its like come as error frames and
are kept in `health`. Whoever drives by the bus holds it by a `PatientBus`, which opens it again after it went away.

Every cyclic frame is sent by the loop, none by the kernel's broadcast manager (python-can's `send_periodic`): what the
manager sends goes on when the loop stands still, and the silence of command and heartbeat is what others go by then.

Sources: Linux kernel documentation, networking/can.rst; python-can 4.6, SocketcanBus and VirtualBus.
"""

import errno
import queue
import select
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from enum import StrEnum
from types import TracebackType
from typing import Final, NamedTuple, Self

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.virtual import VirtualBus

from cruise.can.error_frames import BusHealth, health_after
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError

_NO_CAN: Final = {errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT, errno.ESOCKTNOSUPPORT}
_NO_ROOM: Final = {errno.ENOBUFS, errno.EAGAIN}
_NO_CODE: Final = (None, 0)  # python-can's "Transmit buffer full" carries none
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 5.0  # s between two tries to open a bus that went away


class Filter(NamedTuple):
    """Lets a frame pass whose identifier agrees with this one in the bits of the mask."""

    identifier: int
    mask: int
    extended: bool


class BusLostError(Exception):
    """The interface went down or away; the cause is kept. Nothing more comes from this Bus: close it, open another."""


class Sent(StrEnum):
    """What became of a frame."""

    SENT = "sent"
    NO_ROOM = "no_room"  # the transmit queue is full: nobody acknowledges, or more is sent than the bus carries
    LOST = "lost"  # there is no bus now; said by a PatientBus only


class Bus(ABC):
    """One end of a bus. A context manager; closing twice is no fault."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.no_room = 0  # frames that were not sent since the bus was opened
        self.health = BusHealth.ACTIVE

    @abstractmethod
    def send(self, frame: Frame) -> Sent:
        """Send without waiting. Raises BusLostError."""

    @abstractmethod
    def close(self) -> None:
        """Leave the bus."""

    @abstractmethod
    def _take(self, timeout_s: float) -> Frame | None:
        """Return the next frame within `timeout_s` >= 0, None if none came. Raises BusLostError."""

    def receive(self, deadline_s: float) -> Frame | None:
        """Return the next frame, or None once time.monotonic() has reached `deadline_s`. Raises BusLostError.

        A deadline in the past gives None even where frames wait: a flood of frames cannot hold up the loop.
        """
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            frame = self._take(left_s)
            if frame is not None:
                return frame
        return None

    def drain(self) -> list[Frame]:
        """Return all frames that wait, oldest first. Raises BusLostError."""
        frames = []
        while (frame := self._take(0.0)) is not None:
            frames.append(frame)
        return frames

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class LocalBus(Bus):
    """An end of a bus within this process; frames keep the timestamps that their senders gave them."""

    def __init__(self, bus: VirtualBus, name: str) -> None:
        super().__init__(name)
        self._bus = bus

    def send(self, frame: Frame) -> Sent:
        self._bus.send(frame)
        return Sent.SENT

    def close(self) -> None:
        self._bus.shutdown()

    def _take(self, timeout_s: float) -> Frame | None:
        try:
            return self._bus.queue.get(block=timeout_s > 0.0, timeout=timeout_s)
        except queue.Empty:
            return None


class KernelBus(Bus):
    """An end of a SocketCAN interface; frames carry the kernel's time of arrival, on the wall clock."""

    def __init__(self, bus: SocketcanBus, name: str) -> None:
        super().__init__(name)
        self._bus = bus

    def send(self, frame: Frame) -> Sent:
        try:
            self._bus.send(frame)
        except can.CanOperationError as error:
            if error.error_code in _NO_ROOM or error.error_code in _NO_CODE:
                self.no_room += 1
                return Sent.NO_ROOM
            raise self._lost(error) from error
        return Sent.SENT

    def close(self) -> None:
        self._bus.shutdown()

    def _take(self, timeout_s: float) -> Frame | None:
        ready, _, _ = select.select([self._bus], [], [], timeout_s)
        if not ready:
            return None
        try:
            frame = self._bus.recv(0.0)
        except can.CanOperationError as error:
            raise self._lost(error) from error
        if frame is not None and frame.is_error_frame:
            self.health = health_after(self.health, frame)
        return frame

    def _lost(self, error: can.CanOperationError) -> BusLostError:
        return BusLostError(f"CAN interface {self.name}: {error}; see `ip -details link show {self.name}`")


class PatientBus(Bus):
    """A bus that is opened again after it went away, after ever longer pauses. Once made it never raises.

    `health` is LOST until a frame has come again: a socket opens on an interface that is down, too. `at_once`: it has
    to be there in the beginning, or SettingsError is raised.
    """

    def __init__(self, name: str, open_again: Callable[[], Bus], at_once: bool = True) -> None:
        super().__init__(name)
        self.problem = ""  # why it could not be opened, the last time
        self._open = open_again
        self._bus: Bus | None = open_again() if at_once else None
        self.health = BusHealth.ACTIVE if at_once else BusHealth.LOST
        self._pause_s = FIRST_PAUSE_S
        self._next_s = 0.0

    def send(self, frame: Frame) -> Sent:
        if self._bus is None:
            return Sent.LOST
        try:
            sent = self._bus.send(frame)
        except BusLostError:
            self._lose()
            return Sent.LOST
        self.no_room += sent is Sent.NO_ROOM
        return sent

    def close(self) -> None:
        if self._bus is not None:
            self._bus.close()

    def _take(self, timeout_s: float) -> Frame | None:
        if self._bus is None:
            self._try_again(timeout_s)
            return None
        try:
            frame = self._bus._take(timeout_s)
        except BusLostError:
            self._lose()
            return None
        if frame is not None:
            self.health, self._pause_s = self._bus.health, FIRST_PAUSE_S
        return frame

    def _lose(self) -> None:
        self.close()
        self._bus, self.health = None, BusHealth.LOST
        self._pause()

    def _try_again(self, timeout_s: float) -> None:
        wait_s = self._next_s - time.monotonic()
        if wait_s > 0.0:
            time.sleep(min(wait_s, timeout_s))
            return
        try:
            self._bus, self.problem = self._open(), ""
        except SettingsError as error:
            self.problem = str(error)
            self._pause()

    def _pause(self) -> None:
        self._next_s = time.monotonic() + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)


def open_bus(
    settings: CanSettings, connect: Callable[..., can.BusABC] = can.Bus, filters: Sequence[Filter] = ()
) -> Bus:
    """Open the bus of the settings; of a kernel's, only frames that pass one of `filters` come, where there are any.

    Error frames always come. `connect` makes python-can's bus, for tests.

    Raises SettingsError where the kernel has no CAN or no such interface, with the command that helps.
    """
    name = settings.channel
    if settings.bus == "virtual":
        local = connect(interface="virtual", channel=name, preserve_timestamps=True)
        assert isinstance(local, VirtualBus)
        return LocalBus(local, name)
    wanted = [{"can_id": one.identifier, "can_mask": one.mask, "extended": one.extended} for one in filters] or None
    try:
        kernel = connect(interface="socketcan", channel=name, receive_own_messages=False, can_filters=wanted)
    except OSError as error:
        raise SettingsError(_remedy(settings, error)) from error
    assert isinstance(kernel, SocketcanBus)
    return KernelBus(kernel, name)


def _remedy(settings: CanSettings, error: OSError) -> str:
    name = settings.channel
    if error.errno in _NO_CAN:
        return (
            f"can.bus: this kernel has no CAN ({error.strerror}); load it with `modprobe can_raw` (and `modprobe vcan` "
            "for a bus without hardware); can.bus: virtual is inside this process, where nobody else hears it, as in "
            "`cruise demo`"
        )
    if error.errno == errno.ENODEV:
        return (
            f"can.channel: no interface {name}; with hardware `ip link set {name} up type can bitrate "
            f"{settings.bitrate_bps} restart-ms 100`, without `ip link add {name} type vcan && ip link set {name} up`"
        )
    return f"can.channel: interface {name} cannot be opened: {error.strerror or error}"
