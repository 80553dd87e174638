"""CSV files of a ramp, written into a test's own folder."""

from pathlib import Path

from cruise.columns import RecordingSettings

PLAIN = RecordingSettings()


def file_of(folder: Path, text: str) -> Path:
    path = folder / "drive.csv"
    path.write_text(text, encoding="utf-8")
    return path


def csv_of(folder: Path, rows: list[str], header: str = "time_s,pump_current_ma,ground_speed_mps") -> Path:
    return file_of(folder, "\n".join([header, *rows]) + "\n")


def ramp(count: int = 20, step_s: float = 0.1) -> list[str]:
    """Return rows whose current is 100 times and whose speed is 2 times their time."""
    return [f"{k * step_s:.6g},{100 * k * step_s:.6g},{2 * k * step_s:.6g}" for k in range(count)]
