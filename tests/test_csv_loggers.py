"""CSV files as loggers write them: lines before the header, a line of units, clocks without dates, rows in disorder."""

import numpy as np
import pytest

from cruise.columns import RecordingSettings
from cruise.csv_file import header_of, read_csv
from cruise.signals import INPUT, OUTPUT
from tests.csv_files import PLAIN, csv_of, file_of, ramp

HEADER = f"time_s,{INPUT},{OUTPUT}"


@pytest.mark.parametrize(
    "before",
    [
        ["Logger X200"],
        ["Logger X200", "", "Serial,1234", "Rate,10,Hz"],
        ["# drive of a combine, second field, wet, all gears", "# 2026-08-01"],
        ["Logger X200,,", ",,", "Start,2026-08-01 09:00:00,UTC"],
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_what_a_logger_says_before_the_header_is_passed_over(tmp_path, before, separator):
    path = file_of(tmp_path, "\n".join([*before, HEADER, *ramp()]).replace(",", separator))
    read = read_csv(path, PLAIN)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)
    assert read.notes == (f"{len(before)} lines stand before the header, passed over",)
    assert header_of(path) == HEADER.split(",")


def test_lines_are_counted_from_the_first_of_the_file(tmp_path):
    rows = [*ramp()[:7], "0.05,70,1.4", *ramp()[7:]]
    path = file_of(tmp_path, "\n".join(["Logger X200", "", HEADER, *rows[:7], "0.7,70,1.4,9", *rows[8:]]))
    with pytest.raises(ValueError, match=r"drive\.csv:11: 4 cells"):
        read_csv(path, PLAIN)
    path = file_of(tmp_path, "\n".join(["Logger X200", "", HEADER, *ramp(), "0.05,70,1.4"]))
    with pytest.raises(ValueError, match=r"drive\.csv:24: time runs backwards"):
        read_csv(path, PLAIN)
    path = file_of(tmp_path, "\n".join(["Logger X200", "", HEADER.replace(INPUT, "i"), *ramp()]))
    with pytest.raises(ValueError, match=r"drive\.csv:3: no column 'pump_current_ma'"):
        read_csv(path, PLAIN)


def test_a_line_of_words_among_the_rows_is_no_header(tmp_path):
    rows = ramp()
    read = read_csv(csv_of(tmp_path, [*rows[:5], "n/a,n/a,n/a", *rows[5:]]), PLAIN)
    assert (len(read), list(read.columns)) == (20, [INPUT, OUTPUT])


def test_the_comment_sign_that_numpy_writes_is_no_part_of_the_first_name(tmp_path):
    assert len(read_csv(csv_of(tmp_path, ramp(), f"# {HEADER}"), PLAIN)) == 20


@pytest.mark.parametrize("units", ["s,A,km/h", "[s],[A],[km/h]", "(s),(A),(kph)", "-,A,km/h"])
def test_a_line_of_units_below_the_header_is_read_as_if_it_stood_behind_the_names(tmp_path, units):
    path = csv_of(tmp_path, [units, *ramp()], "time_s,coil,speed")
    read = read_csv(path, RecordingSettings(input="coil", output="speed"))
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20) / 3.6, atol=1e-9)
    np.testing.assert_allclose(read.input, 1e4 * np.arange(20), atol=1e-6)
    assert header_of(path) == ["time_s", "coil [A]", "speed [km/h]"]


def test_a_name_that_says_its_unit_keeps_it_and_a_unit_that_nobody_knows_is_none(tmp_path):
    rows = [f"{row},{k}" for k, row in enumerate(ramp())]
    path = csv_of(tmp_path, ["s,mA,m/s,l/min", *rows], f"{HEADER},flow")
    assert list(read_csv(path, PLAIN).columns) == [INPUT, OUTPUT, "flow"]


def test_two_columns_of_one_name_and_several_units_are_asked_for_by_the_whole_name(tmp_path):
    path = csv_of(tmp_path, ramp(), "time_s,v [mA],v [m/s]")
    with pytest.raises(ValueError, match="no column 'v' for input"):
        read_csv(path, RecordingSettings(input="v", output="v [m/s]"))


@pytest.mark.parametrize(
    ("stamp", "first"),
    [
        ("{hour:02d}:{minute:02d}:{second:04.1f}", "23:59:59.0"),
        ("01.08.2026 {hour}:{minute:02d}:{second:04.1f}", "01.08.2026 23:59:59.0"),
        ("8/1/2026 {half_day}:{minute:02d}:{second:04.1f} {half}M", "8/1/2026 11:59:59.0 PM"),
    ],
)
def test_times_may_be_those_of_a_clock_and_go_on_after_midnight(tmp_path, stamp, first):
    def at(k: int) -> str:
        of_day = (863990 + k) % 864000
        hour, minute = of_day // 36000, of_day // 600 % 60
        half = {"half": "AP"[hour // 12], "half_day": hour % 12 or 12}
        return stamp.format(hour=hour, minute=minute, second=of_day % 600 / 10, **half)

    read = read_csv(csv_of(tmp_path, [f"{at(k)},{k},1" for k in range(40)], f"Time,{INPUT},{OUTPUT}"), PLAIN)
    np.testing.assert_allclose(read.time_s, 0.1 * np.arange(40), atol=1e-9)
    assert f"times count from {first} of its clock, rounded down to the second" in read.notes


def test_a_date_beside_the_clock_is_no_measurement(tmp_path):
    rows = [f"01.08.2026,09:00:{0.1 * k:04.1f},{k},1" for k in range(20)]
    read = read_csv(csv_of(tmp_path, rows, f"Date,Time,{INPUT},{OUTPUT}"), PLAIN)
    np.testing.assert_allclose(read.time_s, 0.1 * np.arange(20), atol=1e-9)
    assert list(read.columns) == [INPUT, OUTPUT]


def test_rows_a_little_out_of_order_are_sorted_and_it_is_said(tmp_path):
    rows = ramp()
    rows[4], rows[6] = rows[6], rows[4]
    rows[12], rows[13] = rows[13], rows[12]
    read = read_csv(csv_of(tmp_path, rows), PLAIN)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)
    assert read.notes == ("3 rows out of order, sorted",)


def test_a_file_whose_newest_row_comes_first_is_turned_round(tmp_path):
    read = read_csv(csv_of(tmp_path, ramp()[::-1]), PLAIN)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)
    assert read.notes == ("the newest row comes first, turned round",)


def test_a_file_that_a_power_failure_cut_is_read_up_to_there(tmp_path):
    path = csv_of(tmp_path, [*ramp(), "2,20"])
    path.write_bytes(path.read_bytes().rstrip() + bytes(512))
    read = read_csv(path, PLAIN)
    assert len(read) >= 20
    assert any(note.startswith("ends in 512 characters of nothing") for note in read.notes)


def test_cells_that_only_spaces_separate_are_those_of_a_table(tmp_path):
    rows = [f" {'   '.join(row.split(','))}" for row in ramp()]
    read = read_csv(file_of(tmp_path, "\n".join([f"# {HEADER.replace(',', ' ')}", *rows])), PLAIN)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)
    assert list(read.columns) == [INPUT, OUTPUT]


@pytest.mark.parametrize("name", ["Zeit", "Zeit_s", "Temps (s)", "tiempo", "Tijd [s]"])
def test_a_time_is_known_in_other_languages(tmp_path, name):
    read = read_csv(csv_of(tmp_path, ramp(), f"{name},{INPUT},{OUTPUT}"), PLAIN)
    np.testing.assert_allclose(read.output, 0.2 * np.arange(20), atol=1e-9)
    assert any(note.startswith(f"{name}: taken as the time") for note in read.notes)
