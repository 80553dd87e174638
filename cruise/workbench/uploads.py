"""Files that a browser sends: kept under their own names in the folder of the session, and nowhere else."""

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

from nicegui.elements.upload_files import FileUpload

from cruise.service.recordings import LOGS, MEASUREMENT, TABLES

DATABASE = ".dbc"  # what the frames of a log mean
ENDINGS = (*TABLES, MEASUREMENT, *LOGS, *(f"{ending}.gz" for ending in LOGS), DATABASE)
LONGEST = 240  # bytes of a name: no file system takes more than 255


def plain(name: str) -> str:
    """The name of a file without any folder, as its owner knows it but for what some file system does not take."""
    last = name.replace("\\", "/").rpartition("/")[2]
    bare = re.sub(r'[\x00-\x1f\x7f<>:"|?*]', "_", last).lstrip(".")
    return bare.encode(errors="replace")[-LONGEST:].decode(errors="ignore") or "recording"


async def kept(files: Sequence[FileUpload], folder: Path) -> list[Path | None]:
    """Where files that were sent together are now, each under a name of its own; None for what is no recording.

    They get a folder of their own: what was sent earlier under the same name stays as it is.
    """
    folder.mkdir(parents=True, exist_ok=True)
    mine = Path(tempfile.mkdtemp(dir=folder))
    paths: list[Path | None] = []
    for file, name in zip(files, apart([plain(file.name) for file in files]), strict=True):
        path = mine / name if name.lower().endswith(ENDINGS) else None
        if path is not None:
            await file.save(path)
        paths.append(path)
    return paths


def apart(names: Sequence[str]) -> list[str]:
    """The names, with a number before those that came before: two files are two, though plain they read alike."""
    found: list[str] = []
    for name in names:
        place = next(k for k in range(len(names)) if (f"{k + 1}-{name}" if k else name) not in found)
        found.append(f"{place + 1}-{name}" if place else name)
    return found
