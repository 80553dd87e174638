"""Recordings: known signals through jitter, gaps and coarse grids, bad files, and the measured drives."""

import tempfile
from pathlib import Path

import hypothesis
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.csv_file import read_csv, write_csv
from cruise.recording import (
    ActiveWhen,
    ColumnSettings,
    Readings,
    Recording,
    RecordingError,
    RecordingSettings,
    arranged,
    resample,
)
from cruise.sampling import Kind, means
from cruise.signals import INPUT, OUTPUT

PLAIN = RecordingSettings()
DART = RecordingSettings(
    time="elapsed time sensors",
    input="throttle",
    output="vel encoder",
    active_when=ActiveWhen(column="safety_value", above=0.5),
)


def file_of(folder: Path, text: str) -> Path:
    path = folder / "drive.csv"
    path.write_text(text, encoding="utf-8")
    return path


def csv_of(folder: Path, rows: list[str], header: str = "time_s,pump_current_ma,ground_speed_mps") -> Path:
    return file_of(folder, "\n".join([header, *rows]) + "\n")


def ramp(count: int = 20, step_s: float = 0.1) -> list[str]:
    """Return rows whose current is 100 times and whose speed is 2 times their time."""
    return [f"{k * step_s:.6g},{100 * k * step_s:.6g},{2 * k * step_s:.6g}" for k in range(count)]


def recording(count: int = 50, dt_s: float = 0.05) -> Recording:
    random = np.random.default_rng(3)
    time_s = 5.0 + dt_s * np.arange(count)
    columns = {INPUT: random.normal(size=count), OUTPUT: random.normal(size=count), "gear": np.full(count, 2.0)}
    return Recording(time_s, columns, dt_s, "made up", ("a note",))


def test_an_even_file_is_taken_as_it_is(tmp_path):
    read = read_csv(csv_of(tmp_path, ramp()), PLAIN)
    assert (read.dt_s, len(read), read.notes) == (0.1, 20, ())
    np.testing.assert_allclose(read.time_s, 0.1 * np.arange(20), atol=1e-12)
    np.testing.assert_allclose(read.input, 10.0 * np.arange(20), atol=1e-9)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)


@pytest.mark.parametrize(("most", "unit", "scale"), [(1.0, "a share of all", 1000.0), (95.0, "per cent", 10.0)])
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
    np.testing.assert_allclose(read_csv(named, PLAIN).input, most * np.arange(41) / 40, rtol=1e-5)


def test_a_current_under_another_name_is_taken_as_it_is(tmp_path):
    rows = [f"{0.1 * k:.1f},{20 * k},{k / 10}" for k in range(41)]
    read = read_csv(csv_of(tmp_path, rows, "time_s,I_pump,ground_speed_mps"), RecordingSettings(input="I_pump"))
    assert read.notes == ()
    assert read.input[-1] == 800.0


@given(
    dt_s=st.sampled_from([0.01, 0.02, 0.03, 1 / 30, 0.05, 0.07, 0.1, 0.125, 0.2, 0.375, 1.0]),
    start_s=st.floats(-1e4, 1e6),
    values=st.lists(st.floats(-1e3, 1e3), min_size=10, max_size=30),
)
@hypothesis.settings(max_examples=50)
def test_what_is_written_reads_back_equal(dt_s, start_s, values):
    columns = {INPUT: np.array(values), OUTPUT: np.array(values[::-1]), "header_height_mm": np.array(values)}
    written = Recording(start_s + dt_s * np.arange(len(values)), columns, dt_s, "made up")
    with tempfile.TemporaryDirectory() as folder:
        write_csv(written, Path(folder) / "drive.csv")
        read = read_csv(Path(folder) / "drive.csv", PLAIN)
    assert read.dt_s == pytest.approx(dt_s, rel=1e-5)
    assert list(read.columns) == list(columns)
    for name, expected in columns.items():
        np.testing.assert_allclose(read.columns[name], expected, rtol=0, atol=1e-9)


def test_what_was_not_measured_is_an_empty_cell(tmp_path):
    values = np.ones(20)
    values[3:10] = np.nan
    write_csv(Recording(np.arange(20) * 0.1, {INPUT: values, OUTPUT: np.ones(20)}, 0.1, "x"), tmp_path / "f.csv")
    assert "0.5,,1.0" in (tmp_path / "f.csv").read_text()
    read = read_csv(tmp_path / "f.csv", PLAIN)
    assert np.flatnonzero(np.isnan(read.input)).tolist() == [6, 7, 8, 9]  # held for 0.3 s, then stale
    assert read.notes == (
        "pump_current_ma: 7 of 20 cells hold no number, not measured",
        "pump_current_ma: gap of 0.8 s at t=0.2 s",
    )


@pytest.mark.parametrize(
    ("mean_step_s", "expected_s"), [(0.0993, 0.1), (0.0497, 0.05), (0.0335, 1 / 30), (0.00993, 0.01), (0.38, 0.38)]
)
def test_a_jittering_step_is_rounded_to_a_sensible_one(tmp_path, mean_step_s, expected_s):
    jitter = 1.0 + 0.05 * np.cos(np.arange(40))
    times = np.cumsum(jitter / jitter.mean() * mean_step_s)
    assert read_csv(csv_of(tmp_path, [f"{t:.6f},1,1" for t in times]), PLAIN).dt_s == pytest.approx(expected_s)


def test_jitter_leaves_a_straight_line_straight_and_a_step_a_step(tmp_path):
    random = np.random.default_rng(4)
    times = 0.1 * np.arange(60) + random.uniform(-0.008, 0.008, 60)
    times[0] = 0.0
    rows = [f"{t:.6f},{500.0 if k >= 30 else 0.0},{2.0 * t:.9f}" for k, t in enumerate(times)]
    read = read_csv(csv_of(tmp_path, rows), PLAIN, 0.1)
    np.testing.assert_allclose(read.output, 2.0 * read.time_s, atol=1e-6)
    assert set(read.input.tolist()) == {0.0, 500.0}
    assert read.input[29] == 0.0
    assert read.input[30] == 500.0


def test_a_finer_grid_interpolates_the_speed_and_holds_the_current(tmp_path):
    read = read_csv(csv_of(tmp_path, ramp()), PLAIN, 0.05)
    assert len(read) == 39
    np.testing.assert_allclose(read.output, 2.0 * read.time_s, atol=1e-9)
    np.testing.assert_allclose(read.input, 10.0 * (np.arange(39) // 2), atol=1e-9)


def test_a_coarser_grid_holds_the_means_that_the_online_path_takes(tmp_path):
    random = np.random.default_rng(5)
    times, speeds = 0.01 * np.arange(400), random.normal(size=400)
    rows = [f"{t:.6g},{u!r},{v!r}" for t, u, v in zip(times, speeds[::-1].tolist(), speeds.tolist(), strict=True)]
    read = read_csv(csv_of(tmp_path, rows), PLAIN, 0.2)
    np.testing.assert_allclose(read.time_s, 0.2 * np.arange(1, 20), atol=1e-12)
    np.testing.assert_allclose(read.output, means(times, speeds, read.time_s, 0.2, Kind.CONTINUOUS, 0.3), atol=1e-9)
    by_hand = [speeds[::-1][20 * k : 20 * k + 20].mean() for k in range(19)]
    np.testing.assert_allclose(read.input, by_hand, atol=1e-9)


def test_resampling_follows_the_same_rules(tmp_path):
    path = csv_of(tmp_path, ramp(60, 0.05))
    fine, coarse = read_csv(path, PLAIN), read_csv(path, PLAIN, 0.2)
    again = resample(fine, 0.2)
    assert again.dt_s == 0.2
    np.testing.assert_allclose(again.output, coarse.output, atol=1e-9)
    np.testing.assert_allclose(again.input, coarse.input, atol=1e-9)


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


def test_a_column_that_is_mapped_onto_one_that_is_there_is_refused(tmp_path):
    path = csv_of(tmp_path, [f"{row},3" for row in ramp()], "time_s,pump_current_ma,ground_speed_mps,kmh")
    settings = RecordingSettings(columns={"kmh": ColumnSettings(signal=OUTPUT)})
    with pytest.raises(RecordingError, match="two columns would be ground_speed_mps; one of them is 'kmh'"):
        read_csv(path, settings)


def readings(step_s: float, values, count: int = 41, start_s: float = 0.0) -> Readings:
    time_s = start_s + step_s * np.arange(count)
    return Readings(time_s, values(time_s))


def test_signals_with_times_of_their_own_meet_on_the_slower_ones_grid():
    columns = {
        INPUT: readings(0.1, lambda t: 100.0 * t),
        OUTPUT: readings(0.2, lambda t: 2.0 * t, 21, 0.003),
        "pitch_deg": readings(0.02, lambda t: t + np.cos(50 * np.pi * t), 201),  # at half its rate: noise
        "gear": readings(0.5, np.floor, 9),
        "oil_temperature_c": readings(1.0, lambda t: 60.0 + t, 5),
    }
    read = arranged("made up", columns, PLAIN, None)
    assert read.dt_s == pytest.approx(0.2)
    assert read.time_s[0] == 0.003
    inside = slice(1, -1)
    at_s = read.time_s[inside]
    np.testing.assert_allclose(read.output[inside], 2.0 * at_s, atol=1e-9)
    np.testing.assert_allclose(read.input[inside], 100.0 * (at_s - 0.05), atol=6.0)  # held: half its step
    np.testing.assert_allclose(read.columns["pitch_deg"][inside], at_s, atol=0.06)
    np.testing.assert_allclose(read.columns["gear"][inside], np.floor(at_s))
    np.testing.assert_allclose(read.columns["oil_temperature_c"][inside], 60.0 + at_s, atol=1e-9)
    coarse = arranged("made up", columns, PLAIN, 0.4)
    np.testing.assert_allclose(coarse.output, 2.0 * (coarse.time_s - 0.2), atol=0.01)
    assert read.stamps_s is not None
    fine = arranged("made up", columns, PLAIN, 0.1)
    np.testing.assert_array_equal(resample(fine, 0.2).stamps_s, read.stamps_s)


def test_readings_out_of_order_or_repeated_are_counted_not_taken():
    speed = readings(0.1, lambda t: 2.0 * t)
    times = np.insert(speed.time_s, [10, 20, 30], [0.5, speed.time_s[20], np.nan])
    values = np.insert(speed.values, [10, 20, 30], [99.0, 99.0, 99.0])
    read = arranged("made up", {INPUT: speed, OUTPUT: Readings(times, values)}, PLAIN, None)
    np.testing.assert_allclose(read.output, speed.values, atol=1e-9)
    assert read.notes == ("ground_speed_mps: 3 of 44 readings out of order or repeated, left out",)


def test_a_flag_gates_the_input_from_its_own_last_reading_on():
    current, speed = readings(0.1, lambda t: 700.0 + 0.0 * t), readings(0.1, lambda t: 2.0 * t)
    flag = Readings(np.array([0.55, 2.05]), np.array([1.0, 0.0]))
    settings = RecordingSettings(active_when=ActiveWhen(column="safe"))
    read = arranged("made up", {INPUT: current, OUTPUT: speed, "safe": flag}, settings, None)
    assert np.isnan(read.input[:6]).all()
    assert set(read.input[6:21].tolist()) == {700.0}
    assert set(read.input[21:].tolist()) == {0.0}
    assert read.notes[0] == "input set to 0 in 20 of 41 readings: safe is not above 0.5"


def test_too_few_readings_are_named(tmp_path):
    columns = {INPUT: readings(0.1, np.sin, 9), OUTPUT: readings(0.1, np.sin)}
    with pytest.raises(RecordingError, match="made up: pump_current_ma has 9 readings, too few"):
        arranged("made up", columns, PLAIN, None)
    with pytest.raises(RecordingError, match="made up: no column 'amps' for input; it has pump_current_ma, ground"):
        arranged("made up", columns, RecordingSettings(input="amps"), None)


def test_another_output_leaves_the_recorded_speed_in_place(tmp_path):
    path = csv_of(
        tmp_path,
        [f"{row},{k}" for k, row in enumerate(ramp())],
        "time_s,pump_current_ma,ground_speed_mps,wheel_speed_mps",
    )
    read = read_csv(path, RecordingSettings(output="wheel_speed_mps"))
    np.testing.assert_allclose(read.output, np.arange(20))
    np.testing.assert_allclose(read.columns["recorded_ground_speed_mps"], 0.2 * np.arange(20), atol=1e-9)


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


@pytest.mark.parametrize(
    ("stamp", "start_s"),
    [
        ("2026-08-01T08:59:{:06.3f}Z", 1785574740.0),
        ("2026-08-01 08:59:{:012.9f}+02", 1785574740.0),
        ("2026-08-01 08:59:{:06.3f}", 1785574740.0),
        ("2026-08-01T08:59:{:06.3f}+02:00", 1785574740.0),
    ],
)
def test_times_can_be_stamps(tmp_path, stamp, start_s):
    rows = [f"{stamp.format(0.1 * k)},{k},1" for k in range(20)]
    rows[4] = rows[4].replace("2026", "now")
    read = read_csv(csv_of(tmp_path, rows, "Time,pump_current_ma,ground_speed_mps"), RecordingSettings(time="Time"))
    np.testing.assert_allclose(read.time_s, start_s + 0.1 * np.arange(20), atol=1e-5)
    assert read.notes[0] == "1 rows have no time, left out"
    path = csv_of(tmp_path, [*rows, "2026-13-01 00:00:00,1,1"], "Time,pump_current_ma,ground_speed_mps")
    mapped = RecordingSettings(columns={"Time": ColumnSettings(signal="time_s")})
    np.testing.assert_array_equal(read_csv(path, mapped).time_s, read.time_s)


def test_times_in_ms_get_a_scale(tmp_path):
    path = csv_of(tmp_path, ramp(20, 100.0), "ms,pump_current_ma,ground_speed_mps")
    read = read_csv(path, RecordingSettings(time="ms", columns={"ms": ColumnSettings(scale=0.001)}))
    assert (read.dt_s, len(read)) == (0.1, 20)


def test_a_gap_stays_a_gap(tmp_path):
    rows = ramp(60)
    read = read_csv(csv_of(tmp_path, rows[:20] + rows[51:]), PLAIN)
    assert len(read) == 60
    assert np.isnan(read.output[20:51]).all()
    assert np.isfinite(read.output[:20]).all()
    assert np.isfinite(read.output[51:]).all()
    assert "ground_speed_mps: gap of 3.2 s at t=1.9 s" in read.notes
    assert resample(read, 0.1).notes == read.notes


def test_a_slow_signal_lives_as_long_as_its_own_period_says(tmp_path):
    rows = [f"{row},{60 + k if k % 10 == 0 else ''}" for k, row in enumerate(ramp(60))]
    read = read_csv(csv_of(tmp_path, rows, "time_s,pump_current_ma,ground_speed_mps,oil_temperature_c"), PLAIN)
    np.testing.assert_allclose(read.context()["oil_temperature_c"][:51], 60.0 + np.arange(51), atol=1e-9)


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
        "1 rows repeat the time of the next one, left out",
        "pump_current_ma: 3 of 19 cells hold no number, not measured",
        "ground_speed_mps: 3 of 19 cells hold no number, not measured",
    )


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
        ("t,pump_current_ma,ground_speed_mps", ramp(), "no column 'time_s' for time"),
        ("t,pump_current_ma,ground_speed_mps", ramp(), "choose with time: NAME in the file of --columns"),
        ("time_s,pump_current_ma,pump_current_ma", ramp(), "several columns are named pump_current_ma"),
        ("0.0,1.0,2.0", ramp(), "drive.csv:1: no header line"),
        ("", [], "drive.csv:1: no header line"),
        (None, changed(ramp(), 7, "0.55,70,1.4"), "drive.csv:9: time runs backwards, from 0.6 s to 0.55 s; split"),
        (None, changed(ramp(), 7, "0.7,70,1.4,9"), "drive.csv:9: 4 cells, but the header names 3 columns"),
        ("Logger X200", ["", "time_s,pump_current_ma", *ramp()], "the first line has to be the header"),
        (None, [f"09:00:{k:02d},1,1" for k in range(20)], "drive.csv:2: no row has a time; let the time column hold"),
        (None, ramp(20, 50.0), "one row every 50 s is too few to see a drive move; times in ms get a scale"),
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


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (RecordingSettings(columns={"gaer": ColumnSettings()}), "'gaer' for columns.*; correct it in the file of"),
        (RecordingSettings(active_when=ActiveWhen(column="safe")), "no column 'safe' for active_when"),
        (RecordingSettings(columns={"time_s": ColumnSettings(scale=0.0)}), "1 usable rows are too few"),
        (RecordingSettings(input="ground_speed_mps", output="ground_speed_mps"), "both input and output"),
    ],
)
def test_settings_that_do_not_fit_the_file_say_so(tmp_path, settings, expected):
    with pytest.raises(RecordingError, match=expected):
        read_csv(csv_of(tmp_path, ramp()), settings)


@pytest.mark.parametrize("dt_s", [0.0, -0.1, float("nan"), float("inf")])
def test_an_impossible_period_is_refused(tmp_path, dt_s):
    with pytest.raises(RecordingError, match="sampling period"):
        read_csv(csv_of(tmp_path, ramp()), PLAIN, dt_s)


def test_files_that_are_not_there_or_not_text(tmp_path):
    with pytest.raises(RecordingError, match="no such file"):
        read_csv(tmp_path / "none.csv", PLAIN)
    with pytest.raises(RecordingError, match="Is a directory"):
        read_csv(tmp_path, PLAIN)
    (tmp_path / "f.csv").write_bytes(b"time_s,\n\xff\xfe\n")
    with pytest.raises(RecordingError, match=r"f\.csv:2: not UTF-8.*save it again as CSV in UTF-8"):
        read_csv(tmp_path / "f.csv", PLAIN)
    (tmp_path / "f.csv").write_bytes(b"PK\x03\x04\0\0\n")
    with pytest.raises(RecordingError, match="binary data; export"):
        read_csv(tmp_path / "f.csv", PLAIN)


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


def test_a_part_of_a_recording_is_one():
    whole = recording()
    part = whole[10:30]
    assert len(part) == 20
    assert (part.source, part.notes, part.dt_s) == (whole.source, whole.notes, whole.dt_s)
    np.testing.assert_array_equal(part.input, whole.input[10:30])
    np.testing.assert_array_equal(part.time_s, whole.time_s[10:30])
    with pytest.raises(RecordingError, match="use resample"):
        whole[::2]


def test_a_recording_cannot_be_written_to_and_leaves_its_arrays_alone():
    speeds = np.ones(20)
    made = Recording(np.arange(20) * 0.1, {INPUT: np.ones(20), OUTPUT: speeds}, 0.1, "x")
    with pytest.raises(ValueError, match="read-only"):
        made.output[0] = 2.0
    speeds[0] = 1.0


@pytest.mark.parametrize(
    ("columns", "time_s", "expected"),
    [
        ({INPUT: np.ones(20)}, np.arange(20) * 0.1, "no signal ground_speed_mps; it has pump_current_ma"),
        ({INPUT: np.ones(20), OUTPUT: np.ones(19)}, np.arange(20) * 0.1, "ground_speed_mps has shape"),
        ({INPUT: np.ones(20), OUTPUT: np.ones(20)}, np.arange(20) * 0.11, "does not rise in steps of 0.1 s"),
    ],
)
def test_a_recording_is_uniform_and_complete(columns, time_s, expected):
    with pytest.raises(RecordingError, match=expected):
        Recording(time_s, columns, 0.1, "x")


def test_every_measured_drive_is_read(dart):
    files = sorted(dart.rglob("*.csv"))
    assert len(files) == 39
    for file in files:
        read = read_csv(file, DART)
        assert read.dt_s == pytest.approx(0.1)
        assert np.isfinite(read.input).all()
        assert np.isfinite(read.output).all()
        assert read.input.min() >= -1e-9
        assert read.input.max() <= 1000.0, "a share of all"
        assert any("read as a share of all" in note for note in read.notes) == bool(read.input.any())
        assert {"current", "voltage", "safety_value", "steering"} <= set(read.columns)


def test_the_throttle_of_a_measured_drive_acts_only_while_safe(dart):
    file = dart / "19_step_input_data" / "car_1_Datarecording_01_22_2024_15_01_37.csv"
    gated = read_csv(file, DART)
    raw = read_csv(file, RecordingSettings(time=DART.time, input=DART.input, output=DART.output))
    unsafe = gated.columns["safety_value"] == 0.0
    np.testing.assert_array_equal(gated.output, raw.output)
    assert raw.input[unsafe].max() > 0.1
    assert gated.input[unsafe].max() == 0.0
    np.testing.assert_array_equal(gated.input[~unsafe], raw.input[~unsafe])
