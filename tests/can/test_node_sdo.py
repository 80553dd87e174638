"""SDO of the CANopen node: what is served, and what canopen's server takes and CiA 301 does not."""

import random
from collections.abc import Callable

import pytest

from cruise.can.node import CanopenNode
from cruise.can.node_texts import NodeTexts
from tests.can.nodes import START, STOP, answered, frame, sent, started, values


def test_no_sdo_when_stopped():
    end = started()
    end.receive(frame(0, STOP))
    end.receive(frame(0x611, "4017100000000000"))
    assert [identifier for identifier, _ in sent(end, 0.01)] == []


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
