"""The CANopen node: boot-up, heartbeat, NMT, PDO and SDO by hand-written bytes of CiA 301, in lockstep on a bus."""

import math
import random
import threading
from pathlib import Path

import pytest

from cruise.can.bus import open_bus
from cruise.can.frame import Frame
from cruise.can.node import CanopenNode, CanopenSettings, NodeStatus
from cruise.can.node_texts import NodeTexts
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError
from tests.can.nodes import (
    EDS,
    PRE_OPERATIONAL,
    RESET,
    START,
    STATUS,
    STOP,
    answered,
    frame,
    node,
    sent,
    started,
    values,
)

PANEL = 33


def test_boot_up_then_heartbeat_every_half_second():
    end = node()
    assert sent(end, 0.0) == [(0x711, "00"), (0x711, "7f")]
    beats = [(k, sent(end, 0.1 * k)) for k in range(1, 21)]
    assert [(k, frames) for k, frames in beats if frames] == [(k, [(0x711, "7f")]) for k in (5, 10, 15, 20)]


def test_nmt():
    end = node()
    end.tick(0.0, STATUS)
    for command, state, beat in (
        (START, "OPERATIONAL", "05"),
        (STOP, "STOPPED", "04"),
        ("8000", "PRE-OPERATIONAL", "7f"),
    ):
        end.receive(frame(0, command))
        assert end.state == state
        assert end.neutral_requested == (state == "STOPPED")
        assert (0x711, beat) in sent(end, {"05": 1.0, "04": 2.0, "7f": 3.0}[beat])
    for other in ("0112", "5011", "ff11", "01", ""):  # another node, no command of CiA 301, too short
        end.receive(frame(0, other))
        assert end.state == "PRE-OPERATIONAL"


def test_a_reset_boots_again():
    end = started()
    end.receive(frame(0, RESET))
    assert sent(end, 0.05) == [(0x711, "00"), (0x711, "7f")]
    assert end.state == "PRE-OPERATIONAL"


@pytest.mark.parametrize("reset", [RESET, "8211"])  # of the node, of communication
def test_a_reset_forgets_what_a_master_wrote_about_communication(reset: str):
    end = node()
    end.tick(0.0, STATUS)
    end.receive(frame(0x611, "23161001fa001200", 1.0))  # 1016h:1, node 18 within 250 ms
    end.receive(frame(0x611, "2b17100000000000", 1.0))  # 1017h, no heartbeat
    end.receive(frame(0x712, "05", 1.0))
    sent(end, 2.0)
    assert end.neutral_requested
    end.receive(frame(0, reset, 2.0))
    sent(end, 2.1)
    assert not end.neutral_requested
    assert (0x711, "7f") in [one for k in range(1, 7) for one in sent(end, 2.1 + 0.1 * k)]
    end.receive(frame(0x611, "4016100100000000", 3.0))
    assert [one.data.hex() for one in end.answers()] == ["4316100100000000"]


def test_the_setpoint_comes_in():
    end = started()
    readings = end.receive(frame(0x211, "d00701", 4.5))  # 2000 = 0x07D0
    assert [(r.name, r.value, r.time_s) for r in readings] == [("setpoint_mps", 2.0, 4.5), ("cruise_enable", 1.0, 4.5)]


def test_a_setpoint_that_no_machine_has_is_for_others_to_refuse():
    assert values(started(), frame(0x211, "e12e01"))["setpoint_mps"] == pytest.approx(12.001)


@pytest.mark.parametrize("data", ["ffffff", "00fb02"])  # not available; the first raw value above all, switch state 2
def test_what_is_no_setpoint(data: str):
    assert all(math.isnan(value) for value in values(started(), frame(0x211, data)).values())


@pytest.mark.parametrize("command", [STOP, PRE_OPERATIONAL])
def test_no_pdo_unless_operational(command: str):
    end = started()
    end.receive(frame(0, command))
    assert values(end, frame(0x211, "d00701")) == {}
    assert not [f for f in sent(end, 5.0) if f[0] == 0x191]


def test_frames_that_are_not_taken():
    end = started()
    assert values(end, frame(0x211, "d007")) == {}
    assert values(end, frame(0x212, "d00701")) == {}
    extended = Frame(arbitration_id=0x211, data=bytes.fromhex("d00701"))
    assert values(end, extended) == {}


def test_the_status_goes_out_every_100_ms():
    end = started()
    # -1500 = 0xFA24, 2000 = 0x07D0, -12247 = 0xD029, state 2
    assert [sent(end, 0.05 * k) for k in range(1, 5)] == [
        [],
        [(0x191, "24fad00729d002")],
        [],
        [(0x191, "24fad00729d002")],
    ]


def test_a_status_that_is_not_known():
    unknown = NodeStatus(math.nan, math.nan, math.inf, math.nan)
    assert (0x191, "0080ffff0080ff") in sent(started(), 1.0, unknown)


def test_in_lockstep_on_a_bus_without_threads():
    settings = CanSettings(channel="test_node")
    end, seen, threads = node(), [], threading.active_count()
    with open_bus(settings) as bus, open_bus(settings) as master:
        for step in range(101):
            now_s = 0.01 * step
            if step == 20:
                master.send(frame(0, START, now_s))
            for received in bus.drain():
                end.receive(received)
            for outgoing in end.tick(now_s, STATUS):
                bus.send(outgoing)
            seen += [(round(f.timestamp, 2), f.arbitration_id) for f in master.drain()]
    assert [time_s for time_s, identifier in seen if identifier == 0x711] == [0.0, 0.0, 0.5, 1.0]
    times_s = [time_s for time_s, identifier in seen if identifier == 0x191]
    assert times_s == pytest.approx([0.1 * k for k in range(2, 11)])
    assert threading.active_count() == threads


@pytest.mark.filterwarnings("default")
def test_nothing_on_the_bus_makes_the_node_raise(caplog: pytest.LogCaptureFixture):
    caplog.set_level("CRITICAL")
    draw, end = random.Random(2), started()
    for k in range(5000):
        received = Frame(
            timestamp=0.001 * k,
            arbitration_id=draw.choice((0, 0x80, 0x211, 0x611, 0x611, 0x711, 0x7E4, draw.getrandbits(11))),
            is_extended_id=False,
            is_remote_frame=draw.random() < 0.05,
            is_error_frame=draw.random() < 0.05,
            data=draw.randbytes(draw.randint(0, 8)),
        )
        for reading in end.receive(received):
            assert math.isnan(reading.value) or 0.0 <= reading.value <= 64.255
        end.tick(0.001 * k, STATUS)
    assert end.state in ("PRE-OPERATIONAL", "OPERATIONAL", "STOPPED")


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[1400]", "[1401]", "not an EDS file that can be used"),
        ("0x21030010", "0x20000010", "pump_current_ma not mapped in TxPDO1_node17; map it"),
        ("[FileInfo]", "FileInfo", "not an EDS file that can be used"),
    ],
)
def test_an_eds_file_that_lacks_something(tmp_path: Path, old: str, new: str, complaint: str):
    path = tmp_path / "machine.eds"
    path.write_text(EDS.read_text().replace(old, new))
    with pytest.raises(SettingsError, match=complaint):
        CanopenNode.load(path, CanopenSettings())


@pytest.mark.filterwarnings("ignore:The 'warn' method:DeprecationWarning")  # of canopen itself
def test_an_eds_file_that_is_empty_or_missing(tmp_path: Path):
    (tmp_path / "empty.eds").touch()
    with pytest.raises(SettingsError, match=r"empty\.eds: not an EDS file that can be used: it describes no object"):
        CanopenNode.load(tmp_path / "empty.eds", CanopenSettings())
    with pytest.raises(SettingsError, match=r"none\.eds: cannot be read: No such file.* the setting `dictionary` name"):
        CanopenNode.load(tmp_path / "none.eds", CanopenSettings())


def watching(timeout_ms: int = 300) -> CanopenNode:
    end = CanopenNode.load(EDS, CanopenSettings(node_id=0x11, panel_node_id=PANEL, panel_timeout_ms=timeout_ms))
    end.tick(0.0, STATUS)
    end.receive(frame(0, START))
    return end


def emergencies(end: CanopenNode, now_s: float, status: NodeStatus = STATUS) -> list[str]:
    return [data for identifier, data in sent(end, now_s, status) if identifier == 0x91]


def test_the_panels_heartbeat_is_watched_from_the_first_one_on():
    end = watching()
    assert emergencies(end, 10.0) == []
    assert not end.neutral_requested
    end.receive(frame(0x700 + PANEL, "05", time_s=10.0))
    assert emergencies(end, 10.3) == []
    assert emergencies(end, 10.35) == ["3081110000000000"]
    assert end.neutral_requested
    assert emergencies(end, 10.4) == [], "told once"
    end.receive(frame(0x700 + PANEL + 1, "05", time_s=10.45))
    assert emergencies(end, 10.45) == [], "of another node"
    end.receive(frame(0x700 + PANEL, "05", time_s=10.5))
    assert emergencies(end, 10.55) == ["0000000000000000"]
    assert not end.neutral_requested


def test_a_fault_is_an_emergency_until_it_is_over():
    end = watching()
    fault = NodeStatus(0.0, math.nan, 0.0, 3.0)
    assert emergencies(end, 0.1, fault) == ["00ff810000000000"]
    assert end._node.get_data(0x1001, 0) == b"\x81"
    end.receive(frame(0x700 + PANEL, "05", time_s=1.0))
    assert emergencies(end, 2.0, fault) == ["3081910000000000"], "the register holds both"
    assert emergencies(end, 2.1) == [], "one is left"
    end.receive(frame(0x700 + PANEL, "05", time_s=2.2))
    assert emergencies(end, 2.3) == ["0000000000000000"]
    assert end._node.get_data(0x1001, 0) == b"\x00"


def test_object_1016h_names_the_node_to_watch_and_nobody_is_watched_by_default():
    end = started()
    end.receive(frame(0x700 + PANEL, "05", time_s=1.0))
    assert emergencies(end, 9.0) == []
    end.receive(frame(0x611, "23161001" + (PANEL << 16 | 200).to_bytes(4, "little").hex(), time_s=9.0))
    end.receive(frame(0x700 + PANEL, "05", time_s=10.0))
    assert emergencies(end, 10.3) == ["3081110000000000"]
    end.receive(frame(0x611, "2316100100000000", time_s=10.4))
    assert emergencies(end, 10.4) == ["0000000000000000"]


def test_an_entry_of_1016h_for_a_node_that_cannot_be_is_not_used():
    end = started()
    end.receive(frame(0x611, "23161001" + ((0x80 | PANEL) << 16 | 200).to_bytes(4, "little").hex(), time_s=9.0))
    end.receive(frame(0x700 + PANEL, "05", time_s=10.0))
    assert emergencies(end, 12.0) == []


def test_what_the_filters_let_pass_is_what_the_node_acts_on():
    end = watching()
    acts_on = {0x000, 0x211, 0x611, 0x700 + PANEL}
    passed = {
        identifier
        for identifier in range(0x800)
        if any(identifier & one.mask == one.identifier & one.mask for one in end.filters)
    }
    assert acts_on <= passed
    assert len(passed) == 3 + 0x100, "and the heartbeats of all nodes, for 1016h may name any"


def test_a_node_made_anew_has_a_time_of_its_own_and_nobody_elses_callbacks():
    end, told = started(), []
    end.describe(
        NodeTexts(
            texts={"settings": lambda: "old", "learned": lambda: "", "statistics": lambda: ""},
            store=lambda: None,
            restore=lambda: None,
            may_change=lambda: True,
            change=told.append,
        )
    )
    sent(end, 5000.0)
    other = end.anew()
    assert 0x711 in [identifier for identifier, _ in sent(other, 0.0)], "it boots up"
    beats = [identifier for k in range(1, 40) for identifier, _ in sent(other, 0.1 * k)].count(0x711)
    assert beats >= 3
    answered(other, "23002f00" + b"text".hex())
    assert told == []
