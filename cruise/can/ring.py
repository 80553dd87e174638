"""The black box: the last minutes of the bus in compressed logs of bounded size, frozen around every exit.

    SEGMENT = log-0000001.log.gz, candump lines; the oldest goes where a new one would exceed the bound or fill the disk

A segment can be read up to the last second even where the power went in the middle of it: every second what came is
brought to the disk, for which a thread of its own waits. Those from `before_s` before an exit to `after_s` after it are
frozen: kept as exit-0000001.log.gz, up to half of the bound; then the oldest of them goes. Numbers go on where the last
run ended.
"""

import gzip
import os
import re
import shutil
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, TextIO

import msgspec

from cruise.can.frame import Frame
from cruise.can.log import LogWriter

FLUSH_S = 1.0  # s; what a power cut costs at most
SEGMENT = re.compile(r"(log|exit)-\d{7}\.log\.gz")
AGAIN_S = 1.0  # s after which a segment that could not be opened is tried again
Size = Annotated[int, msgspec.Meta(ge=1_000)]


class RingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How much is kept."""

    size_bytes: Size = 500_000_000  # of all segments; a full bus of 250 kbit/s makes about 25 MB an hour
    left_bytes: Annotated[int, msgspec.Meta(ge=0)] = 50_000_000  # of the disk, for others: the ring is smaller then
    segment_s: Annotated[float, msgspec.Meta(gt=0)] = 60.0
    before_s: Annotated[float, msgspec.Meta(ge=0)] = 60.0
    after_s: Annotated[float, msgspec.Meta(ge=0)] = 30.0


class Ring:
    """Takes frames in; `freeze` keeps what is around now. Times are those of the frames' receiver, monotonic."""

    def __init__(self, folder: Path, settings: RingSettings, channel: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.settings, self.channel = folder, settings, channel
        self.frames = 0
        self._number = max((int(file.name[-14:-7]) for file in self.segments()), default=0)
        self._began: dict[Path, float] = {}  # of this run
        self._frozen_until_s = -1.0
        self._failed: OSError | None = None  # why there is no segment now
        self._disk = ThreadPoolExecutor(1)
        self._under_way: list[Future[None]] = []  # to the disk
        self._open(0.0)

    def segments(self) -> list[Path]:
        """All of them, oldest first; what else lies in the folder is somebody else's."""
        ours = (file for file in self.folder.iterdir() if SEGMENT.fullmatch(file.name))
        return sorted(ours, key=lambda file: file.name[-14:])

    def write(self, frame: Frame, now_s: float) -> None:
        """Append one frame. OSError where the disk is full or gone, the same until the segment could be opened."""
        if now_s >= self._next_s:
            self._go_on(now_s)
        if self._failed is not None:
            raise self._failed.with_traceback(None)
        self._writer.write(frame)
        self.frames += 1
        if now_s >= self._flush_s:
            self._flush_s = now_s + FLUSH_S
            self._writer.flush()
            try:
                self._on_disk()
            finally:
                if not self._under_way:
                    self._bring(os.dup(self._writer.fileno()))
            self._bound()

    def freeze(self, now_s: float) -> None:
        """Keep what was before now, and what comes after."""
        self._frozen_until_s = now_s + self.settings.after_s
        since_s = now_s - self.settings.before_s - self.settings.segment_s
        for path, began_s in list(self._began.items()):
            if began_s >= since_s and path.exists():
                self._keep(path)

    def close(self) -> None:
        """End the last segment; OSError where it, or what was before, did not reach the disk."""
        self._end()
        self._disk.shutdown()
        self._bound()
        self._on_disk()

    def _go_on(self, now_s: float) -> None:
        """End the segment and begin the next."""
        self._next_s = now_s + AGAIN_S
        try:
            self._end()
            self._open(now_s)
            self._failed = None
        except OSError as error:
            self._failed = error

    def _open(self, now_s: float) -> None:
        kind = "exit" if now_s < self._frozen_until_s else "log"
        self._number += 1
        path = self.folder / f"{kind}-{self._number:07}.log.gz"
        self._writer = LogWriter.into(_compressed(path), self.channel)
        self._path, self._began[path] = path, now_s
        self._flush_s, self._next_s = now_s + FLUSH_S, now_s + self.settings.segment_s
        self._bound()

    def _end(self) -> None:
        """End the segment, and have its end brought to the disk; one that could not be opened has none."""
        if self._failed is None:
            descriptor = os.dup(self._writer.fileno())
            try:
                self._writer.close()
            finally:
                self._bring(descriptor)

    def _bring(self, descriptor: int) -> None:
        """Have what the system was given brought to the disk, after what is under way."""
        self._under_way.append(self._disk.submit(_to_disk, descriptor))

    def _on_disk(self) -> None:
        """Forget of what is under way what has arrived; OSError where some of it failed."""
        ended = [one for one in self._under_way if one.done()]
        self._under_way = [one for one in self._under_way if one not in ended]
        for one in ended:
            one.result()

    def _keep(self, path: Path) -> None:
        kept = path.with_name(f"exit-{path.name.partition('-')[2]}")
        path.rename(kept)
        self._began[kept] = self._began.pop(path)
        self._path = kept if path == self._path else self._path

    def _bound(self) -> None:
        """Take the oldest away where there is too much: of the frozen above half of the bound, else of the others.

        Where the disk has little room left, the oldest of the others go.
        """
        segments = [path for path in self.segments() if path != self._path]
        sizes = {path: path.stat().st_size for path in segments}
        total = sum(sizes.values()) + self._path.stat().st_size
        frozen = sum(size for path, size in sizes.items() if path.name.startswith("exit"))
        lacking = self.settings.left_bytes - shutil.disk_usage(self.folder).free
        while (too_much := total > self.settings.size_bytes) or lacking > 0:
            kind = "exit" if too_much and frozen > self.settings.size_bytes // 2 else "log"
            of_kind = [path for path in segments if path.name.startswith(kind)]
            oldest = next(iter(of_kind or (segments if too_much else [])), None)
            if oldest is None:
                break
            segments.remove(oldest)
            total -= sizes[oldest]
            lacking -= sizes[oldest]
            frozen -= sizes[oldest] if oldest.name.startswith("exit") else 0
            self._began.pop(oldest, None)
            oldest.unlink()


def _compressed(path: Path) -> TextIO:
    """A new stream, which is closed with its writer."""
    return gzip.open(path, "wt", encoding="ascii")


def _to_disk(descriptor: int) -> None:
    """Wait until the disk has it, and close the descriptor."""
    try:
        os.fdatasync(descriptor)
    finally:
        os.close(descriptor)
