"""The functions of the command line that the page calls; `cruise workbench` hands them in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cruise.service.recordings import ReadingSettings


@dataclass(frozen=True)
class Tools:
    """Each runs in a process of its own and takes `show` as its last argument; see cruise/workbench/found.py."""

    opened: Callable[..., Any]
    compared: Callable[..., Any]
    diagnosed: Callable[..., Any]
    added: Callable[..., Any]
    by_hand: Callable[..., Any]
    reading: ReadingSettings  # what the columns mean, where nobody says otherwise
    expected: tuple[type[Exception], ...]  # errors that are the user's, with a message for the user
    endings: tuple[str, ...]  # of files that are recordings
    preload: Sequence[str]  # modules that these functions need
    config: Path  # the folder of the settings that come with the program
    cache: Path  # where the bundled recordings are kept
    live: Path | None = None  # settings of the service whose bus is listened to
    upload_bytes: int = 512 * 2**20
