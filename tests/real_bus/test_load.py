"""A bus full of random frames: they engage nobody, nothing crashes, and what could not be done in time is counted."""

import contextlib
import json
import os
import subprocess
import time
from pathlib import Path

from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.settings import CruiseSettings
from tests.real_bus.conftest import BUS, EXTENDED, Peer
from tests.real_bus.test_faults import COMMAND
from tools.vcan import players

LOAD_S = 60.0
# Ready to be engaged all the time: switch on, driving by hand, a setpoint given. Only the button is not pressed.
READY = Drive(
    seconds=LOAD_S,
    field=(FieldRow(at_s=0.0, engine_speed_setpoint_rpm=2100.0, gear=2, rolling_resistance=0.05),),
    operator=(OperatorRow(at_s=0.2, cruise_enable=1.0, setpoint_mps=1.4), OperatorRow(at_s=0.5, lever_pct=50.0)),
)
RANDOM = ["-I", "r", "-L", "r", "-D", "r", "-m"]  # 11 and 29 bits, data and remote frames
AIMED = ["-e", "-I", "CFF1003", "-L", "8", "-D", "r"]  # as if from the drive: they pass the filters, their CRC is wrong


def test_a_full_bus_engages_nobody_and_late_ticks_are_counted(
    settings: CruiseSettings, tmp_path: Path, peer: Peer, note
):
    def command(within_s: float) -> bytes | None:
        found = peer.hear(lambda identifier, data: True, within_s)
        return None if found is None else found[1]

    def serve() -> None:
        with contextlib.suppress(PermissionError):  # as systemd/cruise.service has it
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        players.service(settings, tmp_path / "known")

    peer.only(EXTENDED | COMMAND, EXTENDED | 0xFFFFFF)
    commands: list[bytes] = []
    with players.killed_in_the_end() as start:
        service = start(serve)
        assert command(30.0) is not None
        begin_s = time.monotonic() + 2.0
        start(lambda: players.combine(settings, READY, 1, begin_s, tmp_path / "truth"))
        start(lambda: players.operator(settings, READY, begin_s))
        time.sleep(6.0)
        load = [subprocess.Popen(["cangen", BUS, "-g", "0", "-i", *kind]) for kind in (RANDOM, AIMED)]
        deadline_s = time.monotonic() + LOAD_S
        while time.monotonic() < deadline_s:
            commands += [data for data in [command(1.0)] if data is not None]
        assert [one.poll() for one in load] == [None, None], "cangen ended early"
        for one in load:
            one.kill()
            one.wait()
        assert service.end() == 0
    known = players.read(tmp_path / "known", players.KNOWN)
    report = json.loads((tmp_path / "known.json").read_text(encoding="utf-8"))
    late, time_s, period_s = report["lateness"], known["time_s"], settings.control.frame_s
    assert "standby" in report["states"], "it was ready to be engaged"
    assert not {"engaging", "engaged", "commissioning"} & set(report["states"])
    assert commands
    assert not any(data[1] >> 4 & 0x3 == 1 for data in commands)
    assert abs(late["ticks"] + late["missed"] - (time_s[-1] - time_s[0]) / period_s) <= 3.0, (
        "each tick came or is counted"
    )
    for name in ("p50_ms", "p99_ms", "max_ms", "missed", "ticks"):
        note(f"full_bus_{name}", late[name])
