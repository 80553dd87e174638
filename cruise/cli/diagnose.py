"""`cruise diagnose`: which physical effect a model lacks, on what evidence, and what to drive where that is open."""

import json
import shlex
from pathlib import Path
from typing import Annotated, Final

import typer

from cruise.cli import diagnose_words
from cruise.cli.console import working
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
    prepared_by,
    tables,
    writable,
)
from cruise.identification.families import Linear
from cruise.identification.named import model_named
from cruise.identification.preparation import PreparationSettings
from cruise.identification.regressors import FitError
from cruise.identification.structures import Structure
from cruise.model import files
from cruise.recording import Recording
from cruise.report import diagnosis_picture, evidence
from cruise.report.diagnosis_figures import report
from cruise.signals import INPUT, OUTPUT
from cruise.validation import comparison, ladder
from cruise.validation.diagnose import Verdict
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
    file = files.read(model) if start is not None else None
    core = file.core if file is not None else None
    period_s = prepared_by(period, UNFILTERED_HZ, start).period_s
    above_zero("--horizon", horizon)
    wanted = picture if picture is not None or as_json else OUT / "diagnose.png"
    if wanted is not None:
        writable("--picture", wanted, PICTURES)
    with working("reading") as show:
        read = columns_of(columns, input_name, output_name, database)
        native = tables(recordings, read, model=model)
        begun = ladder.begin(native, structure, start, core, period_s, horizon, show, at_their_rate=True)
        found = search(begun, show)
        show("weighing the evidence")
        said, floor, own = report(found, model, str(structure)), None, None
        if start is not None and file is not None and found.verdict is Verdict.NOTHING:
            show("comparing with its own parameters")
            given = comparison.of_parameters(structure.family, start, file.noise_parameters)
            own = _own(structure, given, native, prepared_by(period, PreparationSettings().cutoff_hz, start), horizon)
        said["own_parameters"] = own and own.figures
        if wanted is not None:
            show("looking for the noise floor")
            floor = evidence.floor_of(found, native)
            show("drawing")
            said["picture"] = str(diagnosis_picture.draw(found, floor, wanted))
    if as_json or floor is None:
        print(json.dumps(said, indent=2))
        return
    options = {"--columns": columns, "--input": input_name, "--output": output_name, "--database": database}
    options |= {"--period": period, "--horizon": None if horizon == 3.0 else horizon}
    words = [word for name, value in options.items() if value is not None for word in (name, str(value))]
    files_given = [shlex.quote(str(one)) for one in recordings]
    called = {INPUT: read.input, OUTPUT: read.output}
    quoted = [shlex.quote(word) for word in words]
    diagnose_words.say(found, floor, model, files_given, quoted, said["picture"], own, called)


def _own(
    structure: Structure, given: Linear, recordings: list[Recording], preparation: PreparationSettings, horizon_s: float
) -> diagnose_words.Own:
    """The errors of the model as its file has it and fitted to the recordings, as `cruise compare` has them."""
    try:
        as_it_is, refitted = (
            comparison.compare(one, recordings, preparation, horizon_s).ahead.rmse_mps
            for one in ((structure, given), structure)
        )
    except FitError as error:
        return diagnose_words.Own(refused=str(error))
    return diagnose_words.Own(as_it_is, refitted)
