"""`cruise diagnose`: which physical effect a model lacks, on what evidence, and what to drive where that is open."""

import json
import math
import shlex
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console

from cruise.cli import diagnose_evidence as evidence
from cruise.cli import diagnose_picture, diagnose_words
from cruise.cli.diagnose_curve import curve
from cruise.cli.diagnose_evidence import Number
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
    model_named,
    notes_of,
    prepared_by,
    tables,
)
from cruise.identification.regressors import FitError
from cruise.model import files
from cruise.validation import ladder
from cruise.validation.diagnose import SEED, UNNAMED, Diagnosis
from cruise.validation.diagnose import diagnose as search

UNFILTERED_HZ: Final = 0.0  # the search weighs frequencies itself
CURVE_SHOWN: Final = 9  # points of a curve in --json


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
            said["picture"] = str(diagnose_picture.draw(found, floor, wanted))
    if as_json or floor is None:
        print(json.dumps(said, indent=2))
        return
    options = {"--columns": columns, "--input": input_name, "--output": output_name, "--database": database}
    options |= {"--period": period, "--horizon": None if horizon == 3.0 else horizon}
    given = [word for name, value in options.items() if value is not None for word in (name, str(value))]
    files_given = [shlex.quote(str(one)) for one in recordings]
    diagnose_words.say(found, floor, model, files_given, [shlex.quote(word) for word in given], said["picture"])


def report(found: Diagnosis, model: str, structure: str) -> dict[str, Any]:
    """The verdict as the design has it, then what it rests on; what is no number is null, so that it is JSON."""
    final, base = evidence.known(found), found.base
    numbers = evidence.numbers(found.study, final)
    return {
        "verdict": found.verdict.value,
        "effects": list(found.effects),
        "signals": list(found.signals),
        "ranking": [
            {
                "effect": one.effect,
                "error_before_mps": _number(one.error_before_mps),
                "error_after_mps": _number(one.error_after_mps),
                "confidence": _number(one.confidence),
            }
            for one in found.ranking
        ],
        "look_alikes": [list(alike) for alike in found.look_alikes],
        "next_experiment": found.next_experiment,
        "confidence": _number(found.confidence),
        "error_before_mps": _number(evidence.error_mps(base)),
        "error_after_mps": _number(evidence.error_mps(final)),
        "horizon_s": found.study.horizon_s,
        "model": model,
        "structure": structure,
        "recordings": [one.source for one in found.study.recordings],
        "samples": sum(len(one) for one in found.study.recordings),
        "period_s": found.study.period_s,
        "notes": notes_of(found.study.recordings),
        "refused": [{"effect": one.effect, "reason": one.reason} for one in found.refused],
        "parameters": {
            name: [_figures(one) for one in evidence.numbers_of(name, numbers)]
            for name in evidence.members(final.explanation)
            if name not in evidence.members(base.explanation)
        },
        "moved": [
            {
                "of": one.before.owner,
                "name": one.before.name,
                "unit": one.before.unit,
                "before": _number(one.before.value),
                "before_standard_error": _number(one.before.std),
                "after": _number(one.after.value),
                "after_standard_error": _number(one.after.std),
            }
            for one in evidence.moved(evidence.numbers(found.study, base), numbers)
        ],
        "steps": [
            {
                "added": list(one.added),
                "dropped": list(one.dropped),
                "error_before_mps": _number(one.error_before_mps),
                "error_after_mps": _number(one.error_after_mps),
            }
            for one in evidence.rungs(found)
        ],
        "tried": [
            {
                "effect": one.name,
                "gain": _number(one.gain),
                "standard_errors": _number(one.sureness),
                "evidence": _number(one.evidence),
                "counts": one.credit,
            }
            for one in found.steps[0].tried
        ],
        "dependence": _dependence(found),
        "seed": SEED,
    }


def _figures(one: Number) -> dict[str, Any]:
    return {
        "name": one.name,
        "value": _number(one.value),
        "standard_error": _number(one.std),
        "unit": one.unit,
        "low": _number(one.low),
        "high": _number(one.high),
        "plausible": one.plausible,
        "remark": one.remark,
    }


def _dependence(found: Diagnosis) -> list[dict[str, Any]]:
    """The curve of every dependence that no effect describes."""
    result = []
    for name in evidence.members(found.final.explanation):
        if name.startswith(UNNAMED):
            drawn = curve(found.study, found.base, found.final, name)
            picked = slice(None, None, max(len(drawn.x) // CURVE_SHOWN, 1))
            std = drawn.std if drawn.std is not None else drawn.y * math.nan
            result.append(
                {
                    "signal": name.removeprefix(UNNAMED),
                    "of": drawn.y_words,
                    "values": drawn.x[picked].tolist(),
                    "curve": drawn.y[picked].tolist(),
                    "standard_error": [_number(value) for value in std[picked].tolist()],
                }
            )
    return result


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
