"""How the verbs that look at recordings read them, and which model they mean."""

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from cruise import settings
from cruise.identification.structures import PRESETS, Family, Structure, parse
from cruise.model import files
from cruise.model.model import Model
from cruise.recording import Recording, RecordingSettings, read_csv

Recordings = Annotated[list[Path], typer.Argument(help="Tables (.csv), one experiment each.", show_default=False)]
Columns = Annotated[Path | None, typer.Option(help="How the columns of a table are read.")]
InputName = Annotated[str | None, typer.Option("--input", help="Column of the current.")]
OutputName = Annotated[str | None, typer.Option("--output", help="Column of the speed.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures as JSON and nothing else.")]


def columns_of(columns: Path | None, input_name: str | None, output_name: str | None) -> RecordingSettings:
    """The settings by which tables are read: a file's, with input and output named on the command line."""
    read = settings.load(columns, RecordingSettings) if columns else RecordingSettings()
    return msgspec.structs.replace(read, input=input_name or read.input, output=output_name or read.output)


def tables(paths: list[Path], read: RecordingSettings, period_s: float | None = None) -> list[Recording]:
    """The recordings of these files, each on its own grid or on that of `period_s`."""
    return [read_csv(path, read, period_s) for path in paths]


def model_named(text: str) -> tuple[Structure, Model | None]:
    """The structure that a name, a structure written out or a model file means; the file's model beside it."""
    if text in PRESETS or not (text.endswith((".yaml", ".yml")) or Path(text).is_file()):
        return parse(text), None
    file = files.read(text)
    model = files.model_of(text, file)
    effects = tuple(effect.name for effect in model.effects)
    family = Family(file.family)
    return Structure(family, file.na, file.nb, file.delay_s, len(file.noise_parameters), effects=effects), model
