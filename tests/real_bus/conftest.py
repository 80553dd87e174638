"""A bus of the kernel's, an independent end of it, and the service as a process of its own."""

import contextlib
import json
import os
import signal
import socket
import struct
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from msgspec import structs

from cruise.can.node import CanopenSettings
from cruise.cli.places import CONFIG
from cruise.cli.run import Running
from cruise.service import settings as service_settings
from cruise.service.daemon import Daemon
from cruise.service.notify import Notifier
from cruise.service.persistence import PersistenceSettings
from cruise.service.settings import CruiseSettings

BUS = os.environ.get("CRUISE_VCAN", "")
collect_ignore_glob = [] if BUS else ["test_*.py"]  # tests/test_real_bus.py runs them where the bus is

CAN_FRAME = struct.Struct("=IB3x8s")  # struct can_frame of linux/can.h
EXTENDED, ERROR = 0x80000000, 0x20000000


class Peer:
    """A raw CAN socket, of the kernel and Python's standard library: none of our code."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.bind((BUS,))

    def only(self, identifier: int, mask: int) -> None:
        """Have the kernel keep everything else away."""
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", identifier, mask))

    def send(self, identifier: int, data: bytes = b"") -> None:
        self.socket.send(CAN_FRAME.pack(identifier, len(data), data.ljust(8, b"\0")))

    def hear(self, wanted: Callable[[int, bytes], bool], within_s: float) -> tuple[int, bytes] | None:
        """Return the next frame that is wanted, None if none came."""
        deadline_s = time.monotonic() + within_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            self.socket.settimeout(left_s)
            try:
                identifier, length, data = CAN_FRAME.unpack(self.socket.recv(16))
            except TimeoutError:
                return None
            if wanted(identifier, data[:length]):
                return identifier, data[:length]
        return None


@pytest.fixture
def note() -> Callable[[str, float], None]:
    """Keep a figure for tools/bench, in the folder CRUISE_KEEP, where there is one."""

    def note(name: str, value: float) -> None:
        if folder := os.environ.get("CRUISE_KEEP"):
            with (Path(folder) / "figures.jsonl").open("a", encoding="utf-8") as out:
                out.write(json.dumps({name: value}) + "\n")

    return note


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.socket.close()


@pytest.fixture(scope="module")
def in_process() -> Iterator[Callable[[Callable[[], object]], int]]:
    """Run work in processes of their own; they are killed in the end. Forked: what is imported stays imported."""
    children: list[int] = []

    def start(work: Callable[[], object]) -> int:
        child = os.fork()
        if child == 0:
            code = 1
            try:
                work()
                code = 0
            finally:  # an error must not get into the tests' own frames
                if code:
                    traceback.print_exc()
                os._exit(code)
        children.append(child)
        return child

    yield start
    for child in children:
        with contextlib.suppress(ProcessLookupError, ChildProcessError):
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def ended(child: int, within_s: float) -> int:
    """Wait for a process and return its exit code."""
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.05)
    raise AssertionError(f"process {child} still runs after {within_s} s")


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> CruiseSettings:
    """Those of config/, on this bus, with a folder for what is kept."""
    found = service_settings.load(CONFIG / "cruise.yaml")
    folder = str(tmp_path_factory.mktemp("kept"))
    return structs.replace(
        found,
        can=structs.replace(found.can, bus="socketcan", channel=BUS),
        canopen=CanopenSettings(node_id=17, panel_node_id=33, panel_timeout_ms=300),
        persistence=PersistenceSettings(machine="A1", folder=folder),
    )


def serve(settings: CruiseSettings) -> None:
    """What `cruise run` does, until a signal."""
    Daemon(settings, Notifier(""), lambda line: None).run(Running(), lambda now_s: None)
