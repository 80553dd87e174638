"""Any recording is opened by its ending; one that is none, under any name, is refused with a reason."""

import sys

import pytest

from cruise.can.log import LogError
from cruise.recording import RecordingError
from cruise.service.recordings import read_recording
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
