"""Logs of the bus: written as candump does, read in every format that python-can reads, timestamps kept.

A candump line is `(seconds) interface identifier#data`, with microseconds: a timestamp comes back to within 0.5 us.
A log that ends in the middle, as one does when the power goes, gives all its whole frames before the error.
"""

import sqlite3
import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TextIO

import can
from can.io.blf import BLFParseError

from cruise.can.frame import Frame

try:  # python-can has imported it by now, where it is installed
    from asammdf.blocks.utils import MdfException
except ImportError:
    MdfException = BLFParseError  # no .mf4 is read then, and python-can says what to install

CANDUMP: Final = ".log"
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
    MdfException,
)


class LogError(ValueError):
    """A log that cannot be read or written; the message names the file, the place in it where known, and what to do."""


class LogWriter:
    """A candump log that is being written; a context manager. `frames` counts what it holds."""

    def __init__(self, writer: can.CanutilsLogWriter) -> None:
        self.frames = 0
        self._writer = writer

    @classmethod
    def create(cls, path: str | Path, channel: str = "can0") -> Self:
        """Begin a new log at `path`, over an older one; `channel` is the interface's name in it. Raises LogError."""
        if Path(path).suffix != CANDUMP:
            raise LogError(f"{path}: logs are written as candump logs; let the name end in {CANDUMP}")
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
        # The writer would lift a time below the last one; frames of two senders may come out of order.
        self._writer.last_timestamp = frame.timestamp
        self._writer.on_message_received(frame)
        self.frames += 1

    def flush(self) -> None:
        """Hand to the system what has been written."""
        self._writer.file.flush()

    def close(self) -> None:
        """End the log."""
        self._writer.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_log(path: str | Path) -> Iterator[Frame]:
    """Yield the frames of a log in the order of the file: .log, .asc, .blf, .csv, .trc, ..., each also with .gz.

    Raises LogError for a file that is missing, of another kind, or broken: after the frames before the break.
    """
    file = Path(path)
    if not file.is_file():
        raise LogError(f"{path}: no such file; give the path of a recorded log")
    frames = 0
    try:
        with can.LogReader(file) as reader:
            for frame in reader:
                yield frame
                frames += 1
            missing_bytes = reader.file_size - file.stat().st_size if isinstance(reader, can.BLFReader) else 0
    except _UNREADABLE as error:
        raise LogError(f"{path}{_place(file, frames)}: cannot be read: {str(error) or type(error).__name__}") from error
    if missing_bytes > 0:
        raise LogError(f"{path}: ends after frame {frames}, {missing_bytes} bytes before its end; copy it again")
    if frames == 0:
        raise LogError(f"{path}: no CAN frame in it; is it a log of another kind?")


def _place(file: Path, frames: int) -> str:
    """Return where reading stopped: a candump log has one frame in every line that is not blank."""
    if file.suffix != CANDUMP:
        return f", after frame {frames}" if frames else ""
    with file.open("rb") as lines:
        filled = (number for number, line in enumerate(lines, 1) if line.strip())
        return f":{next(islice(filled, frames, None), 1)}"
