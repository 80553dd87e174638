"""The decoder: our messages by their contracts, all others as the DBC file says, and nothing that raises."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.can.codec import Codec, Decoded
from cruise.can.decoder import Decoder
from cruise.can.frame import Frame, FrameFault
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError
from cruise.signals import Reading

DBC = Path(__file__).parents[2] / "config" / "cruise.dbc"
FURTHER = """
BO_ 2566840830 HeaderState: 8 Machine
 SG_ header_height_mm : 0|16@1+ (0.5,0) [0|32127] "mm" Cruise
 SG_ tilt_deg : 16|16@1- (0.01,0) [-300|300] "deg" Cruise
 SG_ reel_on : 32|2@1+ (1,0) [0|3] "" Cruise
 SG_ odd : 40|5@1+ (1,0) [0|31] "" Cruise

BO_ 2162556926 Addressed: 8 Machine
 SG_ load_pct : 0|8@1+ (1,-125) [-125|125] "%" Cruise

BO_ 1024 Plain: 2 Machine
 SG_ voltage_v : 0|16@1+ (0.001,0) [0|65] "V" Cruise

"""
J1939 = 'BA_ "VFrameFormat" BO_ 2566840830 3;\nBA_ "VFrameFormat" BO_ 2162556926 3;\nBA_ "VFrameFormat" BO_ 1024 0;\n'


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    """Our own file with three messages that no contract knows."""
    text = DBC.read_text().replace("BO_ 2364540158 EEC1", f"{FURTHER.strip()}\n\nBO_ 2364540158 EEC1")
    file = tmp_path_factory.mktemp("dbc") / "more.dbc"
    file.write_text(text.replace('BA_ "VFrameFormat"', J1939 + 'BA_ "VFrameFormat"', 1))
    return file


@pytest.fixture(scope="module")
def decoder(path) -> Decoder:
    return Decoder.load(path, CanSettings())


def frame(arbitration_id: int, data: bytes, extended: bool = True) -> Frame:
    return Frame(arbitration_id=arbitration_id, is_extended_id=extended, data=data, timestamp=2.0)


def values(decoded: Decoded) -> dict[str, float]:
    return {reading.name: reading.value for reading in decoded.readings}


def test_ours_are_the_codecs_matter(decoder):
    sent = Codec.load(DBC, CanSettings()).encode("DriveFeedback", {"pump_current_ma": 700.0}, 2.0)
    assert Reading("pump_current_ma", 2.0, 700.0) in decoder.decode(sent).readings
    sent.data[4] ^= 1
    assert decoder.decode(sent).fault is FrameFault.BAD_CRC
    assert "DriveFeedback" in decoder.ours
    assert "HeaderState" not in decoder.ours
    assert decoder.problems == ()


def test_a_frame_whose_counter_jumped_is_read_with_that_and_one_that_repeats_it_is_not(path):
    sender, decoder = Codec.load(DBC, CanSettings()), Decoder.load(path, CanSettings())
    frames = [sender.encode("DriveFeedback", {"pump_current_ma": 100.0 * k}, float(k)) for k in range(11)]
    assert decoder.decode(frames[0]).fault is None
    jumped = decoder.decode(frames[5])
    assert jumped.fault is FrameFault.COUNTER_JUMPED
    assert Reading("pump_current_ma", 5.0, 500.0) in jumped.readings
    assert decoder.decode(frames[5]) == Decoded("DriveFeedback", fault=FrameFault.COUNTER_REPEATED)
    frames[10].data[4] ^= 1
    assert decoder.decode(frames[10]) == Decoded("DriveFeedback", fault=FrameFault.BAD_CRC)


def test_a_further_j1939_message_comes_from_anybody_and_keeps_the_ranges_of_the_standard(decoder):
    data = (600).to_bytes(2, "little") + (-250).to_bytes(2, "little", signed=True) + bytes([0b01, 31, 0, 0])
    for source in (0xF0, 0x21):
        decoded = decoder.decode(frame(0x18FEE100 | source, data))
        assert decoded.message == "HeaderState"
        assert values(decoded) == {"header_height_mm": 300.0, "tilt_deg": -2.5, "reel_on": 1.0, "odd": 31.0}
    gone = values(decoder.decode(frame(0x18FEE1F0, b"\x00\xfb" + bytes([0, 0, 0b10, 0, 0, 0]))))
    assert gone["header_height_mm"] != gone["header_height_mm"]
    assert gone["reel_on"] != gone["reel_on"]
    assert values(decoder.decode(frame(0x18FEE1F0, b"\xff\xfa" + bytes(6))))["header_height_mm"] == 32127.5


def test_one_pgn_from_two_controllers_is_two_messages(path, tmp_path):
    """18FF2103 and 18FF2121; what a third sends by that PGN is neither. HeaderState, from 3E, comes from anybody."""
    two = "".join(
        f'BO_ {0x98FF2100 | address} From{name}: 8 Machine\n SG_ {signal} : 0|16@1+ (1,0) [0|64255] "" Cruise\n\n'
        for address, name, signal in ((0x03, "A", "header_mm"), (0x21, "B", "rotor_rpm"))
    )
    formats = "".join(f'BA_ "VFrameFormat" BO_ {0x98FF2100 | address} 3;\n' for address in (0x03, 0x21))
    text = path.read_text().replace("BO_ 2566840830 HeaderState", two + "BO_ 2566840830 HeaderState")
    file = tmp_path / "two.dbc"
    file.write_text(text.replace('BA_ "VFrameFormat"', formats + 'BA_ "VFrameFormat"', 1))
    both = Decoder.load(file, CanSettings())
    data = bytes([50, 0]) + bytes(6)
    assert values(both.decode(frame(0x18FF2103, data))) == {"header_mm": 50.0}
    assert values(both.decode(frame(0x0CFF2121, data))) == {"rotor_rpm": 50.0}
    assert both.decode(frame(0x18FF2140, data)).fault is FrameFault.UNKNOWN


def test_a_message_to_one_address_is_known_whatever_the_address(decoder):
    for destination in (0x11, 0x2C):
        decoded = decoder.decode(frame(0x00E5_0005 | destination << 8, bytes([225] * 8)))
        assert values(decoded) == {"load_pct": 100.0}


def test_what_is_not_j1939_has_no_reserved_values_and_one_identifier(decoder):
    assert values(decoder.decode(frame(1024, b"\xff\xff", extended=False))) == {"voltage_v": 65.535}
    assert decoder.decode(frame(1024, b"\xff\xff")).fault is FrameFault.UNKNOWN
    assert decoder.decode(frame(1025, b"\xff\xff", extended=False)).fault is FrameFault.UNKNOWN
    assert decoder.decode(frame(1024, b"\xff", extended=False)) == Decoded("Plain", fault=FrameFault.TOO_SHORT)


def test_a_message_of_ours_that_the_file_has_otherwise_is_named_and_read_as_it_is(path, tmp_path):
    file = tmp_path / "other.dbc"
    file.write_text(path.read_text().replace("engine_speed_rpm", "EngSpeed"))
    decoder = Decoder.load(file, CanSettings())
    assert len(decoder.problems) == 1
    assert decoder.problems[0].startswith("message EEC1, signal engine_speed_rpm: missing")
    assert values(decoder.decode(frame(0x0CF00400, bytes(3) + (16800).to_bytes(2, "little") + bytes(3)))) == {
        "EngSpeed": 2100.0
    }
    assert "EEC1" not in decoder.ours


def test_a_file_that_is_none_says_so(tmp_path):
    with pytest.raises(SettingsError, match=r"none\.dbc: no such file"):
        Decoder.load(tmp_path / "none.dbc", CanSettings())
    (tmp_path / "bad.dbc").write_text("BO_ x")
    with pytest.raises(SettingsError, match=r"bad\.dbc: not a DBC file that can be used"):
        Decoder.load(tmp_path / "bad.dbc", CanSettings())


@given(st.integers(0, 2**29 - 1), st.binary(max_size=8), st.booleans(), st.booleans(), st.booleans())
def test_no_frame_makes_it_raise(decoder, number, data, extended, error, remote):
    made = Frame(
        arbitration_id=number if extended else number & 0x7FF,
        is_extended_id=extended,
        is_error_frame=error,
        is_remote_frame=remote,
        data=None if remote else data,
        timestamp=1.0,
    )
    decoded = decoder.decode(made)
    assert decoded.fault is None or not decoded.readings


@given(st.sampled_from([0x18FEE1F0, 0x00E51105, 0x0CF00400]), st.binary(max_size=8))
def test_any_data_of_a_known_message_gives_readings_or_a_fault(decoder, number, data):
    decoded = decoder.decode(frame(number, data))
    assert decoded.message is not None
    assert bool(decoded.readings) != (decoded.fault is not None)
