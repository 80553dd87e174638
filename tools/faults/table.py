"""The table of faults: what each does, which redundancy could reveal it, and what makes it, in random sizes."""

from typing import Final

from .bus_rows import BUS
from .inside_rows import INSIDE
from .row import FaultRow
from .sensor_rows import SENSORS

FAULTS: Final[dict[str, FaultRow]] = {row.name: row for row in (*BUS, *SENSORS, *INSIDE)}
