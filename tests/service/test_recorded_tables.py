"""The known drive in a table, CSV or Parquet, comes back as itself."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

from cruise.csv_file import read_csv
from cruise.recording import RecordingError
from cruise.service.recordings import ReadingSettings, read_recording
from cruise.service.recordings.parquet import columns_of
from cruise.signals import INPUT, OUTPUT
from tests.service.logs import BY_DBC, assert_is_the_drive, table


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


def test_an_index_without_a_name_is_the_time_where_it_holds_times_and_nothing_else_is(tmp_path):
    frame = table()
    frame.index = pd.date_range("2026-08-01T09:00", periods=81, freq="50ms")
    frame.drop(columns="time_s").to_parquet(tmp_path / "drive.parquet")
    read = read_recording(tmp_path / "drive.parquet", BY_DBC)
    assert_is_the_drive(read, 1e-9)
    assert read.notes[0].startswith("time index: taken as the time")
    assert columns_of(tmp_path / "drive.parquet") == [INPUT, OUTPUT, "gear", "time index"]
    frame.to_parquet(tmp_path / "both.parquet")
    both = read_recording(tmp_path / "both.parquet", BY_DBC)
    assert_is_the_drive(both, 1e-9)
    assert [note.partition(":")[0] for note in both.notes] == ["__index_level_0__"]
    assert "time index" not in columns_of(tmp_path / "both.parquet")


def test_a_parquet_row_is_named_where_time_runs_back(tmp_path):
    frame = table()
    frame.loc[67, "time_s"] = 0.1
    frame.to_parquet(tmp_path / "drive.parquet")
    with pytest.raises(RecordingError, match=r"drive\.parquet, row 68: time runs backwards, from 3\.3 s to 0\.1 s"):
        read_recording(tmp_path / "drive.parquet", BY_DBC)
    with pytest.raises(RecordingError, match=r"drive\.parquet: no column 'amps' for input; it has time_s, "):
        read_recording(tmp_path / "drive.parquet", ReadingSettings(input="amps"))
    (tmp_path / "folder.parquet").mkdir()
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(tmp_path / "folder.parquet", BY_DBC)
