"""Logs: what is written is read, in every format, and what is broken says where."""

import gzip
from pathlib import Path

import can
import pytest

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.log import BrokenLogError, LogError, LogWriter, read_log
from cruise.can.settings import CanSettings

DBC = Path(__file__).parents[2] / "config" / "cruise.dbc"


def drive(frames: int = 50) -> list[Frame]:
    codec = Codec.load(DBC, CanSettings())
    values = [{"ground_speed_mps": 0.1 * (k % 50), "pump_current_ma": 10.0 * (k % 100)} for k in range(frames)]
    return [codec.encode("DriveFeedback", value, 1_700_000_000 + 0.02 * k) for k, value in enumerate(values)]


def written(path: Path, frames: list[Frame]) -> Path:
    with LogWriter.create(path) as log:
        for frame in frames:
            log.write(frame)
        assert log.frames == len(frames)
    return path


def same(read: list[Frame], frames: list[Frame], time_s: float) -> None:
    assert [(f.arbitration_id, f.is_extended_id, bytes(f.data)) for f in read] == [
        (f.arbitration_id, f.is_extended_id, bytes(f.data)) for f in frames
    ]
    assert [f.timestamp for f in read] == pytest.approx([f.timestamp for f in frames], rel=0, abs=time_s)


def test_what_is_written_is_read(tmp_path: Path):
    frames = [*drive(), Frame(arbitration_id=0x711, is_extended_id=False, data=b"\x7f", timestamp=1_700_000_001.5)]
    same(list(read_log(written(tmp_path / "drive.log", frames))), frames, 1e-6)


def test_the_line_is_candumps(tmp_path: Path):
    frame = Frame(arbitration_id=0x0CF00400, data=bytes.fromhex("FFFFFFE02EFFFFFF"), timestamp=1.25, is_rx=False)
    assert written(tmp_path / "a.log", [frame]).read_text() == "(1.250000) can0 0CF00400#FFFFFFE02EFFFFFF T\n"


def test_times_are_kept_where_they_run_back(tmp_path: Path):
    frames = [Frame(arbitration_id=1, timestamp=time_s) for time_s in (2.0, 1.5, 0.0, 3.0)]
    assert [f.timestamp for f in read_log(written(tmp_path / "a.log", frames))] == [2.0, 1.5, 0.0, 3.0]


def test_an_error_frame_stays_one_and_keeps_its_class(tmp_path: Path):
    off = Frame(arbitration_id=0x40, is_error_frame=True, data=bytes(8), timestamp=1.0)
    path = written(tmp_path / "a.log", [off, *drive(1)])
    assert path.read_text().splitlines()[0].split()[2] == "20000040#0000000000000000"
    assert [f.is_error_frame for f in read_log(path)] == [True, False]


@pytest.mark.parametrize("suffix", [".log", ".log.gz"])
def test_what_candump_wrote_of_any_error_is_no_data(tmp_path: Path, suffix: str):
    """Bus-off, controller passive, lost arbitration; between them what python-can takes for errors itself, and data."""
    lines = ("20000040#00", "20000004#0020", "20000002#01", "20000080#", "00000004#01", "123#20000080")
    text = "".join(f"({k}.000000) can0 {line}\n" for k, line in enumerate(lines))
    path = tmp_path / f"a{suffix}"
    path.write_bytes(gzip.compress(text.encode()) if suffix.endswith("gz") else text.encode())
    assert [f.is_error_frame for f in read_log(path)] == [True, True, True, True, False, False]


def test_what_is_flushed_can_be_read_by_others(tmp_path: Path):
    with LogWriter.create(tmp_path / "a.log") as log:
        log.write(drive(1)[0])
        log.flush()
        assert len(list(read_log(tmp_path / "a.log"))) == 1


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".csv", ".trc", ".log.gz", ".asc.gz"])
def test_other_formats(tmp_path: Path, suffix: str):
    frames = drive()
    path = tmp_path / f"drive{suffix}"
    with can.Logger(path) as logger:
        for frame in frames:
            logger(frame)
    read = list(read_log(path))
    offset_s = read[0].timestamp - frames[0].timestamp  # .asc and .trc count from their beginning
    for frame in read:
        frame.timestamp -= offset_s
    same(read, frames, 1e-3)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("(1.0) can0 0CF00400#FFFF", ""),  # whole by chance: the codec finds it too short
        ("(1.0) can0 0CF0", "the line is not one of a log that ends in .log; mend it"),
        ("(1.", "the line is not one"),
        ("(1.0) can0 0CF00400#FFFZ", "invalid literal"),
        ("time_s,pump_current_ma,ground_speed_mps", "is it a log of another kind"),
    ],
)
def test_a_broken_line_is_named_after_all_frames_before_it(tmp_path: Path, line: str, reason: str):
    path = written(tmp_path / "drive.log", drive(3))
    path.write_text(path.read_text() + "\n" + line)
    read = read_log(path)
    assert [next(read) for _ in range(3)]
    if not reason:
        assert len(list(read)) == 1
        return
    with pytest.raises(LogError, match=f"^{path}:5: cannot be read: .*{reason}") as caught:
        next(read)
    assert isinstance(caught.value.__cause__, ValueError)


def cut(path: Path, share: float) -> Path:
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    return path


@pytest.mark.parametrize("suffix", [".blf", ".log.gz", ".asc", ".asc.gz"])
def test_a_file_that_was_cut_off(tmp_path: Path, suffix: str):
    path = tmp_path / f"drive{suffix}"
    with can.Logger(path) as logger:
        for frame in drive(5000):
            logger(frame)
    with pytest.raises(BrokenLogError, match=rf"drive{suffix}.* (ends after frame|cannot be read)"):
        list(read_log(cut(path, 0.6)))


def test_a_broken_line_with_more_behind_it_is_no_end(tmp_path: Path):
    path = written(tmp_path / "drive.log", drive(3))
    path.write_text(path.read_text() + "(1.\n\n")
    with pytest.raises(BrokenLogError, match=":4: cannot be read"):
        list(read_log(path))
    path.write_text(path.read_text() + "(1.0) can0 0CF00400#FFFF\n")
    with pytest.raises(LogError, match=":4: cannot be read") as caught:
        list(read_log(path))
    assert not isinstance(caught.value, BrokenLogError)


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # python-can's readers, on files that are none
@pytest.mark.parametrize("suffix", [".blf", ".db", ".mf4", ".log", ".asc", ".trc", ".csv", ".log.gz"])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00rubbish\n" * 50, gzip.compress(b"\x00\xff" * 99, mtime=0)])
def test_rubbish_under_every_name(tmp_path: Path, suffix: str, content: bytes):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(LogError, match=f"^{path}"):
        list(read_log(path))


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # python-can's readers, on files that are none
@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.blf", b"", "holds less than a log that ends in .blf does; copy it again"),
        ("a.asc", b"\xff\xfe\x00rubbish\n", "it is not text, as a log that ends in .asc is"),
        ("a.b.trc", b"\xff\xfe\x00rubbish\n", "it is not text, as a log that ends in .trc is"),
        ("a.log", b"hello\n", "the line is not one of a log that ends in .log"),
    ],
)
def test_what_a_file_is_not_is_said_without_the_reader_s_own_words(tmp_path: Path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError) as caught:
        list(read_log(tmp_path / name))
    assert said in str(caught.value)
    assert "is it a log of another kind? give it the ending of its own" in str(caught.value)


def test_a_file_that_is_no_log(tmp_path: Path):
    path = tmp_path / "drive.txt"
    path.write_text("x")
    with pytest.raises(LogError, match=r"unknown log format \"\.txt\""):
        list(read_log(path))
    with pytest.raises(LogError, match="no such file"):
        list(read_log(tmp_path / "none.log"))


def test_a_log_that_cannot_be_written(tmp_path: Path):
    with pytest.raises(LogError, match="cannot be written: No such file"):
        LogWriter.create(tmp_path / "none" / "a.log")
    with pytest.raises(LogError, match=r"let the name end in \.log"):
        LogWriter.create(tmp_path / "a.blf")
