"""What the workbench is started with."""

from dataclasses import dataclass
from pathlib import Path

from cruise.service.recordings import ReadingSettings


@dataclass(frozen=True)
class Setup:
    """What holds for all who open the page."""

    reading: ReadingSettings  # what the columns mean, where nobody says otherwise
    config: Path  # the folder of the settings that come with the program
    cache: Path  # where the bundled recordings are kept
    live: Path | None = None  # settings of the service whose bus is listened to
    upload_bytes: int = 512 * 2**20
