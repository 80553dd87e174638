"""The CANopen node: boot-up, heartbeat, NMT, PDO and SDO by hand-written bytes of CiA 301, in lockstep on a bus."""

import math
import random
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from cruise.can.bus import open_bus
from cruise.can.frame import Frame
from cruise.can.node import CanopenNode, CanopenSettings, NodeStatus
from cruise.can.node_texts import NodeTexts
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError

EDS = Path(__file__).parents[2] / "config" / "cruise.eds"
STATUS = NodeStatus(ground_speed_mps=-1.5, followed_setpoint_mps=2.0, pump_current_ma=-612.35, engagement_state=2.0)
START, STOP, PRE_OPERATIONAL, RESET = "0111", "0211", "8011", "8111"  # for node 17 = 0x11


def node() -> CanopenNode:
    return CanopenNode.load(EDS, CanopenSettings(node_id=0x11))


def frame(identifier: int, data: str, time_s: float = 0.0) -> Frame:
    return Frame(arbitration_id=identifier, is_extended_id=False, data=bytes.fromhex(data), timestamp=time_s)


def sent(end: CanopenNode, now_s: float, status: NodeStatus = STATUS) -> list[tuple[int, str]]:
    frames = end.tick(now_s, status)
    assert all(f.timestamp == now_s and not f.is_extended_id for f in frames)
    return [(f.arbitration_id, f.data.hex()) for f in frames]


def started() -> CanopenNode:
    end = node()
    end.tick(0.0, STATUS)
    end.receive(frame(0, START))
    return end


def values(end: CanopenNode, received: Frame) -> dict[str, float]:
    return {reading.name: reading.value for reading in end.receive(received)}


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


def test_no_sdo_when_stopped():
    end = started()
    end.receive(frame(0, STOP))
    end.receive(frame(0x611, "4017100000000000"))
    assert [identifier for identifier, _ in sent(end, 0.01)] == []


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


def test_sdo():
    end = started()
    end.receive(frame(0x611, "4017100000000000"))  # upload of 0x1017: heartbeat time, 500 = 0x01F4
    assert (0x591, "4b171000f4010000") in sent(end, 0.01)
    end.receive(frame(0x611, "2b171000c8000000"))  # download of 200 ms
    assert (0x591, "6017100000000000") in sent(end, 0.02)
    beats = [now for now in range(3, 63) if (0x711, "05") in sent(end, 0.01 * now)]
    assert beats == pytest.approx([22, 42, 62], abs=1), "from the write on"
    end.receive(frame(0x611, "2b00210000000000"))  # the measured speed is not to be written
    assert (0x591, "8000210002000106") in sent(end, 1.0)
    end.receive(frame(0x611, "4000300000000000"))  # no such object
    assert (0x591, "8000300000000206") in sent(end, 1.1)


@pytest.mark.parametrize("command", [f"{specifier:02x}" for specifier in range(0, 256, 16)])
def test_the_first_request_may_be_any(command: str):
    end = started()
    end.receive(frame(0x611, f"{command}00000000000000"))
    answers = [data for identifier, data in sent(end, 0.01) if identifier == 0x591]
    assert answers == [] if command in ("80", "90") else len(answers) == 1
    end.receive(frame(0x611, "4017100000000000"))
    assert (0x591, "4b171000f4010000") in sent(end, 0.02), "it goes on answering"


def test_a_variable_has_one_subindex_only():
    end = started()
    for request in ("4017100100000000", "2b171001c8000000", "2117100102000000", "a017100121040000"):
        assert answered(end, request) == "8017100111000906"
    assert answered(end, "4017100000000000") == "4b171000f4010000", "what was refused changed nothing"
    assert answered(end, "4018100100000000") == "4318100100000000"
    assert answered(end, "4018100500000000") == "8018100511000906"


def test_a_block_upload_is_answered_by_another_only_where_the_client_allows_it():
    end = started()
    assert answered(end, "a017100021000000") == "8017100001000405"
    assert answered(end, "a017100021040000") == "4b171000f4010000", "data of up to 4 bytes"


def texts(end: CanopenNode, change: Callable[[str], None]) -> CanopenNode:
    made = {name: lambda: "control: {frame_s: 0.05}" for name in ("settings", "learned", "statistics")}
    end.describe(NodeTexts(made, lambda: None, lambda: None, lambda: True, change))
    return end


@pytest.mark.parametrize(
    "requests",
    [
        ["40002f0000000000", "6000000000000000", "1100000000000000"],  # a segment down in the middle of an upload
        ["40002f0000000000", "7000000000000000", "6000000000000000"],  # the toggle bit was wrong, which ends it
        ["40002f0000000000", "8000000000000405", "6000000000000000"],  # the client has ended it
        ["21002f0007000000", "0161616161616161", "1161616161616161"],  # it had its end
        ["21002f0007000000", "6000000000000000"],
    ],
)
def test_a_segment_of_no_transfer_is_refused(requests: list[str]):
    changes: list[str] = []
    end = texts(started(), changes.append)
    for request in requests[:-1]:
        end.receive(frame(0x611, request, time_s=1.0))
        end.answers()
    changes.clear()
    assert answered(end, requests[-1]) == "8000000001000405"
    assert changes == []


@pytest.mark.parametrize(
    ("last", "answer"),
    [
        ("1361616161616100", "3000000000000000"),  # 7 and 6 bytes
        ("1561616161610000", "80002f0013000706"),
        ("1161616161616161", "80002f0012000706"),
    ],
)
def test_a_download_has_to_have_the_bytes_that_were_announced(last: str, answer: str):
    changes: list[str] = []
    end = texts(started(), changes.append)
    assert answered(end, "21002f000d000000") == "60002f0000000000", "13 bytes"
    assert answered(end, "0061616161616161") == "2000000000000000"
    assert answered(end, last) == answer
    assert changes == (["a" * 13] if answer[0] == "3" else [])


def test_random_requests_and_what_nobody_began_raise_nothing():
    draw, end = random.Random(7), started()
    for k in range(20_000):
        end.receive(frame(0x611, draw.randbytes(8).hex(), 0.001 * k))
        end.receive(frame(0, START))


def test_a_download_without_an_end_is_cut_off():
    end = started()
    assert answered(end, "21002f0000000000") == "60002f0000000000", "a download of unknown length"
    toggled = [f"{0x10 * (k % 2):02x}20202020202020" for k in range(1000)]
    answers = [answered(end, one) for one in toggled]
    assert answers[0].startswith("20"), "collected"
    end_at = answers.index("8000000005000405")  # out of memory
    assert sum(len(one) // 2 for one in toggled[:end_at]) < 10_000
    assert set(answers[end_at + 1 :]) == {"8000000001000405"}, "that was the end of it"
    assert answered(end, "4017100000000000") == "4b171000f4010000", "it goes on answering"
    assert answered(end, "21002f0000000000") == "60002f0000000000", "and another one may begin"
    assert answered(end, toggled[0]).startswith("20")


def test_sdo_reads_what_pdos_carry():
    end = started()
    end.receive(frame(0x211, "d00701"))
    sent(end, 1.0)
    end.receive(frame(0x611, "4000200000000000"))
    end.receive(frame(0x611, "4000210000000000"))
    answers = [data for identifier, data in sent(end, 1.01) if identifier == 0x591]
    assert answers == ["4b002000d0070000", "4b00210024fa0000"]


def test_a_setpoint_by_sdo_counts_too():
    assert values(started(), frame(0x611, "2b002000e8030000")) == {"setpoint_mps": 1.0}


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


PANEL = 33


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


def answered(end: CanopenNode, request: str) -> str:
    end.receive(frame(0x611, request, time_s=1.0))
    return next(data for identifier, data in sent(end, 1.0) if identifier == 0x591)


def test_texts_and_commands_by_sdo():
    end, done, drives = started(), [], True
    end.describe(
        NodeTexts(
            texts={"settings": lambda: "a: 1\n", "learned": lambda: "{}", "statistics": lambda: "{}"},
            store=lambda: done.append("store"),
            restore=lambda: done.append("restore"),
            may_change=lambda: not drives,
        )
    )
    assert answered(end, "40002f0000000000") == "41002f0005000000", "five bytes to come"
    assert answered(end, "6000000000000000") == "05" + b"a: 1\n".hex() + "0000"
    assert answered(end, "4010100100000000") == "4310100101000000", "it stores on command"
    save, load = b"save".hex(), b"load".hex()
    assert answered(end, "23101001" + load) == "8010100120000008", "not its signature"
    assert done == []
    assert answered(end, "23101001" + save) == "8010100122000008", "not while it drives"
    assert answered(end, "23111001" + load) == "8011100122000008"
    drives = False
    assert answered(end, "23101001" + save) == "6010100100000000"
    assert answered(end, "23111001" + load) == "6011100100000000"
    assert done == ["store", "restore"]
    assert answered(end, "23002f00" + save) == "80002f0002000106", "read only where nobody takes it"
    assert answered(end, "23012f00" + save) == "80012f0002000106", "and what was learned always"
