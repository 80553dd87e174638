"""`cruise explore`: what recordings say before any model is fitted."""

import json
from pathlib import Path
from typing import Annotated

import typer

from cruise.cli import explore_picture
from cruise.cli.console import bold, printer
from cruise.cli.places import OUT
from cruise.cli.reading import (
    PICTURES,
    AsJson,
    Columns,
    Database,
    InputName,
    OutputName,
    Recordings,
    above_zero,
    columns_of,
    count_of,
    tables,
    writable,
)
from cruise.grid import sensible_step, typical_step
from cruise.identification import explore as analyses
from cruise.recording import Recording, RecordingError, too_slow

HEADINGS = {
    "quality": "data quality",
    "excitation": "excitation",
    "frequency_response": "frequency response",
    "cross_correlation": "cross-correlation",
    "static_curve": "static curve",
}


def explore(
    recordings: Recordings,
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    database: Database = None,
    period: Annotated[float | None, typer.Option(help="Sampling period in s; default: the data's own.")] = None,
    picture: Annotated[Path, typer.Option(help="Where the picture goes.")] = OUT / "explore.png",
    as_json: AsJson = False,
) -> None:
    """Say what recordings hold: response, delay, static curve, excitation and the quality of the data."""
    writable("--picture", picture, PICTURES)
    if period is not None:
        above_zero("--period", period)
    read = tables(recordings, columns_of(columns, input_name, output_name, database), period)
    _check_rates(read)
    found = analyses.explore(read, [one.stamps_s for one in read if one.stamps_s is not None])
    drawn = explore_picture.draw(found, picture)
    if as_json:
        print(json.dumps({**found.report(), "picture": str(drawn)}, indent=2))
    else:
        _print(found, drawn)


def _check_rates(read: list[Recording]) -> None:
    """RecordingError where a recording's own step is longer than its grid's: what lies between was never measured."""
    for one in read:
        if one.stamps_s is None:
            continue
        own_s = sensible_step(one.stamps_s, typical_step(one.stamps_s))
        slow = too_slow(own_s, one.dt_s, "a period")
        if slow:
            raise RecordingError(f"{one.source} is {slow}: give --period {own_s:g} or more, or record faster")


def _print(found: analyses.Exploration, drawn: Path) -> None:
    console = printer()
    console.print(
        f"{count_of(len(found.recordings), 'recording')}, {found.samples} samples of {found.period_s:g} s, "
        f"{found.duration_s:.4g} s"
    )
    notes = found.quality.notes if isinstance(found.quality, analyses.Quality) else ()
    for note in notes:
        console.print(f"note: {note}")
    for name, sentences in found.words().items():
        console.print(bold(f"\n{HEADINGS[name]}"))
        for sentence in sentences:
            console.print(f"  {sentence}")
    console.print(f"\npicture: {drawn}")
