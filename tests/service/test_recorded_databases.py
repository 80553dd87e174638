"""A log is read by its database, whosever it is; one that does not fit is refused with a reason."""

import numpy as np
import pytest

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.settings import CanSettings, SourceAddresses
from cruise.columns import ActiveWhen, ColumnSettings
from cruise.recording import RecordingError
from cruise.service.recordings import ReadingSettings, read_recording
from cruise.settings import SettingsError
from cruise.signals import OUTPUT, SIGNALS
from tests.service.logs import BY_DBC, DBC, START_S, STEP_S, drive, logged, speed_mps

FOREIGN = """VERSION ""
BS_:
BU_: Drive
BO_ 291 PumpState: 8 Drive
 SG_ amps : 0|16@1+ (0.001,0) [0|2] "A" Vector__XXX
 SG_ speed_kmh : 16|16@1- (0.01,0) [-40|40] "km/h" Vector__XXX
 SG_ safe : 32|1@1+ (1,0) [0|1] "" Vector__XXX
BO_ 2364540158 EEC1: 8 Drive
 SG_ EngSpeed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" Vector__XXX
BO_ 512 Header: 2 Drive
 SG_ page M : 0|8@1+ (1,0) [0|255] "" Vector__XXX
 SG_ height_mm m0 : 8|8@1+ (10,0) [0|2550] "mm" Vector__XXX
 SG_ reel_rpm m1 : 8|8@1+ (0.5,0) [0|127] "rpm" Vector__XXX
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2364540158 3;
"""


def test_a_foreign_database_gives_foreign_columns(tmp_path):
    (tmp_path / "foreign.dbc").write_text(FOREIGN)
    frames = []
    for k in range(81):
        t = START_S + k * STEP_S
        speed = round(360.0 * speed_mps(k * STEP_S)).to_bytes(2, "little", signed=True)
        data = (1000 * (k >= 40)).to_bytes(2, "little") + speed + bytes([k >= 20]) + bytes(3)
        frames.append(Frame(arbitration_id=291, is_extended_id=False, data=data, timestamp=t))
        engine = (0xFE00 if k == 30 else 16800).to_bytes(2, "little")
        eec1 = bytes(3) + engine + bytes(3)
        frames.append(Frame(arbitration_id=0x18F00421, data=eec1, timestamp=t))  # whoever sends it
        frames.append(Frame(arbitration_id=512, is_extended_id=False, data=bytes([k % 2, 30]), timestamp=t))
        frames.append(Frame(arbitration_id=512, is_extended_id=True, data=bytes([k % 2, 30]), timestamp=t))
    frames.append(Frame(arbitration_id=291, is_extended_id=False, data=b"\x01", timestamp=START_S + 4.0))
    settings = ReadingSettings(
        database=str(tmp_path / "foreign.dbc"),
        input="amps",
        columns={
            "amps": ColumnSettings(scale=1000.0),
            "speed_kmh": ColumnSettings(signal=OUTPUT, scale=1 / 3.6),
            "EngSpeed": ColumnSettings(signal="engine_speed_rpm"),
        },
        active_when=ActiveWhen(column="safe"),
    )
    read = read_recording(logged(tmp_path / "drive.blf", frames), settings)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s), atol=3e-3)
    np.testing.assert_allclose(read.input, 1000.0 * (np.arange(81) >= 40), atol=1e-9)
    np.testing.assert_allclose(read.columns["engine_speed_rpm"], 2100.0)  # 0xFE00 is "error": no measurement
    assert set(read.context()) == {"engine_speed_rpm"}
    np.testing.assert_allclose(read.columns["height_mm"][1:-1], 300.0)
    np.testing.assert_allclose(read.columns["reel_rpm"][1:-1], 15.0)
    assert "PumpState: 1 frames dropped, too short" in read.notes
    assert "81 frames of identifiers that the database does not describe: 0x00000200 (81)" in read.notes
    assert "EngSpeed: 1 of 81 values are no measurement" in read.notes
    assert any(note.startswith("message EEC1, signal engine_speed_rpm: missing") for note in read.notes)
    assert "input set to 0 in 20 of 81 readings: safe is not above 0.5" in read.notes


@pytest.mark.parametrize(
    ("settings", "error", "says"),
    [
        (ReadingSettings(), RecordingError, "needs its database; give the DBC file with --database"),
        (ReadingSettings(database="none.dbc"), SettingsError, "none.dbc: no such file"),
        (
            ReadingSettings(database="{dbc}", input="amps"),
            RecordingError,
            "no column 'amps' for input; it has ground_speed_mps, pump_current_ma",
        ),
        (
            ReadingSettings(database="{dbc}", can=CanSettings(addresses=SourceAddresses(transmission=5))),
            RecordingError,
            "no column 'pump_current_ma' for input.*DriveFeedback: 81 frames dropped, wrong source",
        ),
        (ReadingSettings(database="{foreign}"), RecordingError, "none of its .* frames can be taken; give the machine"),
    ],
)
def test_a_log_that_cannot_be_used_says_why(tmp_path, settings, error, says):
    (tmp_path / "foreign.dbc").write_text(FOREIGN.replace("2364540158", "2364540159").replace("EEC1", "EEC7"))
    named = (settings.database or "").format(dbc=DBC, foreign=tmp_path / "foreign.dbc") or None
    path = logged(tmp_path / "drive.log", drive(without=["SSI2"]))
    with pytest.raises(error, match=says):
        read_recording(path, ReadingSettings(input=settings.input, database=named, can=settings.can))


def test_every_signal_of_the_vocabulary_comes_through_a_log(tmp_path):
    codec = Codec.load(DBC, CanSettings())
    frames = []
    for k in range(81):
        for message, names in signals_of(codec).items():
            values = {name: believable(name) for name in names}
            frames.append(codec.encode(message, values, START_S + k * STEP_S))
    read = read_recording(logged(tmp_path / "all.log", frames), BY_DBC)
    assert set(read.columns) == set(SIGNALS)
    for name in SIGNALS:
        np.testing.assert_allclose(read.columns[name][1:-1], believable(name), atol=0.03, err_msg=name)


def believable(name: str) -> float:
    return max(1.0, SIGNALS[name].low) if name in SIGNALS else 1.0


def signals_of(codec: Codec) -> dict[str, list[str]]:
    """The names of all signals by message."""
    return {name: [field.name for field in layout.fields] for name, layout in codec._by_name.items()}
