"""CSV files: what is written reads back equal, however it is written; bad ones say what is wrong and where."""

import tempfile
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.columns import ColumnSettings, RecordingSettings
from cruise.csv_file import header_of, read_csv, write_csv
from cruise.recording import Recording, RecordingError
from cruise.signals import INPUT, OUTPUT
from tests.csv_files import PLAIN, csv_of, file_of, ramp


def test_an_even_file_is_taken_as_it_is(tmp_path):
    read = read_csv(csv_of(tmp_path, ramp()), PLAIN)
    assert (read.dt_s, len(read), read.notes) == (0.1, 20, ())
    np.testing.assert_allclose(read.time_s, 0.1 * np.arange(20), atol=1e-12)
    np.testing.assert_allclose(read.input, 10.0 * np.arange(20), atol=1e-9)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)


@given(
    dt_s=st.sampled_from([0.01, 0.02, 0.03, 1 / 30, 0.05, 0.07, 0.1, 0.125, 0.2, 0.375, 1.0]),
    start_s=st.floats(-1e4, 1e6),
    values=st.lists(st.floats(-1e3, 1e3), min_size=10, max_size=30),
)
@hypothesis.settings(max_examples=50)
def test_what_is_written_reads_back_equal(dt_s, start_s, values):
    columns = {INPUT: np.array(values), OUTPUT: np.array(values[::-1]) / 100.0, "header_height_mm": np.array(values)}
    written = Recording(start_s + dt_s * np.arange(len(values)), columns, dt_s, "made up")
    with tempfile.TemporaryDirectory() as folder:
        write_csv(written, Path(folder) / "drive.csv")
        read = read_csv(Path(folder) / "drive.csv", PLAIN)
    assert read.dt_s == pytest.approx(dt_s, rel=1e-5)
    assert list(read.columns) == list(columns)
    for name, expected in columns.items():
        np.testing.assert_allclose(read.columns[name], expected, rtol=1e-8, atol=1e-9)


def test_no_digits_of_arithmetic_are_written(tmp_path):
    time_s = 1.0 / 7.0 * np.arange(20)
    columns = {INPUT: np.full(20, 2097.5249999999933), OUTPUT: np.full(20, 0.1 + 0.2), "small": np.full(20, 1e-7 / 3)}
    write_csv(Recording(time_s, columns, 1.0 / 7.0, "x"), tmp_path / "f.csv")
    assert (tmp_path / "f.csv").read_text().splitlines()[2] == "0.142857143,2097.525,0.3,3.33333333e-08"


def test_what_was_not_measured_is_an_empty_cell(tmp_path):
    values = np.full(20, 700.0)
    values[3:10] = np.nan
    write_csv(Recording(np.arange(20) * 0.1, {INPUT: values, OUTPUT: np.ones(20)}, 0.1, "x"), tmp_path / "f.csv")
    assert "0.5,,1.0" in (tmp_path / "f.csv").read_text()
    read = read_csv(tmp_path / "f.csv", PLAIN)
    assert np.flatnonzero(np.isnan(read.input)).tolist() == [6, 7, 8, 9]  # held for 0.3 s, then stale
    assert read.notes == (
        "pump_current_ma: 7 of 20 cells hold no number, not measured",
        "pump_current_ma: gap of 0.8 s at t=0.2 s",
    )


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_blank_lines_and_spaces_do_not_matter(tmp_path, separator):
    lines = ["time_s,pump_current_ma , ground_speed_mps", *ramp(), "", ""]
    assert len(read_csv(file_of(tmp_path, "\r\n".join(lines).replace(",", separator)), PLAIN)) == 20


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_file_of_plain_numbers_reads_as_one_that_is_quoted(tmp_path, separator):
    """The two ways through the reader agree to the last bit, with empty cells anywhere."""
    random = np.random.default_rng(6)
    cells = [[f"{value!r}" for value in row] for row in random.normal(scale=1e3, size=(40, 4)).tolist()]
    for k, row in enumerate(cells):
        row[0] = f"{0.1 * k:.1f}"
    for row, column in ((3, 1), (3, 2), (4, 3), (7, 1), (7, 2), (7, 3), (12, 0), (13, 2)):
        cells[row][column] = ""
    cells[20][3], cells[21][3], cells[22][3] = "nan", "inf", " 1e400"
    names = ["time_s", INPUT, OUTPUT, "x"]
    plain, quoted = tmp_path / "plain.csv", tmp_path / "quoted.csv"
    plain.write_text("\n".join(separator.join(row) for row in [names, *cells]) + "\n")
    quoted.write_text("\r\n".join(separator.join(f'"{cell}"' for cell in row) for row in [names, *cells]))
    one, other = read_csv(plain, PLAIN), read_csv(quoted, PLAIN)
    assert one.notes == other.notes
    assert len(one.notes) == 4
    np.testing.assert_array_equal(one.time_s, other.time_s)
    for name in other.columns:
        np.testing.assert_array_equal(one.columns[name], other.columns[name])


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_comma_that_separates_nothing_is_the_decimal_sign(tmp_path, separator):
    rows = [row.replace(",", separator).replace(".", ",") for row in ramp()]
    read = read_csv(csv_of(tmp_path, rows, separator.join(["time_s", INPUT, OUTPUT])), PLAIN)
    assert (read.dt_s, read.notes) == (0.1, ())
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)


@pytest.mark.parametrize(("time", "current", "speed"), [("Zeit", "Strom, mA", "v, m/s"), ("a,b,c", "i,j", "x,y")])
def test_names_may_hold_commas_where_something_else_separates(tmp_path, time, current, speed):
    rows = [row.replace(",", ";").replace(".", ",") for row in ramp()]
    read = read_csv(
        csv_of(tmp_path, rows, ";".join([time, current, speed])),
        RecordingSettings(time=time, input=current, output=speed),
    )
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)


def test_a_name_may_hold_a_semicolon_where_commas_separate(tmp_path):
    read = read_csv(
        csv_of(tmp_path, ramp(), "time_s,current; mA,speed"), RecordingSettings(input="current; mA", output="speed")
    )
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)


@pytest.mark.parametrize(
    ("stamp", "start_s"),
    [
        ("2026-08-01T08:59:{:06.3f}Z", 1785574740.0),
        ("2026-08-01 08:59:{:012.9f}+02", 1785567540.0),
        ("2026-08-01 08:59:{:06.3f}", 1785574740.0),
        ("2026-08-01T08:59:{:06.3f}-0230", 1785583740.0),
    ],
)
def test_times_can_be_stamps(tmp_path, stamp, start_s):
    rows = [f"{stamp.format(0.1 * k)},{k},1" for k in range(20)]
    rows[4] = rows[4].replace("2026", "now")
    read = read_csv(csv_of(tmp_path, rows, "Time,pump_current_ma,ground_speed_mps"), RecordingSettings(time="Time"))
    np.testing.assert_allclose(read.time_s, 0.1 * np.arange(20), atol=1e-9)
    assert read.notes[:2] == (
        f"times count from {np.datetime64(round(start_s), 's')}, {start_s:.0f} s since 1970",
        "1 rows have no time, left out",
    )
    path = csv_of(tmp_path, [*rows, "2026-13-01 00:00:00,1,1"], "Time,pump_current_ma,ground_speed_mps")
    mapped = RecordingSettings(columns={"Time": ColumnSettings(signal="time_s")})
    np.testing.assert_array_equal(read_csv(path, mapped).time_s, read.time_s)


@pytest.mark.parametrize(
    ("date", "before", "behind"), [("10-25", "02+02:00", "02+01"), ("03-29", "01+0100", "03+0200")]
)
def test_a_clock_that_goes_over_to_or_from_summer_time_goes_on(tmp_path, date, before, behind):
    minutes = [("59", before, 58.0 + 0.1 * k) for k in range(20)] + [("00", behind, 0.1 * k) for k in range(20)]
    rows = [f"2026-{date}T{at[:2]}:{minute}:{second:04.1f}{at[2:]},{second},1" for minute, at, second in minutes]
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    assert len(read) == 40
    np.testing.assert_allclose(read.time_s, 0.1 * np.arange(40), atol=1e-9)


@pytest.mark.parametrize("name", ["time_s", "timestamp", "Time"])
@pytest.mark.parametrize("stamp", ["2026-08-01T09:00:{:09.6f}Z", "17855747{:09.6f}"])
def test_times_of_a_clock_count_from_the_second_in_which_the_recording_began(tmp_path, name, stamp):
    rows = [f"{stamp.format(40.25 + 0.05 * k)},{k},1" for k in range(40)]
    read = read_csv(csv_of(tmp_path, rows, f"{name},pump_current_ma,ground_speed_mps"), PLAIN)
    np.testing.assert_allclose(read.time_s, 0.25 + 0.05 * np.arange(40), atol=1e-9)
    assert read.dt_s == 0.05
    assert any(note.startswith("times count from 2026-08-01T0") for note in read.notes)


def test_times_in_ms_get_a_scale(tmp_path):
    path = csv_of(tmp_path, ramp(20, 100.0), "ms,pump_current_ma,ground_speed_mps")
    read = read_csv(path, RecordingSettings(time="ms", columns={"ms": ColumnSettings(scale=0.001)}))
    assert (read.dt_s, len(read)) == (0.1, 20)


def test_times_that_may_be_ms_are_said_to(tmp_path):
    read = read_csv(csv_of(tmp_path, ramp(20, 1.0), "time,pump_current_ma,ground_speed_mps"), PLAIN)
    assert read.dt_s == 1.0
    assert (
        "time: one row every 1 s; if it is in ms, columns: {time: {scale: 0.001}} in the file of --colu"
        in read.notes[1]
    )
    assert read_csv(csv_of(tmp_path, ramp(20, 1.0)), PLAIN).notes == ("time_s: one row every 1 s",)  # its name says it
    assert read_csv(csv_of(tmp_path, ramp(20, 0.5)), PLAIN).notes == ()


def test_bad_cells_and_rows_are_counted_not_taken(tmp_path):
    rows = ramp()
    rows[3] = "0.3,n/a,nan"
    rows[5] = "0.5,inf,1.0"
    rows[7] = ",70,1.4"
    rows[9] = "0.9,90"
    rows.insert(12, rows[12])
    rows[-1] = "1.9"  # cut off while it was written
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    assert len(read) == 20
    np.testing.assert_allclose(read.output[:19], 0.2 * np.arange(19), atol=1e-9)
    assert read.notes == (
        "1 rows have no time, left out",
        "1 rows have the time of the next one: they count as one with it",
        "pump_current_ma: 3 of 19 cells hold no number, not measured",
        "ground_speed_mps: 3 of 19 cells hold no number, not measured",
    )


def test_stamps_without_decimals_are_told_what_they_cost(tmp_path):
    rows = [f"{k // 10},{10 * k},{0.2 * k:.1f}" for k in range(200)]
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    assert "time_s: 180 of 200 values are lost, as its stamps lack decimals; write it with all its digits" in read.notes


def test_one_signal_a_row_under_one_time_is_one_row(tmp_path):
    rows = [line for k in range(20) for line in (f"{0.1 * k:.1f},{10 * k},", f"{0.1 * k:.1f},,{0.2 * k:.1f}")]
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    np.testing.assert_allclose(read.input, 10.0 * np.arange(20), atol=1e-9)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)
    assert read.notes == ("20 rows have the time of the next one: they count as one with it",)


def test_codes_for_not_available_are_no_measurements_and_it_is_said(tmp_path):
    rows = [f"{0.1 * k:.1f},{10 * k},{1.0 + 0.01 * k},{1800 + k}" for k in range(60)]
    rows[20] = "2.0,200,255.996,8191.875"
    rows[30] = "3.0,300,-1e30,1830"
    header = f"time_s,{INPUT},{OUTPUT},engine_speed_rpm"
    read = read_csv(csv_of(tmp_path, rows, header), PLAIN)
    assert np.nanmax(read.output) < 2.0
    assert np.nanmax(read.columns["engine_speed_rpm"]) < 1900.0
    said = [note for note in read.notes if "is nothing that" in note]
    assert said == [
        "ground_speed_mps: -1e+30 and 255.996, 2 times, is nothing that ground_speed_mps can be: not measured",
        "engine_speed_rpm: 8191.88, 1 times, is nothing that engine_speed_rpm can be: not measured",
    ]


def test_each_of_the_three_ranges_of_j1939_has_a_code(tmp_path):
    rows = [f"{0.1 * k:.1f},{10 * k},{1.0 + 0.01 * k}" for k in range(60)]
    rows[20:23] = ["2.0,200,65.535", "2.1,210,65.279", "2.2,220,64.255"]
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    assert np.nanmax(read.output) < 2.0
    assert read.notes[0].startswith("ground_speed_mps: 64.255 and 65.279 and 65.535, 3 times, is nothing that")


@pytest.mark.parametrize("fastest_mps", [14.0, 40.0])
def test_what_is_measured_beyond_a_combines_range_stays(tmp_path, fastest_mps):
    rows = [f"{0.1 * k:.1f},{10 * k},{fastest_mps * k / 60}" for k in range(60)]
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    assert np.isfinite(read.output).all()
    assert read.notes == ()


def test_separators_at_the_ends_of_all_lines_are_passed_over(tmp_path):
    rows = [f"{row},," for row in ramp()]
    read = read_csv(csv_of(tmp_path, rows, f"time_s,{INPUT},{OUTPUT},,"), PLAIN)
    assert set(read.columns) == {INPUT, OUTPUT}
    assert read.notes == ("column 4: holds no number, left out", "column 5: holds no number, left out")


@pytest.mark.parametrize("beyond", [",", ", ,"])
def test_separators_at_the_ends_of_the_rows_alone_are_passed_over_too(tmp_path, beyond):
    read = read_csv(csv_of(tmp_path, [f"{row}{beyond}" for row in ramp()]), PLAIN)
    assert set(read.columns) == {INPUT, OUTPUT}
    assert read.notes == ()
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)


def changed(rows: list[str], index: int, row: str) -> list[str]:
    return [*rows[:index], row, *rows[index + 1 :]]


@pytest.mark.parametrize(
    ("header", "rows", "expected"),
    [
        (
            "time_s,current,ground_speed_mps",
            ramp(),
            "drive.csv:1: no column 'pump_current_ma' for input; did you mean 'current'?",
        ),
        ("time_s,current,ground_speed_mps", ramp(), "--input NAME, or input: NAME in the file of --columns"),
        (
            "time_s,pump_current_ma,v",
            ramp(),
            "for output; it has time_s, pump_current_ma, v; choose with --output NAME",
        ),
        ("time_s,pump_current_ma,ground_sped_mps", ramp(), "did you mean 'ground_sped_mps'?"),
        ("x,pump_current_ma,ground_speed_mps", ramp(), "no column 'time_s' for time"),
        ("x,pump_current_ma,ground_speed_mps", ramp(), "choose with time: NAME in the file of --columns"),
        ("time_s,pump_current_ma,pump_current_ma", ramp(), "several columns are named pump_current_ma"),
        ("0.0,1.0,2.0", ramp(), "drive.csv:1: no header line"),
        ("", [], "drive.csv:1: no header line"),
        (None, changed(ramp(), 17, "0.55,70,1.4"), "drive.csv:19: time runs backwards, from 1.6 s to 0.55 s; split"),
        (None, [*ramp(), *ramp()], "drive.csv:22: time runs backwards, from 1.9 s to 0 s; split the file there: each"),
        (None, 12 * ramp(), "drive.csv:22: time runs backwards, from 1.9 s to 0 s; sort the rows by time; or, if"),
        (None, [f"0.5,{k},1" for k in range(20)], "drive.csv: all 20 rows have one time, 0.5 s; let time_s hold that"),
        (None, changed(ramp(), 7, "0.7,70,1.4,9"), "drive.csv:9: 4 cells, but the header names 3 columns"),
        ("Logger X200", ["", "time_s,pump_current_ma", *ramp()], "the first line has to be the header"),
        (None, [f"09:00:{k + 60},1,1" for k in range(20)], "drive.csv:2: no row has a time; let the time column hold"),
        (None, ramp(20, 50.0), "one row every 50 s is too few to see a drive move; record it more often"),
        (
            "time,pump_current_ma,ground_speed_mps",
            ramp(20, 50.0),
            "one row every 50 s is too few to see a drive move; if time is in ms",
        ),
        (None, ramp(9), "9 usable rows are too few; a recording needs 10 at least"),
        (None, [], "0 usable rows are too few"),
        (None, [f"{k / 10},x,1" for k in range(20)], "pump_current_ma holds no number at all; choose another column"),
        (None, [*ramp(), "1e9,1,1"], "samples of 0.1 s, too many; the longest step is at 1.9 s"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(tmp_path, header, rows, expected):
    path = csv_of(tmp_path, rows) if header is None else csv_of(tmp_path, rows, header)
    with pytest.raises(RecordingError) as caught:
        read_csv(path, PLAIN)
    assert expected in str(caught.value)


def test_files_that_are_not_there_or_not_text(tmp_path):
    with pytest.raises(RecordingError, match="no such file"):
        read_csv(tmp_path / "none.csv", PLAIN)
    with pytest.raises(RecordingError, match="Is a directory"):
        read_csv(tmp_path, PLAIN)
    (tmp_path / "f.csv").write_bytes(b"time_s,\n\xff\x81\n")
    with pytest.raises(RecordingError, match=r"f\.csv:2: neither UTF-8.*save it again as CSV in UTF-8"):
        read_csv(tmp_path / "f.csv", PLAIN)
    (tmp_path / "f.csv").write_bytes(b"PK\x03\x04\0\0\n")
    with pytest.raises(RecordingError, match="binary data; export"):
        read_csv(tmp_path / "f.csv", PLAIN)


@pytest.mark.parametrize(
    ("encoding", "notes"),
    [
        ("utf-8", ()),
        ("utf-8-sig", ()),
        ("utf-16", ()),
        ("cp1252", ("not UTF-8 text, read as Windows-1252",)),
    ],
)
def test_any_usual_encoding_is_read(tmp_path, encoding, notes):
    path, name = tmp_path / "drive.csv", "Ölkühler [°C]"
    rows = [f"{row},{30 + k}" for k, row in enumerate(ramp())]
    path.write_text("\r\n".join([f"time_s,{INPUT},{OUTPUT},{name}", *rows]), encoding=encoding, newline="")
    read = read_csv(path, PLAIN)
    np.testing.assert_array_equal(read.columns[name], 30.0 + np.arange(20))
    assert read.notes == notes
    assert header_of(path)[-1] == name


@hypothesis.settings(max_examples=200)
@given(
    st.lists(st.lists(st.sampled_from(["", "0", "1", "x", "nan", "-1", "1e9", '"', "0.1"]), max_size=4), max_size=15)
)
def test_any_rows_give_a_recording_or_a_recording_error(rows):
    with tempfile.TemporaryDirectory() as folder:
        path = csv_of(Path(folder), [",".join(row) for row in rows])
        try:
            read = read_csv(path, PLAIN)
        except RecordingError:
            return
    assert len(read) >= 10
