"""Any recording, opened by what it is: one known drive through every kind of file comes back as itself."""

import contextlib
import sqlite3
import sys
from collections.abc import Iterable
from pathlib import Path

import can
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from asammdf import MDF, Signal
from pyarrow import parquet

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.log import LogError, LogWriter
from cruise.can.settings import CanSettings, SourceAddresses
from cruise.csv_file import read_csv, write_csv
from cruise.recording import ActiveWhen, ColumnSettings, RecordingError
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.service.recordings import ReadingSettings, frames_of_log, is_log, measurement, read_recording
from cruise.settings import SettingsError
from cruise.signals import INPUT, OUTPUT, SIGNALS

DBC = Path(__file__).parents[2] / "config" / "cruise.dbc"
BY_DBC = ReadingSettings(database=str(DBC))
START_S = 1_700_000_000.0
STEP_S = 0.05
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


def current_ma(time_s):
    return 700.0 + 100.0 * np.floor(time_s)  # steps, as a held signal has them


def speed_mps(time_s):
    return 1.0 + 0.4 * time_s


def drive(seconds: float = 4.0, without: Iterable[str | None] = ()) -> list[Frame]:
    """The frames of a drive whose speed rises by 0.4 m/s each second and whose current by 100 mA, in steps."""
    codec = Codec.load(DBC, CanSettings())
    frames = []
    for k in range(round(seconds / STEP_S) + 1):
        t = k * STEP_S
        values = {OUTPUT: float(speed_mps(t)), INPUT: float(current_ma(t))}
        frames.append(codec.encode("DriveFeedback", values, START_S + t))
        if k % 2 == 0:
            frames.append(codec.encode("ETC2", {"gear": 2.0}, START_S + t))
            frames.append(codec.encode("GBSD", {OUTPUT: float(speed_mps(t)) + 0.5}, START_S + t))
        pitched = (t, t + 0.01, t + 0.02, t + 0.03, t + 0.04)
        frames += [codec.encode("SSI2", {"pitch_deg": at_s}, START_S + at_s) for at_s in pitched]
    return [frame for frame in frames if codec.decode(frame).message not in set(without)]


def logged(path: Path, frames: Iterable[Frame]) -> Path:
    if path.suffix == ".db":
        return stored(path, frames)
    if path.suffix == ".log":  # python-can's writer lifts times that run back
        with LogWriter.create(path) as writer:
            for frame in frames:
                writer.write(frame)
        return path
    with can.Logger(path) as logger:
        for frame in frames:
            logger(frame)
    return path


def stored(path: Path, frames: Iterable[Frame]) -> Path:
    """The table that python-can's SqliteWriter makes; its thread drops what is left when it is stopped."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute(
            "CREATE TABLE messages (ts REAL, arbitration_id INTEGER, extended INTEGER, remote INTEGER, error INTEGER, "
            "dlc INTEGER, data BLOB)"
        )
        rows = [
            (one.timestamp, one.arbitration_id, one.is_extended_id, False, False, one.dlc, bytes(one.data))
            for one in frames
        ]
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
    return path


def table() -> pd.DataFrame:
    time_s = STEP_S * np.arange(81)
    return pd.DataFrame({"time_s": time_s, INPUT: current_ma(time_s), OUTPUT: speed_mps(time_s), "gear": 2})


def assert_is_the_drive(read, atol: float) -> None:
    time_s = read.time_s - read.time_s[0]  # .asc and .trc count from their beginning
    assert read.dt_s == pytest.approx(STEP_S)
    assert len(read) == 81
    np.testing.assert_allclose(read.output, speed_mps(time_s), atol=atol)
    steady = np.abs(time_s - np.rint(time_s)) > 0.01  # a stamp that is rounded puts a step one sample late
    np.testing.assert_allclose(read.input[steady], current_ma(time_s)[steady], atol=0.03)


@pytest.mark.parametrize("ending", [".log", ".log.gz", ".asc", ".blf", ".trc", ".db", ".mf4"])
def test_a_log_in_any_format_is_the_drive(tmp_path, ending):
    read = read_recording(logged(tmp_path / f"drive{ending}", drive()), BY_DBC)
    assert_is_the_drive(read, 2e-3)
    assert set(read.columns) == {INPUT, OUTPUT, "gear", "pitch_deg"}
    assert (read.columns["gear"][:-1] == 2.0).all()
    # five times as fast as the rest: the mean around the instant, so that nothing is shifted
    np.testing.assert_allclose(read.columns["pitch_deg"][2:-2], read.time_s[2:-2], atol=0.006)
    assert read.notes == ("second sources of a signal, left out unless named: GBSD.ground_speed_mps",)


def test_a_table_in_any_format_is_the_drive(tmp_path):
    table().to_csv(tmp_path / "drive.csv", index=False)
    table().to_parquet(tmp_path / "drive.parquet", index=False)
    plain = read_csv(tmp_path / "drive.csv", BY_DBC)
    for name in ("drive.csv", "drive.parquet"):
        read = read_recording(tmp_path / name, BY_DBC)
        assert_is_the_drive(read, 1e-9)
        assert read.notes == ()
        assert read.stamps_s is not None
        np.testing.assert_array_equal(read.stamps_s, table()["time_s"])
        for column in plain.columns:
            np.testing.assert_allclose(read.columns[column], plain.columns[column], atol=1e-9)


def test_a_log_goes_onto_a_coarser_grid_as_means(tmp_path):
    path = logged(tmp_path / "drive.log", drive())
    read = read_recording(path, BY_DBC, 0.2)
    assert read.dt_s == 0.2
    np.testing.assert_allclose(read.output, speed_mps(read.time_s - 0.1), atol=2e-3)
    np.testing.assert_allclose(read.columns["pitch_deg"], read.time_s - 0.1, atol=2e-3)


def test_the_samples_of_a_log_are_those_that_are_taken_online(tmp_path):
    frames = drive()
    for frame in frames:
        frame.timestamp += 0.013
    path, codec = logged(tmp_path / "drive.log", frames), Codec.load(DBC, CanSettings())
    sampler, online = StreamSampler(SamplingSettings()), []
    for frame in frames_of_log(path, []):
        while (until_s := 0.013 + 0.2 * (len(online) + 1)) < frame.timestamp - 1e-5:
            online.append(sampler.sample(until_s + 1e-6, 0.2))
        decoded = codec.decode(frame)
        for one in decoded.readings:
            if one.name != OUTPUT or decoded.message == "DriveFeedback":
                sampler.push(one.name, one.time_s, one.value)
    read = read_recording(path, BY_DBC, 0.2)
    assert len(read) == len(online) == 20
    for name, values in read.columns.items():
        np.testing.assert_allclose(values, [sample[name] for sample in online], atol=1e-3)


def test_times_of_a_log_start_at_zero_and_are_kept_as_they_were(tmp_path):
    read = read_recording(logged(tmp_path / "drive.log", drive()), BY_DBC)
    assert read.time_s[0] == 0.0
    assert read.stamps_s is not None
    np.testing.assert_allclose(read.stamps_s, STEP_S * np.arange(81), atol=1e-6)


def test_a_second_source_is_there_for_whoever_asks(tmp_path):
    path = logged(tmp_path / "drive.log", drive())
    asked = ReadingSettings(database=str(DBC), output="GBSD.ground_speed_mps")
    read = read_recording(path, asked)
    assert read.dt_s == pytest.approx(0.1)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s) + 0.5, atol=2e-3)
    # twice as fast, so a mean, whose last part is held as online: a quarter of its own step late at most
    np.testing.assert_allclose(read.columns["recorded_ground_speed_mps"], speed_mps(read.time_s), atol=0.011)
    only = read_recording(logged(tmp_path / "radar.log", radar_only()), BY_DBC)
    np.testing.assert_allclose(only.output, speed_mps(only.time_s) + 0.5, atol=2e-3)


def test_the_drives_own_speed_counts_however_seldom_it_comes(tmp_path):
    codec = Codec.load(DBC, CanSettings())
    frames = drive(without=["GBSD"])
    frames += [codec.encode("GBSD", {OUTPUT: 5.0}, START_S + 0.01 * k) for k in range(401)]
    frames.sort(key=lambda frame: frame.timestamp)
    assert_is_the_drive(read_recording(logged(tmp_path / "drive.log", frames), BY_DBC), 2e-3)


def radar_only() -> list[Frame]:
    """A log in which the drive's own message has a current and never a speed."""
    codec = Codec.load(DBC, CanSettings())
    frames = drive(without=["DriveFeedback"])
    frames += [codec.encode("DriveFeedback", {INPUT: 700.0}, START_S + k * STEP_S) for k in range(81)]
    return sorted(frames, key=lambda frame: frame.timestamp)


def test_the_command_stands_in_for_a_current_that_nobody_measured(tmp_path):
    codec = Codec.load(DBC, CanSettings())
    commands = []
    for k in range(81):
        values = {"pump_current_command_ma": 500.0 + k, "command_active": float(k >= 40)}
        commands.append(codec.encode("PumpCurrentCommand", values, START_S + k * STEP_S))
    frames = sorted([*drive(without=["DriveFeedback"]), *commands], key=lambda frame: frame.timestamp)
    read = read_recording(logged(tmp_path / "a.log", frames), BY_DBC, STEP_S)
    assert any("no measured current in the log" in note for note in read.notes)
    at = int(np.argmax(np.isfinite(read.input)))
    assert read.time_s[at] == pytest.approx(40 * STEP_S)
    assert read.input[at] == pytest.approx(540.0, abs=0.03)
    both = sorted([*drive(), *commands], key=lambda frame: frame.timestamp)
    measured = read_recording(logged(tmp_path / "b.log", both), BY_DBC)
    assert measured.input[10] == 700.0  # the measured one where there is one
    assert measured.columns["pump_current_command_ma"][10] == pytest.approx(510.0, abs=0.03)


def test_nothing_is_lost_in_silence(tmp_path):
    frames = drive(8.0)
    feedback = [frame for frame in frames if frame.arbitration_id & 0x00FFFF00 == 0x00FF1000]
    feedback[10].data[3] ^= 0xFF
    for frame in feedback[80:120]:
        frame.arbitration_id ^= 0x0F  # another sender
    frames.insert(70, Frame(arbitration_id=0x123, is_extended_id=False, timestamp=frames[70].timestamp))
    frames.insert(71, Frame(is_error_frame=True, timestamp=frames[71].timestamp))
    late = Codec.load(DBC, CanSettings()).encode("ETC2", {"gear": 1.0}, frames[300].timestamp - 0.5)
    frames.insert(300, late)
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC)
    notes = read.notes
    assert "1 frames: error frame" in notes
    assert "DriveFeedback: 1 frames dropped, bad crc" in notes
    assert "DriveFeedback: 40 frames dropped, wrong source" in notes
    assert "DriveFeedback: 1 frames dropped, counter jumped" in notes
    assert "1 frames of identifiers that the database does not describe: 0x123 (1)" in notes
    assert any(note.startswith("gear: 1 of ") and "out of order" in note for note in notes)
    assert any(note.startswith("ground_speed_mps: gap of 2.1 s at t=3.95 s") for note in notes)
    assert np.isnan(read.output[(read.time_s > 4.0) & (read.time_s < 6.0)]).all()
    assert (read.columns["gear"][:-1] == 2.0).all()


def test_a_clock_that_was_set_is_a_pause(tmp_path):
    frames = drive(8.0)
    for frame in frames[len(frames) // 2 :]:
        frame.timestamp -= 3600.0
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC)
    assert "taken as a pause of 5 s" in read.notes[0]
    assert read.time_s[-1] == pytest.approx(13.0, abs=0.1)


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


def test_too_few_frames_are_too_few(tmp_path):
    path = logged(tmp_path / "drive.log", drive(0.3))
    with pytest.raises(RecordingError, match="pump_current_ma has 7 readings, too few"):
        read_recording(path, BY_DBC)


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # python-can's readers, on files that are none
@pytest.mark.parametrize("ending", [".csv", ".parquet", ".mf4", ".log", ".log.gz", ".asc", ".blf", ".trc", ".db"])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00rubbish\n" * 50])
def test_rubbish_and_absence_under_every_name(tmp_path, ending, content):
    path = tmp_path / f"a{ending}"
    with pytest.raises((RecordingError, LogError), match="no such file"):
        read_recording(path, BY_DBC)
    path.write_bytes(content)
    with pytest.raises((RecordingError, LogError), match=f"^{path}"):
        read_recording(path, BY_DBC)


@pytest.mark.parametrize("name", ["drive.txt", "drive", "drive.csv.gz", "drive.xlsx", ".log"])
def test_an_unknown_ending_is_refused_with_those_that_are_known(tmp_path, name):
    (tmp_path / name).write_text("time_s\n")
    with pytest.raises(RecordingError, match=r"recordings end in \.csv \.parquet .*save it as one of these"):
        read_recording(tmp_path / name, BY_DBC)


def test_endings_in_capitals_are_the_same(tmp_path):
    table().to_csv(tmp_path / "DRIVE.CSV", index=False)
    assert_is_the_drive(read_recording(tmp_path / "DRIVE.CSV", BY_DBC), 1e-9)


@pytest.mark.parametrize(("name", "package"), [("a.parquet", "pyarrow"), ("a.mf4", "asammdf")])
def test_a_package_that_is_not_installed_is_named(tmp_path, monkeypatch, name, package):
    (tmp_path / name).write_bytes(b"x")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RecordingError, match=rf"files need {package}; install it: pip install {package}, or .* extra"):
        read_recording(tmp_path / name, BY_DBC)


def test_parquet_takes_every_kind_of_number_and_says_what_is_none(tmp_path):
    frame = table()
    parquet.write_table(
        pa.table(
            {
                "time_s": pa.array((1e6 * frame["time_s"]).round().astype("int64"), pa.timestamp("us")),
                INPUT: pa.array(frame[INPUT], pa.float32()),
                OUTPUT: pa.array([None if k == 5 else f"{v:.6f}" for k, v in enumerate(frame[OUTPUT])]),
                "gear": pa.array(frame["gear"], pa.int8()).dictionary_encode(),
                "brake_pedal": pa.array([False] * 81),
                "operator": pa.array(["Anna"] * 81),
                "spectrum": pa.array([[1.0, 2.0]] * 81),
                "__index_level_0__": pa.array(range(81)),
            }
        ),
        tmp_path / "drive.parquet",
    )
    read = read_recording(tmp_path / "drive.parquet", BY_DBC)
    assert_is_the_drive(read, 1e-6)
    assert set(read.columns) == {INPUT, OUTPUT, "gear", "brake_pedal"}
    assert read.notes == (
        "spectrum: holds list<element: double>, no measurement, left out",
        "__index_level_0__: holds int64, no measurement, left out",
        "ground_speed_mps: 1 of 81 cells hold no number, not measured",
        "operator: holds no number, left out",
    )


def test_a_parquet_row_is_named_where_time_runs_back(tmp_path):
    frame = table()
    frame.loc[7, "time_s"] = 0.1
    frame.to_parquet(tmp_path / "drive.parquet")
    with pytest.raises(RecordingError, match=r"drive\.parquet, row 8: time runs backwards, from 0\.3 s to 0\.1 s"):
        read_recording(tmp_path / "drive.parquet", BY_DBC)
    with pytest.raises(RecordingError, match=r"drive\.parquet: no column 'amps' for input; it has time_s, "):
        read_recording(tmp_path / "drive.parquet", ReadingSettings(input="amps"))
    (tmp_path / "folder.parquet").mkdir()
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(tmp_path / "folder.parquet", BY_DBC)


def measured(path: Path, *further: Signal) -> Path:
    """An MDF file with decoded signals as channels: the current at 100 Hz, the speed in km/h at 20 Hz."""
    fast_s, slow_s = 0.01 * np.arange(401), STEP_S * np.arange(81)
    with MDF() as file:
        file.append([Signal(current_ma(fast_s), fast_s, name="I_pump", unit="mA")])
        file.append(
            [
                Signal(3.6 * speed_mps(slow_s), slow_s, name="v_veh", unit="km/h"),
                Signal(300.0 + slow_s, slow_s, name="header_height_mm"),
            ]
        )
        for signal in further:
            file.append([signal])
        file.save(path)
    return path


MAPPED = ReadingSettings(
    input="I_pump", columns={"v_veh": ColumnSettings(signal=OUTPUT, scale=1 / 3.6)}, database=str(DBC)
)


def test_a_measurement_is_its_channels_by_the_mapping(tmp_path):
    read = read_recording(measured(tmp_path / "m.mf4"), MAPPED)
    assert read.dt_s == pytest.approx(STEP_S)  # the slower one's
    np.testing.assert_allclose(read.output, speed_mps(read.time_s), atol=1e-9)
    steady = np.abs(read.time_s - np.rint(read.time_s)) > 0.03
    np.testing.assert_allclose(read.input[steady], current_ma(read.time_s)[steady])
    np.testing.assert_allclose(read.columns["header_height_mm"], 300.0 + read.time_s, atol=1e-9)
    assert read.notes == ()


def test_channels_that_are_no_numbers_or_come_twice_are_noted(tmp_path):
    time_s = 0.5 * np.arange(9)
    states = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"}
    path = measured(
        tmp_path / "m.mf4",
        Signal(np.array([b"Anna"] * 9), time_s, name="operator", encoding="utf-8"),
        Signal(np.ones(9, dtype="u1"), time_s, name="clutch_pedal", conversion=states),
        Signal(np.full(9, 99.0), time_s, name="v_veh"),
    )
    read = read_recording(path, MAPPED)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s), atol=1e-9)
    assert (read.columns["clutch_pedal"][:-1] == 1.0).all()
    assert read.notes == (
        "v_veh: in 2 groups of the file, taken where it has most readings",
        "operator: holds no numbers, left out",
    )


def test_of_thousands_of_channels_only_the_named_ones_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(measurement, "FURTHER_CHANNELS", 3)
    time_s = STEP_S * np.arange(81)
    names = ["pitch_deg", *(f"ecu_{k}" for k in range(4))]
    path = measured(tmp_path / "m.mf4", *(Signal(time_s, time_s, name=name) for name in names))
    read = read_recording(path, MAPPED)
    assert set(read.columns) == {INPUT, OUTPUT, "pitch_deg"}
    assert read.notes == (
        "5 channels that nobody named are left out, such as header_height_mm, ecu_0, ecu_1; "
        "name in columns those that may matter",
    )


def test_a_measurement_without_the_channel_lists_those_it_has(tmp_path):
    path = measured(tmp_path / "m.mf4")
    with pytest.raises(RecordingError, match=r"no column 'pump_current_ma' for input; it has I_pump, v_veh, header"):
        read_recording(path, BY_DBC)


def test_frames_in_a_measurement_count_where_no_channel_is_named(tmp_path):
    logged(tmp_path / "bus.mf4", drive())
    slow_s = STEP_S * np.arange(81)
    with MDF(tmp_path / "bus.mf4") as file:
        file.append([Signal(900.0 + slow_s, slow_s, name="I_pump"), Signal(slow_s, slow_s, name="v_veh")])
        file.save(tmp_path / "both.mf4")
    assert is_log(tmp_path / "both.mf4", BY_DBC)
    assert_is_the_drive(read_recording(tmp_path / "both.mf4", BY_DBC), 2e-3)
    assert not is_log(tmp_path / "both.mf4", MAPPED)
    read = read_recording(tmp_path / "both.mf4", MAPPED)
    np.testing.assert_allclose(read.output, read.time_s / 3.6, atol=1e-9)
    assert set(read.columns) == {INPUT, OUTPUT}


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


def test_what_is_written_as_csv_is_what_the_log_said(tmp_path):
    read = read_recording(logged(tmp_path / "drive.log", drive()), BY_DBC)
    write_csv(read, tmp_path / "drive.csv")
    again = read_recording(tmp_path / "drive.csv", BY_DBC)
    for name, values in read.columns.items():
        np.testing.assert_allclose(again.columns[name], values, atol=1e-9)
