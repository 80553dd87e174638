"""Start, reload, a frozen loop, a crash, stop: neutral in time each time, and driving again only when asked to.

One service lives through all of it, in this order.
"""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from cruise.can.log import read_log
from cruise.service.settings import CruiseSettings
from tests.real_bus import scene
from tests.real_bus.conftest import Peer
from tests.real_bus.scene import BY_WORD_WITHIN_S, NEUTRAL_WITHIN_S
from tests.real_bus.under_systemd.conftest import shown, systemctl
from tools.vcan import players

HEARTBEAT, COMMAND = 0x711, 0xFF1211  # CANopen node 17; PGN and source address of the pump current command
AGAIN_S = 21.0  # by then a service that was killed is up again, though the machine is slow
MOST_MEMORY_MB = 160.0


def main_pid() -> int:
    return int(shown("cruise", "MainPID"))


def gone(pid: int, within_s: float) -> bool:
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        if not Path(f"/proc/{pid}").exists():
            return True
        time.sleep(0.01)
    return False


# What happens to the process `pid`, and when. systemctl itself takes long in this machine: a request counts from when
# systemd has passed it on.


def stop(pid: int) -> float:
    stopping = subprocess.Popen(["systemctl", "stop", "cruise"])
    assert gone(pid, 5.0)
    at_s = time.monotonic()
    assert stopping.wait(5.0) == 0
    return at_s


def reload(pid: int) -> float:
    systemctl("reload", "cruise")
    return 1e-6 * float(shown("cruise", "StateChangeTimestampMonotonic"))


def freeze(pid: int) -> float:
    os.kill(pid, signal.SIGSTOP)
    return time.monotonic()


def crash(pid: int) -> float:
    os.kill(pid, signal.SIGSEGV)
    return time.monotonic()


def test_it_starts_neutral_with_what_its_unit_promises(
    installed, settings: CruiseSettings, peer: Peer, note: Callable[[str, float], None]
):
    begin_s = time.monotonic()
    starting = subprocess.Popen(["systemctl", "start", "cruise"])
    first = peer.hear(lambda identifier, data: identifier & 0xFFFFFF == COMMAND, 60.0)
    assert first is not None
    assert first[1][1] >> 4 & 0x3 == 0, "not active"
    assert peer.hear(lambda identifier, data: identifier == HEARTBEAT, 5.0) is not None
    note("systemd_start_emulated_s", time.monotonic() - begin_s)
    assert starting.wait(20.0) == 0
    systemctl("start", "cruise-recorder")
    pid = main_pid()
    assert (os.sched_getscheduler(pid), os.sched_getparam(pid).sched_priority) == (os.SCHED_FIFO, 50)
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines())
    assert int(status["Uid"].split()[0]) >= 1000
    assert int(status["CapEff"], 16) == 0
    assert int(status["Seccomp"]) == 2
    assert int(status["VmLck"].split()[0]) > 0
    memory_mb = int(status["VmRSS"].split()[0]) / 1024.0
    note("systemd_memory_mb", memory_mb)
    assert memory_mb <= MOST_MEMORY_MB


@pytest.mark.parametrize(
    ("happens", "within_s", "restarts"),
    [
        (reload, NEUTRAL_WITHIN_S, False),  # the settings are read before
        (freeze, NEUTRAL_WITHIN_S, True),
        (crash, NEUTRAL_WITHIN_S, True),
        (stop, BY_WORD_WITHIN_S, False),
    ],
)
def test_it_is_neutral_in_time_and_drives_again_only_when_asked_to(
    happens: Callable[[int], float],
    within_s: float,
    restarts: bool,
    settings: CruiseSettings,
    tmp_path: Path,
    note: Callable[[str, float], None],
):
    pid, count = main_pid(), int(shown("cruise", "NRestarts"))
    with players.killed_in_the_end() as start:
        machine = scene.begin(start, settings, tmp_path, AGAIN_S)
        machine.until_driven()
        fault_s = happens(pid)
        if restarts:
            assert gone(pid, 2.0), "killed by the watchdog, or by itself"
            note(f"systemd_gone_after_{happens.__name__}_ms", 1000.0 * (time.monotonic() - fault_s))
        neutral_after_s = machine.neutral_after_s(fault_s)
        assert neutral_after_s <= within_s
        note(f"systemd_neutral_after_{happens.__name__}_ms", 1000.0 * neutral_after_s)
        if happens is stop:
            assert shown("cruise", "ActiveState") == "inactive"
            return
        assert machine.drives_again()
    assert int(shown("cruise", "NRestarts")) == count + restarts
    assert (main_pid() != pid) is restarts


def test_what_was_learned_and_what_was_around_the_exits_is_kept():
    systemctl("stop", "cruise-recorder")
    kept = json.loads(Path("/var/lib/private/cruise/state").read_bytes().partition(b"\n")[2])
    assert kept["statistics"]["starts"] >= 3
    assert kept["statistics"]["engaged_s"] > 5.0
    frozen = sorted(Path("/var/lib/private/cruise-recorder").glob("exit-*.log.gz"))
    assert frozen
    assert sum(1 for file in frozen for _ in read_log(file)) > 1000
