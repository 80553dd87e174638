"""What another controller asks us for, and DM1, byte by byte of J1939-21 and J1939-73."""

import pytest

from cruise.can.diagnostics import FAULT, SIGNALS_MISSING, Diagnostics
from cruise.can.frame import Frame
from cruise.can.requests import MOST, Requests

SOFTWARE, DM1, SPEED = 0xFEDA, 0xFECA, 0xF022  # PGNs


def request(destination: int, pgn: int, by: int = 0x26, **fields) -> Frame:
    return Frame(arbitration_id=0x18EA0000 | destination << 8 | by, data=pgn.to_bytes(3, "little"), **fields)


def answers(*frames: Frame) -> list[tuple[int, str]]:
    end = Requests(0x11, (DM1, SPEED))
    for frame in frames:
        end.receive(frame)
    sent = [(frame.arbitration_id, frame.data.hex()) for frame in end.tick(1.0)]
    assert end.tick(1.05) == []
    return sent


def test_what_we_do_not_have_is_refused_by_name_of_who_asked():
    refused = (0x18E8FF11, "01ffffff26dafe00")
    assert answers(request(0x11, SOFTWARE), request(0x11, SOFTWARE)) == [refused]
    other = (0x18E8FF11, "01ffffff27dafe00")
    assert answers(request(0x11, SOFTWARE), request(0x11, SOFTWARE, by=0x27)) == [refused, other]


@pytest.mark.parametrize(
    "frame",
    [
        request(0xFF, SOFTWARE),  # of everybody
        request(0x12, SOFTWARE),
        request(0x11, DM1),
        request(0x11, SPEED),
        request(0x11, SOFTWARE, is_remote_frame=True),
        request(0x11, SOFTWARE, is_error_frame=True),
        Frame(arbitration_id=0x18EA1126, data=b"\xda\xfe"),
        Frame(arbitration_id=0x611, data=bytes(8), is_extended_id=False),
    ],
)
def test_nothing_else_is(frame: Frame):
    assert answers(frame) == []


def test_a_flood_of_requests_does_not_become_one_of_refusals():
    assert len(answers(*(request(0x11, SOFTWARE + k) for k in range(1000)))) == MOST


def test_dm1_once_a_second_with_and_without_a_fault():
    end = Diagnostics(0x11)
    (well,) = end.tick(0.0, None)
    assert (well.arbitration_id, well.data.hex()) == (0x18FECA11, "00ff00000000ffff")
    assert end.tick(0.95, None) == []
    (fault,) = end.tick(1.0, FAULT)
    # SPN 520192 = 0x7F000: bytes 00 F0, then its three high bits above FMI 31
    assert fault.data.hex() == "04ff00f0ff7fffff"


def test_dm1_comes_at_once_where_the_code_changes_but_not_more_than_once_a_second_for_that():
    end, sent = Diagnostics(0x11), []
    codes = {5: FAULT, 10: None, 15: SIGNALS_MISSING}  # by tick, from then on
    code = None
    for k in range(60):
        code = codes.get(k, code)
        sent += [(k, frame.data[0]) for frame in end.tick(0.05 * k, code)]
    assert sent == [(0, 0), (5, 4), (25, 1), (45, 1)]


def test_dm1_comes_when_it_is_asked_for():
    end = Diagnostics(0x11)
    end.tick(0.0, None)
    end.ask()
    assert len(end.tick(0.05, None)) == 1
    assert end.tick(0.1, None) == []
