"""Files that a browser sends: kept under a plain name in the folder of the session, and nowhere else."""

import re
from pathlib import Path

from nicegui.elements.upload_files import FileUpload

from cruise.service.recordings import LOGS, MEASUREMENT, TABLES

DATABASE = ".dbc"  # what the frames of a log mean
ENDINGS = (*TABLES, MEASUREMENT, *LOGS, *(f"{ending}.gz" for ending in LOGS), DATABASE)
LONGEST = 120  # characters of a name


def plain(name: str) -> str:
    """The name of a file without any folder, in characters that mean nothing to a shell or a file system."""
    last = name.replace("\\", "/").rpartition("/")[2]
    return re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-LONGEST:] or "recording"


async def kept(file: FileUpload, folder: Path) -> Path | None:
    """Where the file is now; None where it is no recording by its name."""
    name = plain(file.name)
    if not name.lower().endswith(ENDINGS):
        return None
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    await file.save(path)
    return path
