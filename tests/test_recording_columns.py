"""Columns are named, scaled and chosen by settings; those that do not fit the file say so."""

import msgspec
import numpy as np
import pytest

from cruise.columns import ActiveWhen, ColumnSettings, RecordingSettings, arranged
from cruise.csv_file import read_csv
from cruise.recording import Readings, RecordingError
from cruise.signals import INPUT, OUTPUT
from tests.csv_files import PLAIN, csv_of, ramp


@pytest.mark.parametrize(
    ("most", "unit", "scale"),
    [
        (1.0, "A or a share of all", 1000.0),
        (2.9, "A or a share of all", 1000.0),
        (12.0, "V or tenths of all", 100.0),
        (95.0, "per cent", 10.0),
    ],
)
def test_an_input_that_is_no_current_counts_as_a_share_of_one(tmp_path, most, unit, scale):
    """Bounds and starts of the effects are in mA: a stop at 0.9 of the pedal would be below all of them."""
    rows = [f"{0.1 * k:.1f},{most * k / 40:.6g},{k / 10:.6g}" for k in range(41)]
    file = csv_of(tmp_path, rows, "time_s,pedal,ground_speed_mps")
    read = read_csv(file, RecordingSettings(input="pedal"))
    np.testing.assert_allclose(read.input, scale * most * np.arange(41) / 40, rtol=1e-5)
    assert f"read as {unit}, all of it as 1000 mA" in read.notes[0]
    assert "columns: {pedal: {scale: 1}}" in read.notes[0]
    said = RecordingSettings(input="pedal", columns={"pedal": ColumnSettings(scale=1.0)})
    np.testing.assert_allclose(read_csv(file, said).input, most * np.arange(41) / 40, rtol=1e-5)
    named = csv_of(tmp_path, rows, "time_s,pump_current_ma,ground_speed_mps")
    taken = read_csv(named, PLAIN)
    np.testing.assert_allclose(taken.input, most * np.arange(41) / 40, rtol=1e-5)
    (note,) = taken.notes
    assert f"if it is {unit}, columns: {{pump_current_ma: {{scale: {scale:g}}}}}" in note
    scaled = RecordingSettings(columns={INPUT: ColumnSettings(scale=scale)})
    np.testing.assert_allclose(read_csv(named, scaled).input, read.input, rtol=1e-5)
    assert read_csv(named, scaled).notes == ()


def test_per_cent_that_are_few_are_told_by_their_name(tmp_path):
    rows = [f"{0.1 * k:.1f},{0.3 * k:.6g},{k / 10}" for k in range(41)]
    read = read_csv(csv_of(tmp_path, rows, "time_s,duty_pct,ground_speed_mps"), RecordingSettings(input="duty_pct"))
    np.testing.assert_allclose(read.input, 3.0 * np.arange(41))
    assert read.input_unit == "per cent"


def test_an_input_with_times_of_its_own_counts_as_a_share_too():
    time_s = 0.1 * np.arange(41)
    columns = {"amps": Readings(time_s, 0.02 * np.arange(41)), OUTPUT: Readings(time_s, time_s)}
    read = arranged("made up", columns, RecordingSettings(input="amps"), None)
    np.testing.assert_allclose(read.input, 20.0 * np.arange(41))
    assert (
        "amps: 99 % of it is 0.792 at most, no current in mA moves a machine; read as A or a share of all"
        in read.notes[0]
    )
    in_ma = {"Drive.command_ma": columns["amps"], OUTPUT: columns[OUTPUT]}
    read = arranged("made up", in_ma, RecordingSettings(input="Drive.command_ma"), None)
    np.testing.assert_allclose(read.input, 0.02 * np.arange(41))
    assert "if it is A or a share of all, columns: {Drive.command_ma: {scale: 1000}}" in read.notes[0]
    said = RecordingSettings(input="amps", columns={"amps": ColumnSettings(scale=1.0)})
    np.testing.assert_allclose(arranged("made up", columns, said, None).input, 0.02 * np.arange(41))


def test_a_current_under_another_name_is_taken_as_it_is(tmp_path):
    rows = [f"{0.1 * k:.1f},{20 * k},{k / 10}" for k in range(41)]
    read = read_csv(csv_of(tmp_path, rows, "time_s,I_pump,ground_speed_mps"), RecordingSettings(input="I_pump"))
    assert read.notes == ()
    assert read.input[-1] == 800.0


def test_the_one_column_that_sounds_like_a_time_is_it_and_ms_are_read_as_such(tmp_path):
    rows = [f"{100 * k},{20 * k},{k / 10},{k}" for k in range(41)]
    read = read_csv(csv_of(tmp_path, rows, "timestamp_ms,pump_current_ma,ground_speed_mps,frame"), PLAIN)
    assert read.dt_s == pytest.approx(0.1)
    assert [note.partition(":")[0] for note in read.notes] == ["timestamp_ms", "timestamp_ms"]
    in_s = RecordingSettings(columns={"timestamp_ms": ColumnSettings(scale=1e-3)})
    assert len(read_csv(csv_of(tmp_path, rows, "timestamp_ms,pump_current_ma,ground_speed_mps,frame"), in_s).notes) == 1
    with pytest.raises(RecordingError, match="no column 'time_s' for time"):
        read_csv(csv_of(tmp_path, rows, "time_ms,pump_current_ma,ground_speed_mps,gps_time"), PLAIN)


@pytest.mark.parametrize(
    ("header", "taken"),
    [
        ("ms_today,pump_current_ma,ground_speed_mps,gps_time,setup_ms", "ms_today"),
        ("Seconds,pump_current_ma,ground_speed_mps,gps_time,x", "Seconds"),
        ("n,pump_current_ma,ground_speed_mps,gps_time,delay_ms", "gps_time"),
        ("t_s,pump_current_ma,ground_speed_mps,oil_t,x", "t_s"),
        ("t [s],pump_current_ma,ground_speed_mps,oil_t_s,x", "t [s]"),
        ("T,pump_current_ma,ground_speed_mps,gps_time,x", "T"),
        ("Seconds,pump_current_ma,ground_speed_mps,x,y,Time", "Seconds"),
    ],
)
def test_what_sounds_like_a_time_and_rises_with_every_row_goes_before_what_does_not(tmp_path, header, taken):
    """Beside the clock of a logger stand times that come more rarely, such as that of the last position."""
    step = 100 if taken.startswith("ms") else 0.1
    rows = [f"{step * k:.6g},{20 * k},{k / 10},{k // 10},{100 * (k // 3)},9 am" for k in range(200)]
    read = read_csv(csv_of(tmp_path, rows, header if header.count(",") == 5 else f"{header},remark"), PLAIN)
    assert f"{taken}: taken as the time" in read.notes[0]
    assert read.dt_s == pytest.approx(1.0 if taken == "gps_time" else 0.1)


@pytest.mark.parametrize(
    ("name", "mps"),
    [
        ("v_vehicle [km/h]", 1.0 / 3.6),
        ("v_kmh", 1.0 / 3.6),
        ("Speed (km/h)", 1.0 / 3.6),
        ("speed_mph", 0.44704),
        ("v [mm/s]", 1e-3),
        ("v [m/s]", 1.0),
        ("speed", 1.0),
        ("speed_a", 1.0),
    ],
)
def test_a_speed_is_read_in_the_unit_that_its_name_says(tmp_path, name, mps):
    rows = [f"{0.1 * k:.1f},{20 * k},{k}" for k in range(41)]
    file = csv_of(tmp_path, rows, f"time_s,I_pump,{name}")
    read = read_csv(file, RecordingSettings(input="I_pump", output=name))
    np.testing.assert_allclose(read.output, mps * np.arange(41.0))
    assert [note.startswith(f"{name}: read as ") for note in read.notes] == [True] * (mps != 1.0)
    as_it_is = RecordingSettings(input="I_pump", output=name, columns={name: ColumnSettings(scale=1.0)})
    np.testing.assert_allclose(read_csv(file, as_it_is).output[:13], np.arange(13.0))
    in_a_log = {
        "I_pump": Readings(0.1 * np.arange(41.0), 20.0 * np.arange(41.0)),
        name: Readings(0.1 * np.arange(41.0), np.arange(41.0)),
    }
    read = arranged("made up", in_a_log, RecordingSettings(input="I_pump", output=name), None)
    np.testing.assert_allclose(read.output, mps * np.arange(41.0))


@pytest.mark.parametrize(
    ("name", "most", "ma"),
    [
        ("I [A]", 1.2, 1000.0),
        ("U [V]", 24.0, 100.0),
        ("I (%)", 2.0, 10.0),  # which would else be A
        ("I [mA]", 800.0, 1.0),
        ("coil_A", 800.0, 1.0),  # a coil's name, and no unit
    ],
)
def test_a_current_is_read_in_the_unit_in_brackets(tmp_path, name, most, ma):
    rows = [f"{0.1 * k:.1f},{most * k / 40},{k / 10}" for k in range(41)]
    file = csv_of(tmp_path, rows, f"Time [s],{name},ground_speed_mps")
    read = read_csv(file, RecordingSettings(input=name))
    np.testing.assert_allclose(read.input, ma * most * np.arange(41.0) / 40)
    assert any(f'columns: {{"{name}": {{scale: 1}}}}' in note for note in read.notes) is (ma != 1.0)


@pytest.mark.parametrize(
    ("header", "signs", "entry"),
    [
        ("time_s,pump_current_ma,ground_speed_mps", (1, -1), "columns: {ground_speed_mps: {scale: -1}}"),
        ("time_s,pump_current_ma,v_kmh", (1, -1), "columns: {v_kmh: {scale: -0.277778}}"),
        ("time_s,pump_current_ma,ground_speed_mps", (-1, 1), "columns: {pump_current_ma: {scale: -1}}"),
        ("time_s,pedal,ground_speed_mps", (-1, 1), "columns: {pedal: {scale: -10}}"),
        ("time_s,pump_current_ma,ground_speed_mps", (1, 1), ""),
        ("time_s,pump_current_ma,ground_speed_mps", (-1, -1), ""),
    ],
)
def test_a_speed_that_falls_as_the_input_rises_is_said_with_how_to_turn_it(tmp_path, header, signs, entry):
    current, speed = signs
    most, names = (90.0 if "pedal" in header else 800.0), header.split(",")
    rows = [f"{0.1 * k:.1f},{current * most * k / 40:.6g},{speed * k / 10:.6g}" for k in range(41)]
    file, said = csv_of(tmp_path, rows, header), RecordingSettings(input=names[1], output=names[2])
    turns = [note for note in read_csv(file, said).notes if "falls as the input rises" in note]
    assert len(turns) == bool(entry)
    if not entry:
        return
    assert entry in turns[0]
    name, scale = entry.removeprefix("columns: {").rstrip("}").split(": {scale: ")
    turned = msgspec.structs.replace(said, columns={name: ColumnSettings(scale=float(scale))})
    read = read_csv(file, turned)
    assert not any("falls as" in note for note in read.notes)
    np.testing.assert_array_equal(np.sign(read.input[1:] * read.output[1:]), 1.0)


def test_a_controller_that_holds_the_speed_on_hills_turns_no_sign(tmp_path):
    """It gives more current where the machine is slower."""
    rows = [f"{0.1 * k:.1f},{600 + 100 * np.sin(k / 9):.6g},{2 - 0.1 * np.sin(k / 9):.6g}" for k in range(200)]
    assert read_csv(csv_of(tmp_path, rows), PLAIN).notes == ()


def test_a_signal_that_there_is_none_of_is_said(tmp_path):
    rows = [f"{0.1 * k:.1f},{20 * k},{k / 10},{k},{k}" for k in range(41)]
    file = csv_of(tmp_path, rows, "time_s,pump_current_ma,ground_speed_mps,a,b")
    columns = {"a": ColumnSettings(signal="engine_sped_rpm"), "b": ColumnSettings(signal="slope")}
    first, second = read_csv(file, RecordingSettings(columns=columns)).notes
    assert "did you mean engine_speed_rpm?" in first
    assert "known are wheel_speed_mps, engine_speed_rpm, gear, pitch_deg" in second


def test_columns_are_named_scaled_and_gated(tmp_path):
    settings = RecordingSettings(
        time="ms",
        input="u",
        output="v",
        columns={
            "ms": ColumnSettings(scale=0.001),
            "u": ColumnSettings(scale=1000.0, offset=10.0),
            "rpm": ColumnSettings(signal="engine_speed_rpm", scale=0.125),
        },
        active_when=ActiveWhen(column="safe", above=0.5),
    )
    rows = [f"{100 * k},0.5,1.5,16800,{'' if k == 15 else int(k >= 5)},x{k}" for k in range(20)]
    read = read_csv(csv_of(tmp_path, rows, "ms,u,v,rpm,safe,remark"), settings)
    np.testing.assert_allclose(read.input[:15], [0.0] * 5 + [510.0] * 10)
    assert read.input[15] == 510.0  # the cell without a flag is not measured; the value before it is held
    assert set(read.columns) == {INPUT, OUTPUT, "engine_speed_rpm", "safe"}
    assert set(read.context()) == {"engine_speed_rpm"}
    assert read.context()["engine_speed_rpm"][0] == 2100.0
    assert read.notes == (
        "safe: 1 of 20 cells hold no number, not measured",
        "remark: holds no number, left out",
        "input set to 0 in 5 of 20 rows: safe is not above 0.5",
    )


def test_the_mapping_alone_says_what_time_input_and_output_are(tmp_path):
    settings = RecordingSettings(
        columns={
            "ms": ColumnSettings(signal="time_s", scale=0.001),
            "amps": ColumnSettings(signal=INPUT, scale=1000.0),
            "kmh": ColumnSettings(signal=OUTPUT, scale=1 / 3.6),
            "wheel": ColumnSettings(signal="wheel_speed_mps", scale=1 / 3.6, offset=0.5),
        }
    )
    path = csv_of(tmp_path, [f"{100 * k},0.5,{3.6 * k},7.2,{k}" for k in range(20)], "ms,amps,kmh,wheel,mystery")
    read = read_csv(path, settings)
    assert read.dt_s == 0.1
    np.testing.assert_allclose(read.input, 500.0)
    np.testing.assert_allclose(read.output, np.arange(20), atol=1e-9)
    assert set(read.context()) == {"wheel_speed_mps"}
    np.testing.assert_allclose(read.columns["wheel_speed_mps"], 2.5)
    np.testing.assert_allclose(read.columns["mystery"], np.arange(20))  # what nobody named stays
    other = read_csv(path, msgspec.structs.replace(settings, output="wheel_speed_mps"))
    np.testing.assert_allclose(other.output, 2.5)  # a mapped name can be chosen, too
    np.testing.assert_allclose(other.columns["recorded_ground_speed_mps"], np.arange(20), atol=1e-9)
    twice = {**settings.columns, "wheel": ColumnSettings(signal=OUTPUT)}
    with pytest.raises(RecordingError, match="two columns would be ground_speed_mps; one of them is 'wheel'"):
        read_csv(path, msgspec.structs.replace(settings, columns=twice))


def test_one_mapping_reads_recordings_of_which_some_lack_a_column(tmp_path):
    """A bus has no weighing bin on every machine; a name that is nearly there is a slip all the same."""
    path = csv_of(tmp_path, [f"{row},2" for row in ramp()], "time_s,pump_current_ma,ground_speed_mps,gear")
    mapping = {"m_bin": ColumnSettings(signal="machine_mass_kg"), "gear": ColumnSettings()}
    read = read_csv(path, RecordingSettings(columns=mapping))
    assert "machine_mass_kg" not in read.columns
    assert "m_bin: named in the file of --columns, and not in this recording" in read.notes
    slip = {"gaer": ColumnSettings(signal="gear"), "m_bin": ColumnSettings()}
    with pytest.raises(RecordingError, match="no column 'gaer' for columns; did you mean 'gear'"):
        read_csv(path, RecordingSettings(columns=slip))


def test_a_column_that_is_mapped_onto_one_that_is_there_is_refused(tmp_path):
    path = csv_of(tmp_path, [f"{row},3" for row in ramp()], "time_s,pump_current_ma,ground_speed_mps,kmh")
    settings = RecordingSettings(columns={"kmh": ColumnSettings(signal=OUTPUT)})
    with pytest.raises(RecordingError, match="two columns would be ground_speed_mps; one of them is 'kmh'"):
        read_csv(path, settings)


def test_another_output_leaves_the_recorded_speed_in_place(tmp_path):
    path = csv_of(
        tmp_path,
        [f"{row},{k}" for k, row in enumerate(ramp())],
        "time_s,pump_current_ma,ground_speed_mps,wheel_speed_mps",
    )
    read = read_csv(path, RecordingSettings(output="wheel_speed_mps"))
    np.testing.assert_allclose(read.output, np.arange(20))
    np.testing.assert_allclose(read.columns["recorded_ground_speed_mps"], 0.2 * np.arange(20), atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (RecordingSettings(active_when=ActiveWhen(column="safe")), "no column 'safe' for active_when"),
        (RecordingSettings(active_when=ActiveWhen(column="time_s")), "active_when: 'time_s' is the time, and no flag"),
        (RecordingSettings(columns={"time_s": ColumnSettings(scale=0.0)}), "all 20 rows have one time, 0 s"),
        (RecordingSettings(input="ground_speed_mps", output="ground_speed_mps"), "both input and output"),
    ],
)
def test_settings_that_do_not_fit_the_file_say_so(tmp_path, settings, expected):
    with pytest.raises(RecordingError, match=expected):
        read_csv(csv_of(tmp_path, ramp()), settings)
