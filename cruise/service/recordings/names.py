"""The columns, channels or signals of a recording by their own names, before anybody has said what they mean."""

from pathlib import Path

from cruise.can.decoder import Decoder
from cruise.csv_file import header_of
from cruise.service.recordings import MEASUREMENT, is_log
from cruise.service.recordings.bus_log import collect, frames_of_log
from cruise.service.recordings.measurement import channels_of
from cruise.service.recordings.parquet import columns_of
from cruise.service.recordings.settings import ReadingSettings


def names_in(path: str | Path, settings: ReadingSettings) -> list[str]:
    """Return every name that `settings` may speak of. Raises RecordingError, LogError or SettingsError.

    Of a log these are the signals that were heard and that the database describes.
    """
    kind = Path(path).suffix.lower()
    if kind == MEASUREMENT:
        names = channels_of(path)
        if names:
            return names
    elif not is_log(path, settings):
        return header_of(path) if kind == ".csv" else columns_of(path)
    if settings.database is None:
        return []
    heard = collect(frames_of_log(path, []), Decoder.load(settings.database, settings.can))
    return list(dict.fromkeys(name for *_, name in heard.values))
