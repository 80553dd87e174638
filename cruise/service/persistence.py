"""What survives a restart: learned parameters, statistics, settings that were written and stored by SDO. Of one
machine, what was learned of one model as well, never half written.

A file is one line with the checksum of the rest, then JSON with a version. A new one is written beside the old one and
takes its place in one step; the old one stays as `NAME.previous`, and is read where the new one is broken:

    NAME.new: write, fsync;    NAME.previous: link to NAME;    NAME.new becomes NAME;    fsync of the folder

so that at every instant NAME or NAME.previous is whole. What belongs to another machine, or was written by another
version, is not used: it stays until the first write, which moves it to `NAME.of-MACHINE.vVERSION`, one file for each,
and is read again where its machine and version are back. With another model, or settings under which nothing like it
can be learned, what was learned is forgotten; settings, a lower top speed among them, and statistics are the machine's
and stay.

One service at a time has the folder: two would take turns to undo what the other has learned.

Sources: rename(2), fsync(2), flock(2); T. Pillai et al., "All file systems are not created equal", OSDI 2014.
"""

import fcntl
import hashlib
import os
import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final
from urllib.parse import quote

import msgspec

from cruise.model.model import Model
from cruise.settings import SettingsError

VERSION: Final = 1
USUAL_BYTES: Final = 10_000  # a state has a few kB
MAX_BYTES: Final = 1_000_000
LONGEST: Final = 100  # characters of a machine's name that go into a file's name, which may have 255 bytes
Count = Annotated[int, msgspec.Meta(ge=0)]
Amount = Annotated[float, msgspec.Meta(ge=0)]


class PersistenceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the state is kept, and whose it is."""

    machine: Annotated[str, msgspec.Meta(min_length=1)]  # serial number, or any name that no other machine has
    folder: str = "/var/lib/cruise"
    every_s: Annotated[float, msgspec.Meta(gt=0)] = 30.0  # s, at most this much is lost with the power


class Statistics(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the machine has done in all its runs."""

    starts: Count = 0
    run_s: Amount = 0.0
    engaged_s: Amount = 0.0
    distance_m: Amount = 0.0  # while engaged
    exits: dict[str, Count] = {}  # by condition
    decisions: dict[str, Count] = {}  # about learned models, by what was decided and why


class Kept(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The state of one machine. `learned` is what Estimator.save gave, `settings` what is other than in the file."""

    machine: str
    model: str  # fingerprint of the factory model that what was learned belongs to
    learned: dict[str, Any]
    statistics: Statistics
    settings: dict[str, Any] = {}
    version: int = VERSION


class Owner(msgspec.Struct, frozen=True, kw_only=True):
    """Whose a state is: what one of any version says."""

    machine: str
    version: int

    @property
    def label(self) -> str:
        """What a file's name calls it."""
        name = quote(self.machine, safe="")
        return f"of-{name if len(name) <= LONGEST else _digest(self.machine)}.v{self.version}"


class BrokenStateError(ValueError):
    """A state that cannot be used; the message says which file and why."""


@dataclass(frozen=True, slots=True)
class Found:
    """What was read: the state, None if there is none, and what is to be said of the files on the way to it."""

    kept: Kept | None
    problems: tuple[str, ...]


def fingerprint(model: Model) -> str:
    """Return what tells one factory model from another: structure, shapes and parameters."""
    return _digest(repr(model))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@contextmanager
def held(folder: Path) -> Iterator[str]:
    """Have `folder` for ourselves; what keeps us from that, in words, or nothing. SettingsError where another has it.

    The lock is on the folder itself: it takes no file, holds on a disk that is read only too, and goes with its process
    however that ends. A file system without locks keeps nobody out, which is no reason not to drive.
    """
    descriptor, problem = os.open(folder, os.O_RDONLY), ""
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise SettingsError(
                f"persistence.folder: another `cruise run` has {folder}; stop that one, or give this one a folder of "
                "its own"
            ) from error
        except OSError as error:
            problem = f"{folder} can't be locked ({error.strerror}): nothing keeps a second `cruise run` out of it"
        yield problem
    finally:
        os.close(descriptor)


class StateFile:
    """The state of one machine with one model in one file; one writer at a time."""

    def __init__(self, path: Path, machine: str, model: str) -> None:
        self.path = path
        self.previous = path.with_name(f"{path.name}.previous")
        self.owner = Owner(machine=machine, version=VERSION)
        self.aside = self._aside(self.owner)  # ours, from before another machine's came
        self.model = model

    def write(self, kept: Kept) -> None:
        """Put `kept` in place of what is there, and that aside if it is another's.

        Raises OSError; what was there is then still there.
        """
        body = msgspec.json.encode(kept)
        new, link = self.path.with_name(f"{self.path.name}.new"), self.path.with_name(f"{self.path.name}.link")
        _to_disk(new, hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
        for path in (self.previous, self.path):  # in this order: of one owner the newest is what stays
            owner = self._owner(path)
            if owner is not None and owner != self.owner:
                path.replace(self._aside(owner))
        if self._owner(self.path) is not None:  # a broken one must not take the place of a good one
            link.unlink(missing_ok=True)
            os.link(self.path, link)
            link.replace(self.previous)
        new.replace(self.path)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        self.aside.unlink(missing_ok=True)  # what is newer is on the disk

    def try_to_write(self) -> None:
        """Write as much as a state has, and take it away again. Raises OSError."""
        new = self.path.with_name(f"{self.path.name}.new")
        _to_disk(new, bytes(USUAL_BYTES))
        new.unlink()

    def read(self, check: Callable[[Kept], None] = lambda kept: None) -> Found:
        """Return the newest state that is whole and ours, with what was learned last of which `check` raises no error.

        `check` raises ValueError, LookupError or TypeError; where it always does, nothing was learned.
        """
        problems, newest = [], None
        for path in (self.path, self.previous, self.aside):
            try:
                owner, kept = self._read(path)
                if kept is None:
                    problems.append(self._of_another(owner))
                    continue
                if path == self.aside:
                    problems.append(f"{path}: this machine is back: its state is taken up again")
                newest = newest or kept
                if kept.model != self.model:
                    problems.append(
                        f"{path}: what was learned is for model {kept.model}, here is {self.model}: forgotten"
                    )
                    return Found(msgspec.structs.replace(newest, model=self.model, learned={}), _once(problems))
                kept = msgspec.structs.replace(newest, learned=kept.learned)
                check(kept)
            except FileNotFoundError:
                continue
            except OSError as error:
                problems.append(f"{path}: cannot be read: {error.strerror}; it is not used")
            except (ValueError, LookupError, TypeError) as error:
                problems.append(str(error) if isinstance(error, BrokenStateError) else f"{path}: {error}")
            else:
                return Found(kept, _once(problems))
        return Found(msgspec.structs.replace(newest, learned={}) if newest else None, _once(problems))

    def _aside(self, owner: Owner) -> Path:
        return self.path.with_name(f"{self.path.name}.{owner.label}")

    def _of_another(self, owner: Owner) -> str:
        """What is said of a state that is not ours; of one owner the same, whichever file it is in."""
        what, found, wanted = (
            ("machine", owner.machine, self.owner.machine)
            if owner.machine != self.owner.machine
            else ("version", owner.version, self.owner.version)
        )
        return (
            f"{self.path.parent}: the state in it is for {what} {found}, here is {wanted}; "
            f"it is not used, and kept as {self._aside(owner).name}"
        )

    def _owner(self, path: Path) -> Owner | None:
        """Whose the state at `path` is; None where there is none that could be used by anybody."""
        try:
            return self._read(path)[0]
        except (OSError, BrokenStateError):
            return None

    def _read(self, path: Path) -> tuple[Owner, Kept | None]:
        """Whose the state at `path` is, and if it is ours, the state."""
        with path.open("rb") as stream:
            checksum, _, body = stream.read(MAX_BYTES).partition(b"\n")
        if hashlib.sha256(body).hexdigest().encode() != checksum:
            raise BrokenStateError(f"{path}: its checksum is wrong; it is not used")
        try:
            owner = msgspec.json.decode(body, type=Owner)
            return owner, msgspec.json.decode(body, type=Kept) if owner == self.owner else None
        except msgspec.MsgspecError as error:
            raise BrokenStateError(f"{path}: not a state of version {VERSION}: {error}") from error


def _to_disk(path: Path, data: bytes) -> None:
    with path.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _once(lines: list[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(lines))


class Keeper:
    """Writes states in a thread of its own, the newest only: the disk must not hold up the loop.

    `settings` go into each of them as they are when it is handed in: they change when they are stored, not with a run.
    """

    def __init__(self, file: StateFile, settings: Mapping[str, Any] | None = None) -> None:
        self.settings = dict(settings or {})
        self.problem = ""  # why the last one could not be written
        self._file = file
        self._waiting: queue.SimpleQueue[tuple[Kept | None, threading.Event]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="keeper", daemon=True)
        self._thread.start()

    def keep(self, kept: Kept) -> threading.Event:
        """Have `kept` written soon; set once it, or a newer one, has been written or could not be."""
        done = threading.Event()
        self._waiting.put((msgspec.structs.replace(kept, settings=self.settings), done))
        return done

    def try_to_write(self) -> None:
        """Find out before there is a state whether it could be written; `problem` says what stands in the way."""
        self._try(self._file.try_to_write)

    def close(self) -> None:
        """Wait until all has been written."""
        self._waiting.put((None, threading.Event()))
        self._thread.join()

    def _work(self) -> None:
        open_ = True
        while open_:
            states = [self._waiting.get()]
            while not self._waiting.empty():
                states.append(self._waiting.get())
            open_ = states[-1][0] is not None
            newest = next((kept for kept, _ in reversed(states) if kept is not None), None)
            try:
                if newest is not None:
                    self._try(partial(self._file.write, newest))
            finally:
                for _, done in states:
                    done.set()

    def _try(self, write: Callable[[], None]) -> None:
        try:
            write()
            self.problem = ""
        except Exception as error:  # noqa: BLE001  # the next state must find the thread alive, whatever it is
            why = error.strerror if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
            self.problem = f"{self._file.path}: cannot be written: {why}"
