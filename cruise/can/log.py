"""Logs of the bus: written as candump does, read in every format that python-can reads, timestamps kept.

A candump line is `(seconds) interface identifier#data`, with microseconds: a timestamp comes back to within 0.5 us.
A log that ends in the middle, as one does when the power goes, gives all its whole frames before the error.
"""

import gzip
import importlib
import re
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TextIO, cast

import can
import can.io.mf4
from can.io.blf import BLFParseError

from cruise.can.frame import Frame
from cruise.settings import named

CANDUMP: Final = ".log"
MEASUREMENT: Final = ".mf4"  # of the MDF format, in which there may be frames, too
_ERROR: Final = 0x20000000  # in candump's identifiers the flag of an error frame; below it is the error's class
_ANY_ERROR: Final = re.compile(r" [23][0-9A-Fa-f]{7}#")
_KNOWN_ERROR: Final = " 20000080#"  # the only class of which python-can knows that it is an error
# What python-can's readers raise on files that are not what their name says.
_UNREADABLE: Final = (
    ValueError,
    LookupError,
    TypeError,
    OSError,
    EOFError,
    NotImplementedError,
    struct.error,
    zlib.error,
    sqlite3.Error,
    can.CanError,
    BLFParseError,
)


class LogError(ValueError):
    """A log that cannot be read or written; the message names the file, the place in it where known, and what to do."""


class BrokenLogError(LogError):
    """A log that breaks off after whole frames, with nothing behind that could be read; `reason` says how."""

    def __init__(self, place: str, reason: str) -> None:
        super().__init__(f"{place}: {reason}")
        self.reason = reason


def check_name(path: str | Path) -> None:
    """LogError where no log is written under such a name."""
    if Path(path).suffix != CANDUMP:
        raise LogError(f"{path}: logs are written as candump logs; let the name end in {CANDUMP}")


class LogWriter:
    """A candump log that is being written; a context manager. `frames` counts what it holds."""

    def __init__(self, writer: can.CanutilsLogWriter) -> None:
        self.frames = 0
        self._writer = writer
        self._name = str(getattr(writer.file, "name", "log"))

    @classmethod
    def create(cls, path: str | Path, channel: str = "can0") -> Self:
        """Begin a new log at `path`, over an older one; `channel` is the interface's name in it. Raises LogError."""
        check_name(path)
        try:
            return cls(can.CanutilsLogWriter(path, channel=channel))
        except OSError as error:
            raise LogError(f"{path}: cannot be written: {error.strerror}") from error

    @classmethod
    def into(cls, stream: TextIO, channel: str = "can0") -> Self:
        """Begin a log in a stream that is open for writing; it is closed with the log."""
        return cls(can.CanutilsLogWriter(stream, channel=channel))

    def write(self, frame: Frame) -> None:
        """Append one frame."""
        if frame.is_error_frame:  # of whose class the writer knows but one
            frame = Frame(frame.timestamp, _ERROR | frame.arbitration_id, data=frame.data, channel=frame.channel)
        # The writer would lift a time below the last one; frames of two senders may come out of order.
        self._writer.last_timestamp = frame.timestamp
        with named(self._name):
            self._writer.on_message_received(frame)
        self.frames += 1

    def flush(self) -> None:
        """Hand to the system what has been written."""
        with named(self._name):
            self._writer.file.flush()

    def fileno(self) -> int:
        """The file's descriptor."""
        return self._writer.file.fileno()

    def close(self) -> None:
        """End the log."""
        with named(self._name):
            self._writer.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_log(path: str | Path) -> Iterator[Frame]:
    """Yield the frames of a log in the order of the file: .log, .asc, .blf, .csv, .trc, ..., each also with .gz.

    Raises LogError for a file that is missing, of another kind, or broken: after the frames before the break, and as
    BrokenLogError where it is the file's end that is broken.
    """
    file = Path(path)
    if not file.is_file():
        raise LogError(f"{path}: no such file; give the path of a recorded log")
    frames, goes_on, missing = 0, False, ""
    unreadable = _UNREADABLE + (_of_asammdf() if MEASUREMENT in map(str.lower, file.suffixes) else ())
    try:
        with can.LogReader(file) as reader:
            if isinstance(reader, can.CanutilsLogReader):
                reader.file = cast(TextIO, _with_known_errors(reader.file))
            try:
                for frame in reader:
                    yield frame
                    frames += 1
            except ValueError:  # a line that holds no frame
                goes_on = isinstance(reader, can.CanutilsLogReader) and any(map(str.strip, reader.file))
                raise
            if isinstance(reader, can.BLFReader) and reader.file_size > file.stat().st_size:
                missing = f"{reader.file_size - file.stat().st_size} bytes before its end"
            if isinstance(reader, can.ASCReader) and _unfinished(file):
                missing = "before the end of its trigger block"
    except unreadable as error:
        place, reason = f"{path}{_place(file, frames)}", f"cannot be read: {_in_words(error, file)}"
        if goes_on or not frames:
            raise LogError(f"{place}: {reason}") from error
        raise BrokenLogError(place, reason) from error
    if frames == 0:
        raise LogError(f"{path}: no CAN frame in it; is it a log of another kind?")
    if missing:
        raise BrokenLogError(str(path), f"ends after frame {frames}, {missing}; copy it again")


def _of_asammdf() -> tuple[type[Exception], ...]:
    """Return what asammdf raises, and let python-can find it: that looked for it once, when it was imported."""
    try:
        from asammdf.blocks.utils import MdfException
    except ImportError:  # python-can says what to install
        return ()
    importlib.reload(can.io.mf4)
    return (MdfException,)


def _with_known_errors(lines: TextIO) -> Iterator[str]:
    """Yield candump's lines, each error of a class that python-can takes for one; closed, it closes the file."""
    with lines:
        for line in lines:
            yield _ANY_ERROR.sub(_KNOWN_ERROR, line)


def _unfinished(file: Path) -> bool:
    """Return whether an .asc log begins a trigger block that it does not end."""
    opened = gzip.open if file.suffix.lower() == ".gz" else open
    with opened(file, "rt", errors="replace") as lines:
        marks = [line.split()[0].lower() for line in lines if "triggerblock" in line.lower()]
    return marks[-1:] == ["begin"]


def _in_words(error: Exception, file: Path) -> str:
    """Return what is wrong with a log, where python-can's readers only stumbled over it."""
    kind = "".join(file.suffixes[-2:] if file.suffix.lower() == ".gz" else [file.suffix])
    other = "is it a log of another kind? give it the ending of its own"
    if isinstance(error, UnicodeDecodeError):
        return f"it is not text, as a log that ends in {kind} is; {other}"
    if isinstance(error, struct.error):
        return f"it holds less than a log that ends in {kind} does; copy it again; or {other}"
    if isinstance(error, ValueError) and "to unpack" in str(error):
        return f"the line is not one of a log that ends in {kind}; mend it, or {other}"
    return str(error) or type(error).__name__


def _place(file: Path, frames: int) -> str:
    """Return where reading stopped: a candump log has one frame in every line that is not blank."""
    if file.suffix != CANDUMP:
        return f", after frame {frames}" if frames else ""
    with file.open("rb") as lines:
        filled = (number for number, line in enumerate(lines, 1) if line.strip())
        return f":{next(islice(filled, frames, None), 1)}"
