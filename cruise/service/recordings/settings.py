"""How recordings of every kind are read: the columns of any, and by what the frames of a log are decoded."""

from cruise.can.settings import CanSettings
from cruise.columns import RecordingSettings


class ReadingSettings(RecordingSettings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the columns mean; for logs of the bus also the database and the machine that was recorded."""

    database: str | None = None  # DBC file
    can: CanSettings = CanSettings()  # addresses, PGNs and data ids; bus, channel and bit rate don't matter here
