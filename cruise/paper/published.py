"""What the paper printed, as data. Nothing of it is used to compute anything of ours."""

from pathlib import Path

import msgspec

from cruise import settings


class Gain(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of Table VI: gain relative to the empty machine on level ground."""

    grade_deg: float
    machine_mass_kg: float
    gain_pct: float


class Published(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The figures of the tables, and the numbers that the text gives of the pictures; null is the paper's "-"."""

    explained_pct: dict[str, dict[str, tuple[float | None, float | None]]]  # table, model: at 20 and at 5 Hz
    steps_explained_pct: dict[str, float | None]
    dc_gain_pct: tuple[Gain, ...]
    correlation_peak_s: float
    cutoff_hz: float
    bump_hz: tuple[float, float]


def load(path: str | Path) -> Published:
    """Read the published figures."""
    return settings.load(path, Published)
