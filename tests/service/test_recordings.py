"""Any recording is opened by its ending; one that is none, under any name, is refused with a reason."""

import sys
from pathlib import Path

import numpy as np
import pytest

from cruise.can.log import LogError
from cruise.columns import ColumnSettings
from cruise.recording import RecordingError
from cruise.service.recordings import ReadingSettings, read_recording, read_recordings
from tests.service.logs import BY_DBC, assert_is_the_drive, table


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


def pedal(folder: Path, name: str, most: float) -> Path:
    """A recording whose input rises to `most`, under a name that says no unit."""
    rows = [f"{0.1 * k:.1f},{most * k / 40:.6g},{k / 10:.6g}" for k in range(41)]
    (folder / f"{name}.csv").write_text("\n".join(["time_s,pedal,ground_speed_mps", *rows]))
    return folder / f"{name}.csv"


def test_an_input_without_a_unit_is_in_one_unit_in_all_recordings(tmp_path):
    said = ReadingSettings(input="pedal")
    slow, full, current, still = (
        pedal(tmp_path, name, most) for name, most in (("slow", 2.5), ("full", 90.0), ("ma", 800.0), ("still", 0.0))
    )
    for paths, scale in (
        ([slow], 1000.0),
        ([slow, full, still], 10.0),
        ([full, slow], 10.0),
        ([slow, full, current], 1),
    ):
        for path, read in zip(paths, read_recordings(paths, said), strict=True):
            most = float(path.read_text().split(",")[-2])
            np.testing.assert_allclose(read.input, scale * most * np.arange(41) / 40, rtol=1e-5)
    alike, as_it_is = read_recordings([slow, full], said)
    assert alike.notes == (
        "pedal: read as per cent like that of full.csv; alone it would be A or a share of all, "
        "as columns: {pedal: {scale: 1000}} in the file of --columns reads all",
    )
    assert as_it_is.notes == read_recording(full, said).notes
    in_a = ReadingSettings(input="pedal", columns={"pedal": ColumnSettings(scale=1000.0)})
    for path, read in zip([slow, current], read_recordings([slow, current], in_a), strict=True):
        np.testing.assert_array_equal(read.input, read_recording(path, in_a).input)
        assert read.notes == ()


def test_a_current_that_hardly_ever_flows_is_in_the_unit_of_the_others(tmp_path):
    rare = pedal(tmp_path, "rare", 0.0)
    lines = rare.read_text().splitlines()
    rows = [f"{4.1 + 0.1 * k:.1f},{'50' if k == 500 else '0'},1" for k in range(1000)]
    rare.write_text("\n".join([*lines, *rows]))
    said = ReadingSettings(input="pedal")
    assert read_recordings([rare, pedal(tmp_path, "full", 90.0)], said)[0].input.max() == 500.0
