"""`cruise diagnose`: which physical effect a model lacks, on what evidence, and what to drive where that is open."""

import json
import shlex
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console

from cruise.cli import diagnose_words
from cruise.cli.places import OUT
from cruise.cli.reading import (
    PICTURES,
    AsJson,
    Columns,
    Database,
    Horizon,
    InputName,
    ModelPeriod,
    OutputName,
    Recordings,
    above_zero,
    columns_of,
    destination,
    prepared_by,
    tables,
)
from cruise.identification.named import model_named
from cruise.identification.regressors import FitError
from cruise.model import files
from cruise.report import diagnosis_picture, evidence
from cruise.report.diagnosis_figures import report
from cruise.validation import ladder
from cruise.validation.diagnose import diagnose as search

UNFILTERED_HZ: Final = 0.0  # the search weighs frequencies itself


def diagnose(
    recordings: Recordings,
    model: Annotated[str, typer.Option(help="Name (arx1 .. oe8), structure written out, or model file.")],
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    database: Database = None,
    period: ModelPeriod = None,
    horizon: Horizon = 3.0,
    picture: Annotated[
        Path | None, typer.Option(help="Where the picture goes; default: out/diagnose.png, none with --json.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Name the physical effect that a model lacks, or say that nothing is missing, or what to drive to find out."""
    structure, start = model_named(model)
    if structure.nb == 0:
        raise FitError(
            f"{model}: a model without the current has nothing that an effect could act on; give nb=1 or more"
        )
    core = files.read(model).core if start is not None else None
    period_s = prepared_by(period, UNFILTERED_HZ, start).period_s
    above_zero("--horizon", horizon)
    wanted = picture if picture is not None or as_json else OUT / "diagnose.png"
    if wanted is not None:
        destination("--picture", wanted, PICTURES)
    with Console(highlight=False, stderr=True).status("reading") as status:
        native = tables(recordings, columns_of(columns, input_name, output_name, database))
        begun = ladder.begin(native, structure, start, core, period_s, horizon, status.update, at_their_rate=True)
        found = search(begun, status.update)
        status.update("weighing the evidence")
        said, floor = report(found, model, str(structure)), None
        if wanted is not None:
            status.update("looking for the noise floor")
            floor = evidence.floor_of(found, native)
            status.update("drawing")
            said["picture"] = str(diagnosis_picture.draw(found, floor, wanted))
    if as_json or floor is None:
        print(json.dumps(said, indent=2))
        return
    options = {"--columns": columns, "--input": input_name, "--output": output_name, "--database": database}
    options |= {"--period": period, "--horizon": None if horizon == 3.0 else horizon}
    given = [word for name, value in options.items() if value is not None for word in (name, str(value))]
    files_given = [shlex.quote(str(one)) for one in recordings]
    diagnose_words.say(found, floor, model, files_given, [shlex.quote(word) for word in given], said["picture"])
