"""How the verbs that look at recordings read them, which model they mean, and what they are told in numbers."""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from cruise import settings
from cruise.cli.places import CONFIG
from cruise.identification.preparation import PreparationSettings
from cruise.model import files
from cruise.model.model import Model
from cruise.recording import Recording, RecordingError
from cruise.service.recordings import ReadingSettings, Told, read_recordings
from cruise.settings import SettingsError

PICTURES = (".png", ".svg", ".pdf")
MODEL_FILES = (".yaml", ".yml")
NOTES_SHOWN = 5  # of the recordings; forty files have forty alike

Recordings = Annotated[
    list[Path],
    typer.Argument(
        help="One experiment each: tables (.csv .parquet), logs of the bus (.log .asc .blf .trc .db .mf4), "
        "measurements with a channel a signal (.mf4).",
        show_default=False,
    ),
]
Columns = Annotated[Path | None, typer.Option(help="Settings file: what the columns mean, units, database.")]
Database = Annotated[Path | None, typer.Option(help="DBC file of the logs; default: config/cruise.dbc.")]
InputName = Annotated[str | None, typer.Option("--input", help="Column of the current.")]
OutputName = Annotated[str | None, typer.Option("--output", help="Column of the speed.")]
ModelPeriod = Annotated[
    float | None, typer.Option("--period", help="Sampling period in s; default: the model file's, or 0.2.")
]
Cutoff = Annotated[float, typer.Option(help="Filter of the training data in Hz; 0: none.")]
Horizon = Annotated[float, typer.Option(help="How far ahead predictions are judged, in s.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures as JSON and nothing else.")]


def columns_of(
    columns: Path | None, input_name: str | None, output_name: str | None, database: Path | None = None
) -> ReadingSettings:
    """The settings by which recordings are read: a file's, with what is named on the command line over them."""
    read = settings.load(columns, ReadingSettings) if columns else ReadingSettings()
    named = str(columns.parent / read.database) if columns and read.database else str(CONFIG / "cruise.dbc")
    return msgspec.structs.replace(
        read,
        input=input_name or read.input,
        output=output_name or read.output,
        database=str(database) if database else named,
    )


def tables(paths: list[Path], read: ReadingSettings, period_s: float | None = None, model: str = "") -> list[Recording]:
    """The recordings of these files, each on its own grid or that of `period_s`, their input as a model file has it."""
    for path in paths:
        if path.is_dir():
            raise RecordingError(f"{path}: is a folder; name the recordings in it, as {path / '*.csv'} does")
        if not path.exists():
            raise RecordingError(f"{path}: no such file")
    return read_recordings(paths, read, period_s, told_by(model))


def told_by(model: str) -> Told | None:
    """How the input of the recordings of a model file was read; None where `model` is none."""
    if not model.endswith(MODEL_FILES):
        return None
    made = files.read(model).provenance
    return Told(made.input_unit, made.input_rest_ma, model)


def prepared_by(period_s: float | None, cutoff_hz: float, file: Model | None) -> PreparationSettings:
    """How training data are prepared, as the command line says or the model file. SettingsError for no such numbers."""
    if not 0.0 <= cutoff_hz < math.inf:
        raise SettingsError(f"--cutoff {cutoff_hz:g}: give a frequency in Hz, or 0 for no filter")
    default_s = PreparationSettings().period_s if file is None else file.period_s
    chosen_s = default_s if period_s is None else above_zero("--period", period_s)
    return PreparationSettings(period_s=chosen_s, cutoff_hz=cutoff_hz)


def above_zero(option: str, value_s: float) -> float:
    """The time in s that an option gives. SettingsError where it is none."""
    if not 0.0 < value_s < math.inf:
        raise SettingsError(f"{option} {value_s:g}: give a time in s above 0")
    return value_s


def destination(option: str, path: Path, endings: Sequence[str]) -> Path:
    """`path` with its folder made, so that an hour's fit is not lost. SettingsError where no file can go there."""
    if path.suffix.lower() not in endings:
        raise SettingsError(f"{option} {path}: let the name end in {' or '.join(endings)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"{option} {path}: the folder can't be made: {error.strerror}") from error
    if path.is_dir():
        raise SettingsError(f"{option} {path}: is a folder; give the name of a file")
    return path


def writable(option: str, path: Path, endings: Sequence[str] = MODEL_FILES) -> Path:
    """`path` as `destination` gives it. SettingsError where no such file can be written.

    So it is found out before the fit, or the drive, that none is lost.
    """
    destination(option, path, endings)
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise SettingsError(f"{option} {path}: can't be written: {error.strerror}") from error
    return path


def count_of(number: int, thing: str) -> str:
    """1 recording, 2 recordings."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
