"""Frames and readings: golden bytes by hand, round trips, everything that is not a measurement, every fault."""

import math
import random
from pathlib import Path

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from cruise.can.codec import Codec, Decoded
from cruise.can.database import layouts
from cruise.can.frame import Frame, FrameFault
from cruise.can.messages import CONTRACTS
from cruise.can.settings import CanSettings, ProprietaryPgns, SourceAddresses
from cruise.signals import SIGNALS

DBC = Path(__file__).parents[2] / "config" / "cruise.dbc"
SETTINGS = CanSettings()
ANYBODY = CanSettings(addresses=SourceAddresses(**dict.fromkeys(SourceAddresses.__struct_fields__, None)))
LAYOUTS = {layout.name: layout for layout in layouts(DBC, SETTINGS)}
SIGNED = {contract.direction.speed for contract in CONTRACTS if contract.direction} - {"setpoint_mps"}
OPEN = math.nan


def codec(settings: CanSettings = SETTINGS) -> Codec:
    return Codec(LAYOUTS.values() if settings is SETTINGS else layouts(DBC, settings), settings.max_counter_step)


def frame(identifier: int, data: str, **more) -> Frame:
    return Frame(arbitration_id=identifier, data=bytes.fromhex(data), timestamp=12.5, **more)


def values(decoded: Decoded) -> dict[str, float]:
    assert decoded.fault is None
    return {reading.name: reading.value for reading in decoded.readings}


def fields():
    return [(layout, entry) for layout in LAYOUTS.values() for entry in layout.fields]


@pytest.mark.parametrize(
    ("identifier", "data", "message", "expected"),
    [
        # By hand from the SPN definitions: 1500 rpm / 0.125 = 12000 = 0x2EE0, low byte first, in bytes 4-5.
        (0x0CF00400, "FFFFFFE02EFFFFFF", "EEC1", {"engine_speed_rpm": 1500.0}),
        (0x0CF00300, "FFFF50FFFFFFFFFF", "EEC2", {"engine_load_pct": 80.0}),
        (0x18F00503, "FFFFFF7FFFFFFFFF", "ETC2", {"gear": 2.0}),  # 127 - 125
        (0x18F00503, "FFFFFF7CFFFFFFFF", "ETC2", {"gear": -1.0}),
        (0x18F00503, "FFFFFFFBFFFFFFFF", "ETC2", {"gear": OPEN}),  # park
        (0x0CFE48F0, "D007FFFFFFFFFFFD", "WBSD", {"wheel_speed_mps": 2.0}),
        (0x0CFE48F0, "D007FFFFFFFFFFFC", "WBSD", {"wheel_speed_mps": -2.0}),
        (0x0CFE48F0, "D007FFFFFFFFFFFF", "WBSD", {"wheel_speed_mps": OPEN}),  # moves, nobody knows which way
        (0x0CFE48F0, "0000FFFFFFFFFFFF", "WBSD", {"wheel_speed_mps": 0.0}),
        (0x0CFE49F0, "DC05FFFFFFFFFFFD", "GBSD", {"ground_speed_mps": 1.5}),
        (0x0CFE49F0, "DC05FFFFFFFFFFFE", "GBSD", {"ground_speed_mps": OPEN}),
        (0x0CFE49F0, "E02EFFFFFFFFFFFD", "GBSD", {"ground_speed_mps": 12.0}),
        (0x0CFE49F0, "E12EFFFFFFFFFFFD", "GBSD", {"ground_speed_mps": OPEN}),  # 12.001 m/s: no combine does that
        (0x0CF029E2, "0080 7F FFFFFFFFFF", "SSI2", {"pitch_deg": 5.0}),  # (5 + 250) * 32768 = 0x7F8000
        (0x0CF029E2, "0000FBFFFFFFFFFF", "SSI2", {"pitch_deg": OPEN}),
        (0x18FE68F0, "64FFFFFFFFFFFFFF", "VF", {"oil_temperature_c": 60.0}),  # 100 - 40
        (0x0CFD4331, "D007FFFFFFFFFFFD", "MachineSelectedSpeedCommand", {"setpoint_mps": 2.0}),
        (0x0CFD4331, "D007FFFFFFFFFFFF", "MachineSelectedSpeedCommand", {"setpoint_mps": 2.0}),
        (0x0CFD4331, "D007FFFFFFFFFFFE", "MachineSelectedSpeedCommand", {"setpoint_mps": OPEN}),  # an error
        (0x0CFD4331, "D007FFFFFFFFFFFC", "MachineSelectedSpeedCommand", {"setpoint_mps": -2.0}),  # for others to refuse
        (
            0x18FEF131,
            "FFFFFF1740FFFFFF",  # byte 4: 00 01 01 11; byte 5: 01 00 00 00
            "CCVS",
            {
                "cruise_enable": 1.0,
                "brake_pedal": 1.0,
                "clutch_pedal": 0.0,
                "cruise_set": 0.0,
                "cruise_coast": 0.0,
                "cruise_resume": 0.0,
                "cruise_accelerate": 1.0,
            },
        ),
        (
            0x0CF02211,
            "D007FFFFFFFFC345",  # exit reason 3 in byte 7; limited high (2), ground-based (1), forward (1) in byte 8
            "MachineSelectedSpeed",
            {"machine_selected_speed_mps": 2.0, "exit_reason": 3.0, "limit_status": 2.0, "speed_source": 1.0},
        ),
    ],
)
def test_bytes_by_hand(identifier, data, message, expected):
    decoded = codec().decode(frame(identifier, data))
    assert decoded.message == message
    assert values(decoded) == pytest.approx(expected, nan_ok=True)
    assert all(reading.time_s == 12.5 for reading in decoded.readings)


def test_encoded_bytes_by_hand():
    end = codec()
    assert end.encode("EEC1", {"engine_speed_rpm": 1500.0}, 1.0).data.hex() == "ffffffe02effffff"
    assert end.encode("WBSD", {"wheel_speed_mps": -2.0}, 1.0).data.hex() == "d007fffffffffffc"
    sent = end.encode("MachineSelectedSpeed", {"machine_selected_speed_mps": 2.0, "exit_reason": 3.0}, 1.5)
    assert (sent.data.hex(), sent.arbitration_id, sent.timestamp) == ("d007ffffffffc3fd", 0x0CF02211, 1.5)


def test_our_own_frames_by_hand():
    # (1.5 + 32) / 0.001 = 33500 = 0x82DC; (612.35 + 1600) / 0.05 = 44247 = 0xACD7; counter 0, spare bits ones
    sent = codec().encode("DriveFeedback", {"ground_speed_mps": 1.5, "pump_current_ma": 612.35}, 0.0)
    assert sent.arbitration_id == 0x0CFF1003
    assert sent.data[1:].hex() == "f0dc82d7acffff"
    # CRC-8 SAE J1850 (0x1D, init and last exclusive-or 0) over the data id, low byte first, and the rest
    crc = 0
    for byte in (0x10, 0x1C, *sent.data[1:]):
        crc ^= byte
        for _ in range(8):
            crc = crc << 1 & 0xFF ^ (0x1D if crc & 0x80 else 0)
    assert sent.data[0] == crc


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=lambda layout: layout.name)
@given(data=st.data())
def test_what_is_sent_is_what_is_read(layout, data):
    sent = {}
    for entry in layout.fields:
        high = min(entry.high, entry.scale * entry.last_valid + entry.offset)
        low = max(entry.low, -high if entry.name in SIGNED else entry.offset)
        sent[entry.name] = data.draw(st.floats(low, high) | st.just(math.nan))
    read = values(codec().decode(codec().encode(layout.name, sent, 3.0)))
    assert read.keys() == sent.keys()
    for entry in layout.fields:
        # Half a bit off at most, except at the edge of the range, which is not on a bit of every signal.
        value, bit = sent[entry.name], entry.scale * (0.5 + 1e-6)
        at_edge = not entry.low + bit <= value <= entry.high - bit
        assert read[entry.name] == pytest.approx(value, abs=bit, nan_ok=True) or (
            at_edge and math.isnan(read[entry.name])
        )


@pytest.mark.parametrize(("layout", "entry"), fields(), ids=lambda item: item.name)
def test_error_and_not_available_are_no_measurement(layout, entry):
    raw = dict.fromkeys(layout.blank, 0) | ({layout.direction.signal: 1} if layout.direction else {})
    for count in (entry.last_valid + 1, layout.blank[entry.name]):
        content = bytearray(layout.message.encode(raw | {entry.name: count}, scaling=False, strict=False))
        if layout.data_id is not None:
            p01.e2e_p01_protect(content, layout.data_id)
        read = values(codec().decode(Frame(arbitration_id=layout.arbitration_id, data=content)))
        assert math.isnan(read[entry.name]), count


@pytest.mark.parametrize(("layout", "entry"), fields(), ids=lambda item: item.name)
def test_a_value_that_does_not_fit_is_refused(layout, entry):
    high = entry.scale * entry.last_valid + entry.offset
    for value in (high + entry.scale, math.inf) + (() if entry.name in SIGNED else (entry.offset - entry.scale,)):
        if layout.direction is not None and entry.name == layout.direction.speed and value < 0:
            continue  # the sign goes into the direction
        with pytest.raises(ValueError, match=entry.name):
            codec().encode(layout.name, {entry.name: value}, 0.0)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="no message EEC9; known are EEC1"):
        codec().encode("EEC9", {}, 0.0)
    with pytest.raises(ValueError, match="EEC1 has no signal gear"):
        codec().encode("EEC1", {"gear": 1.0}, 0.0)


def test_every_known_signal_of_the_bus_has_a_message():
    assert {entry.name for _, entry in fields()} >= SIGNALS.keys()


def test_a_short_frame():
    for length in range(8):
        decoded = codec().decode(Frame(arbitration_id=0x0CF00400, data=bytes(length)))
        assert decoded == Decoded("EEC1", (), FrameFault.TOO_SHORT)


def test_another_source_address():
    assert codec().decode(frame(0x0CF00401, "FFFFFFE02EFFFFFF")) == Decoded("EEC1", (), FrameFault.WRONG_SOURCE)
    assert values(codec(ANYBODY).decode(frame(0x0CF00401, "FFFFFFE02EFFFFFF"))) == {"engine_speed_rpm": 1500.0}


def test_another_priority_is_the_same_message():
    assert codec().decode(frame(0x1CF00400, "FFFFFFE02EFFFFFF")).message == "EEC1"


@pytest.mark.parametrize(
    ("received", "fault"),
    [
        (Frame(arbitration_id=0x0CF00400, is_error_frame=True), FrameFault.ERROR_FRAME),
        (Frame(arbitration_id=0x0CF00400, is_remote_frame=True), FrameFault.REMOTE_FRAME),
        (Frame(arbitration_id=0x181, is_extended_id=False, data=bytes(8)), FrameFault.UNKNOWN),
        (Frame(arbitration_id=0x18FEEE00, data=bytes(8)), FrameFault.UNKNOWN),
        (Frame(arbitration_id=0x0DF00400, data=bytes(8)), FrameFault.UNKNOWN),  # the other data page: another PGN
    ],
)
def test_frames_that_are_none_of_ours(received, fault):
    assert codec().decode(received) == Decoded(None, (), fault)


def feedback(end: Codec) -> Frame:
    return end.encode("DriveFeedback", {"ground_speed_mps": 1.0, "pump_current_ma": 500.0}, 0.0)


def test_every_flipped_bit_of_a_protected_frame_is_found():
    for name in ("DriveFeedback", "MachineState", "PumpCurrentCommand"):
        sent = codec().encode(name, {}, 0.0)
        for bit in range(64):
            damaged = bytearray(sent.data)
            damaged[bit // 8] ^= 1 << bit % 8
            decoded = codec().decode(Frame(arbitration_id=sent.arbitration_id, data=damaged))
            assert decoded == Decoded(name, (), FrameFault.BAD_CRC)


def test_a_frame_protected_for_another_message_is_found():
    settings = CanSettings(pgns=ProprietaryPgns(drive_feedback=0xFF12, pump_current_command=0xFF10))
    swapped = feedback(codec(settings))
    swapped.arbitration_id = swapped.arbitration_id & ~0xFF | 0x11
    assert codec().decode(swapped) == Decoded("PumpCurrentCommand", (), FrameFault.BAD_CRC)


def test_the_counter_runs_from_0_to_14_and_the_library_agrees():
    end = codec()
    sent = [feedback(end) for _ in range(31)]
    assert [frame.data[1] & 15 for frame in sent] == [*range(15), *range(15), 0]
    assert all(p01.e2e_p01_check(frame.data, SETTINGS.data_ids.drive_feedback) for frame in sent)
    assert end.state.sent == {"DriveFeedback": 0}


def test_a_counter_that_stands_still_is_seen_every_time():
    sender, receiver = codec(), codec()
    sent = feedback(sender)
    assert receiver.decode(sent).fault is None
    for _ in range(20):
        assert receiver.decode(sent) == Decoded("DriveFeedback", (), FrameFault.COUNTER_REPEATED)
    assert receiver.decode(feedback(sender)).fault is None


@pytest.mark.parametrize("lost", range(14))
def test_lost_frames(lost):
    sender, receiver = codec(), codec()
    receiver.decode(feedback(sender))
    for _ in range(lost):
        feedback(sender)
    fault = receiver.decode(feedback(sender)).fault
    assert fault is (None if lost + 1 <= SETTINGS.max_counter_step else FrameFault.COUNTER_JUMPED)
    assert receiver.decode(feedback(sender)).fault is None, "in order again"


def test_a_frame_from_the_past_is_not_taken():
    sender, receiver = codec(), codec()
    old = feedback(sender)
    receiver.decode(feedback(sender))
    assert receiver.decode(old).fault is FrameFault.COUNTER_JUMPED


def test_the_counter_that_is_none():
    data = bytearray.fromhex("000fffffffffffff")
    p01.e2e_p01_protect(data, SETTINGS.data_ids.drive_feedback, increment_counter=False)
    assert data[1] & 15 == 15
    assert codec().decode(Frame(arbitration_id=0x0CFF1003, data=data)).fault is FrameFault.BAD_CRC


def test_a_damaged_frame_does_not_move_the_counter():
    sender, receiver = codec(), codec()
    receiver.decode(feedback(sender))
    damaged = feedback(sender)
    damaged.data[4] ^= 1
    before = dict(receiver.state.received)
    assert receiver.decode(damaged).fault is FrameFault.BAD_CRC
    assert receiver.state.received == before


def test_nothing_on_the_bus_makes_the_codec_raise():
    draw = random.Random(1)
    end = codec()
    ours = [layout.arbitration_id for layout in LAYOUTS.values()]
    seen = set()
    for _ in range(20_000):
        extended = draw.random() < 0.9
        identifier = draw.choice(ours) if extended and draw.random() < 0.8 else draw.getrandbits(29 if extended else 11)
        received = Frame(
            timestamp=draw.uniform(-1e9, 1e9),
            arbitration_id=identifier,
            is_extended_id=extended,
            is_remote_frame=draw.random() < 0.01,
            is_error_frame=draw.random() < 0.01,
            is_fd=draw.random() < 0.05,
            data=draw.randbytes(draw.choice((0, 1, 2, 7, 8, 8, 8, 8, 12, 64))),
        )
        decoded = end.decode(received)
        assert decoded.fault is None or decoded.readings == ()
        for reading in decoded.readings:
            known = SIGNALS.get(reading.name)
            assert math.isnan(reading.value) or known is None or known.low <= reading.value <= known.high
        seen.add(decoded.fault)
    assert seen >= {None, *FrameFault} - {
        FrameFault.COUNTER_REPEATED,
        FrameFault.COUNTER_JUMPED,
        FrameFault.WRONG_SOURCE,
    }
