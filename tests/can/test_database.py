"""The DBC file: what the standards say of it, and every way in which another one can be of no use."""

import re
from pathlib import Path

import cantools
import msgspec
import pytest
from cantools.database.can import Database

from cruise.can import j1939
from cruise.can.codec import Codec
from cruise.can.messages import CONTRACTS
from cruise.can.settings import CanSettings
from cruise.settings import SettingsError

DBC = Path(__file__).parents[2] / "config" / "cruise.dbc"
TEXT = DBC.read_text(encoding="ascii")

# PGN, priority, period in ms, {signal: SPN, first byte and bit as the standards count, bits, scale, offset}
STANDARD = {
    "EEC1": (61444, 3, 20, {"engine_speed_rpm": (190, 4, 1, 16, 0.125, 0)}),
    "EEC2": (61443, 3, 50, {"engine_load_pct": (92, 3, 1, 8, 1, 0)}),
    "ETC2": (61445, 6, 100, {"gear": (523, 4, 1, 8, 1, -125)}),
    "WBSD": (65096, 3, 100, {"wheel_speed_mps": (1862, 1, 1, 16, 1e-3, 0), "wheel_direction": (1864, 8, 1, 2, 1, 0)}),
    "GBSD": (65097, 3, 100, {"ground_speed_mps": (1859, 1, 1, 16, 1e-3, 0), "ground_direction": (1861, 8, 1, 2, 1, 0)}),
    "SSI2": (61481, 3, 10, {"pitch_deg": (4976, 1, 1, 24, 1 / 32768, -250)}),
    "VF": (65128, 6, 1000, {"oil_temperature_c": (1638, 1, 1, 8, 1, -40)}),
    "CCVS": (
        65265,
        6,
        100,
        {
            "cruise_enable": (596, 4, 3, 2, 1, 0),
            "brake_pedal": (597, 4, 5, 2, 1, 0),
            "clutch_pedal": (598, 4, 7, 2, 1, 0),
            "cruise_set": (599, 5, 1, 2, 1, 0),
            "cruise_coast": (600, 5, 3, 2, 1, 0),
            "cruise_resume": (601, 5, 5, 2, 1, 0),
            "cruise_accelerate": (602, 5, 7, 2, 1, 0),
        },
    ),
    "MachineSelectedSpeedCommand": (
        64835,
        3,
        100,
        {"setpoint_mps": (4310, 1, 1, 16, 1e-3, 0), "setpoint_direction": (4312, 8, 1, 2, 1, 0)},
    ),
    "MachineSelectedSpeed": (
        61474,
        3,
        100,
        {
            "machine_selected_speed_mps": (4305, 1, 1, 16, 1e-3, 0),
            "exit_reason": (5818, 7, 1, 6, 1, 0),
            "machine_selected_direction": (4309, 8, 1, 2, 1, 0),
            "speed_source": (4308, 8, 3, 3, 1, 0),
            "limit_status": (4307, 8, 6, 3, 1, 0),
        },
    ),
}


@pytest.fixture(scope="module")
def database() -> Database:
    loaded = cantools.database.load_file(DBC, strict=True)
    assert isinstance(loaded, Database)
    return loaded


@pytest.mark.parametrize("name", STANDARD)
def test_a_message_is_as_its_standard_says(database: Database, name: str):
    pgn, priority, period_ms, signals = STANDARD[name]
    message = database.get_message_by_name(name)
    assert message.frame_id == priority << 26 | pgn << 8 | 0xFE
    assert (message.cycle_time, message.length, message.protocol) == (period_ms, 8, "j1939")
    found = {
        signal.name: (
            signal.spn,
            signal.start // 8 + 1,
            signal.start % 8 + 1,
            signal.length,
            signal.conversion.scale,
            signal.conversion.offset,
        )
        for signal in message.signals
    }
    assert found == signals
    for signal in message.signals:
        assert f"SPN {signal.spn} " in (signal.comment or ""), signal.name


def test_every_message_has_its_contract_and_says_where_it_is_from(database: Database):
    assert {message.name for message in database.messages} == {contract.name for contract in CONTRACTS}
    assert all(message.comment and message.cycle_time for message in database.messages)
    assert all(signal.comment for message in database.messages for signal in message.signals)


def test_the_bus_is_not_overloaded(database: Database):
    bits = 8 * 8 + 67 + 29  # 29-bit frame of 8 bytes with its interframe space, every possible stuff bit in it
    load = sum(bits / (message.cycle_time or 1) * 1e3 for message in database.messages) / CanSettings().bitrate_bps
    assert load < 0.30


@pytest.mark.parametrize(("bits", "last"), [(2, 1), (3, 6), (4, 13), (6, 61), (8, 0xFA), (16, 0xFAFF), (24, 0xFAFFFF)])
def test_the_range_of_measurements(bits: int, last: int):
    assert j1939.last_valid(bits) == last


def test_a_width_without_such_a_range():
    with pytest.raises(ValueError, match="12 bits"):
        j1939.last_valid(12)


def refusal(tmp_path: Path, text: str) -> str:
    path = tmp_path / "machine.dbc"
    path.write_text(text, encoding="ascii")
    with pytest.raises(SettingsError) as caught:
        Codec.load(path, CanSettings())
    message = str(caught.value)
    assert all(line.startswith(f"{path}: ") for line in message.splitlines()), message
    return message.replace(f"{path}: ", "")


def without(text: str, block: str) -> str:
    """Drop a message with all that refers to it."""
    head = re.search(rf"BO_ (\d+) {block}:", text)
    assert head
    text = re.sub(rf"BO_ {head[1]} {block}:.*?\n\n", "", text, flags=re.DOTALL)
    return "".join(line for line in text.splitlines(keepends=True) if head[1] not in line)


@pytest.mark.parametrize("contract", CONTRACTS, ids=lambda contract: contract.name)
def test_each_message_is_missed(tmp_path: Path, contract):
    assert refusal(tmp_path, without(TEXT, contract.name)).startswith(f"message {contract.name}: missing; add it (BO_)")


@pytest.mark.parametrize(
    ("contract", "signal"),
    [(contract, name) for contract in CONTRACTS for name in (*contract.signals, *(["crc"] if contract.own else []))],
    ids=lambda item: item if isinstance(item, str) else item.name,
)
def test_each_signal_is_missed(tmp_path: Path, contract, signal: str):
    head, tail = TEXT.split(f" {contract.name}:", 1)
    broken = head + f" {contract.name}:" + tail.replace(f" SG_ {signal} :", " SG_ other :", 1)
    broken = "".join(
        line for line in broken.splitlines(keepends=True) if not re.match(r"(CM_ SG_|BA_ \"SPN\"|VAL_ )", line)
    )
    assert f"message {contract.name}, signal {signal}: missing; add it (SG_)" in refusal(tmp_path, broken)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("24|16@1+ (0.125,0)", "24|8@1+ (0.125,0)", "signal engine_speed_rpm: 8 bits wide, expected 16; correct"),
        ("24|16@1+ (0.125,0)", "24|16@1- (0.125,0)", "signal engine_speed_rpm: not a plain unsigned little-endian"),
        ("24|16@1+ (0.125,0)", "31|16@0+ (0.125,0)", "signal engine_speed_rpm: not a plain unsigned little-endian"),
        (" SG_ gear :", ' SG_ more : 0|8@1- (1,0) [0|0] "" X\n SG_ gear :', "ETC2, signal more: not a plain unsigned"),
        (
            " SG_ gear :",
            ' SG_ more M : 0|8@1+ (1,0) [0|0] "" X\n SG_ gear :',
            "ETC2, signal more: not a plain unsigned",
        ),
        ("EEC1: 8 Engine", "EEC1: 7 Engine", "message EEC1: 7 bytes long, expected 8"),
        ("2364540158", "2364540414", "message EEC1: PGN 61445, expected 61444; correct the identifier"),
        ("2364540158", "500", "message EEC1: not a J1939 broadcast"),
        (
            '0|16@1+ (0.001,0) [0|64.255] "m/s" Cruise\n SG_ setpoint_direction',
            '0|16@1+ (0.0036,0) [0|231.3] "km/h" Cruise\n SG_ setpoint_direction',
            "signal setpoint_mps: its unit is km/h, expected m/s; give scale and offset of a value in m/s",
        ),
        ("24|16@1+ (0.125,0)", "24|16@1+ (-0.125,8032)", "signal engine_speed_rpm: its scale is -0.125; give it one"),
        ("24|16@1+ (0.125,0)", "24|16@1+ (0,0)", "signal engine_speed_rpm: its scale is 0; give it one"),
        (
            '(0.05,-1600) [-1600|1612.75] "mA" Transmission',
            '(0.01,0) [0|642.55] "mA" Transmission',
            "signal pump_current_command_ma: holds 0 to 642.55 mA, has to hold -1500 to 1500; correct scale and offset",
        ),
        ("alive_counter : 8|4", "alive_counter : 12|4", "signal alive_counter: starts at bit 12, E2E profile 1 has it"),
    ],
)
def test_what_is_there_but_wrong(tmp_path: Path, old: str, new: str, complaint: str):
    text = TEXT.replace(old, new)
    if "alive" in old:
        text = text.replace("command_active : 12|2", "command_active : 8|2")
    assert complaint in refusal(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new"),
    [('"rpm"', '"1/min"'), ('"rpm"', '""'), ('"deg"', '"\N{DEGREE SIGN}"'), ('"" Cruise', '"bit" Cruise')],
)
def test_a_unit_may_be_spelt_otherwise_or_left_out(tmp_path: Path, old: str, new: str):
    path = tmp_path / "machine.dbc"
    path.write_text(TEXT.replace(old, new), encoding="cp1252")
    Codec.load(path, CanSettings())


def test_more_signals_in_a_message_than_are_needed(tmp_path: Path):
    path = tmp_path / "machine.dbc"
    more = ' SG_ torque_pct : 16|8@1+ (1,-125) [-125|125] "%" Cruise\n SG_ engine_speed_rpm :'
    path.write_text(TEXT.replace(" SG_ engine_speed_rpm :", more), encoding="ascii")
    codec = Codec.load(path, CanSettings())
    sent = codec.encode("EEC1", {"engine_speed_rpm": 1500.0}, 0.0)
    assert sent.data.hex() == "ffffffe02effffff"
    assert [reading.name for reading in codec.decode(sent).readings] == ["engine_speed_rpm"]


def test_all_problems_at_once(tmp_path: Path):
    text = without(without(TEXT, "EEC2"), "VF")
    assert len(refusal(tmp_path, text).splitlines()) == 2


@pytest.mark.parametrize(
    "text", ["", "model: arx3\n", TEXT[:3000], 'BO_ 1 A: 8 X\n SG_ b : 0|99@1+ (1,0) [0|1] "" X\n']
)
def test_a_file_that_is_no_dbc_file(tmp_path: Path, text: str):
    assert refusal(tmp_path, text)


def test_a_file_that_is_not_there(tmp_path: Path):
    with pytest.raises(SettingsError, match=r"none.dbc: no such file; give the path"):
        Codec.load(tmp_path / "none.dbc", CanSettings())
    with pytest.raises(SettingsError, match="cannot be read"):
        Codec.load(tmp_path, CanSettings())


@pytest.mark.parametrize(
    "settings",
    [
        {"pgns": {"drive_feedback": 0xFF12}},  # that of the command
        {"pgns": {"drive_feedback": 61444}},
        {"data_ids": {"drive_feedback": 0x3C12}},
        {"addresses": {"engine": 254}},
        {"addresses": {"motor": 0}},
        {"bus": "udp_multicast"},
    ],
)
def test_settings_that_cannot_be(settings: dict):
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(settings, CanSettings)
