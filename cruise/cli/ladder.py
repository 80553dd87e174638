"""`cruise ladder`: how the error of a model fell, effect by effect, and the way back."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from cruise import settings
from cruise.cli import ladder_picture
from cruise.cli.console import FIGURES, bold, printer
from cruise.cli.places import REPLAY
from cruise.cli.reading import PICTURES, AsJson, writable
from cruise.model import files
from cruise.model.files import Step
from cruise.model.history import history_of, undone
from cruise.settings import SettingsError


@dataclass(frozen=True, slots=True)
class Rung:
    """One step as it is shown."""

    name: str  # + the effect, or what it began with
    step: Step
    share: float | None  # of the way from the first error down to the noise floor; None: the floor is not known


def ladder(
    model: Annotated[Path, typer.Argument(help="Model file that cruise add wrote.", show_default=False)],
    undo: Annotated[bool, typer.Option("--undo", help="Take the last step back.")] = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Where --undo writes; default: the file.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Where to draw the steps.")] = None,
    as_json: AsJson = False,
) -> None:
    """Show how a model's error fell with every effect that was added to it, or take the last one back."""
    if out is not None and not undo:
        raise SettingsError("--out: says where --undo writes; without --undo nothing is written")
    file = files.read(model)
    files.model_of(model, file)
    if not file.history and file.provenance.made_by == REPLAY:
        note = file.provenance.note
        raise SettingsError(f"{model}: no history in this file, {note}; ask for the ladder of what it began from")
    if undo:
        to, before = out or model, undone(model, file)
        writable("--out", to)
        settings.save(to, before)
        taken = file.history[-1].effect
        if as_json:
            print(json.dumps({"taken_back": taken, "model_file": str(to)}, indent=2))
        else:
            print(f"{taken} taken back; the model before it: {to}")
        return
    rungs = rungs_of(history_of(model, file))
    if not rungs:
        raise SettingsError(f"{model}: no effect was added to it yet; cruise add EFFECT --model {model} does")
    drawn = None
    if picture is not None:
        drawn = ladder_picture.draw(rungs, model.name, writable("--picture", picture, PICTURES))
    if as_json:
        print(json.dumps(report(model, rungs) | ({"picture": str(drawn)} if drawn else {}), indent=2))
    else:
        _print(model, rungs, drawn)


def rungs_of(history: tuple[Step, ...]) -> list[Rung]:
    """The steps with how far down each led."""
    if not history:
        return []
    first = history[0].error_before_mps
    top_mps = history[0].error_after_mps if first is None else first
    rungs = []
    for step in history:
        floor_mps = floor_of(step)
        share = None
        if floor_mps is not None and floor_mps < top_mps:
            share = (top_mps - step.error_after_mps) / (top_mps - floor_mps)
        name = f"+ {', '.join((step.effect, *step.brought_along))}" if step.effect else step.structure
        rungs.append(Rung(name, step, share))
    return rungs


def floor_of(step: Step) -> float | None:
    """The noise floor in m/s: what no model gets below, or, where that is not known, what a flexible one reached."""
    return step.floor_at_most_mps if step.floor_at_least_mps is None else step.floor_at_least_mps


def report(model: Path, rungs: list[Rung]) -> dict[str, Any]:
    """All figures under stable names; what is not known is null."""
    return {
        "model": str(model),
        "steps": [
            {
                "effect": one.step.effect or None,
                "brought_along": list(one.step.brought_along),
                "structure": one.step.structure or None,
                "error_before_mps": one.step.error_before_mps,
                "error_after_mps": one.step.error_after_mps,
                "horizon_s": one.step.horizon_s,
                "share_of_the_way_to_the_floor": one.share,
                "noise_floor": {
                    "at_least_mps": one.step.floor_at_least_mps,
                    "at_most_mps": one.step.floor_at_most_mps,
                },
                "recordings": list(one.step.recordings),
                "samples": one.step.samples,
                "made_on": one.step.made_on,
            }
            for one in rungs
        ],
    }


def _print(model: Path, rungs: list[Rung], drawn: Path | None) -> None:
    console, last = printer(least=FIGURES), rungs[-1].step
    horizons = {one.step.horizon_s for one in rungs}
    console.print(bold(str(model)), soft_wrap=True)
    ahead = f"{last.horizon_s:g} s ahead" if len(horizons) == 1 else "at the horizon of each step"
    table = Table(box=box.SIMPLE_HEAD, title=f"held-out error {ahead}, m/s", title_justify="left", title_style="")
    for heading in ("step", "before", "after", "way down", "recordings", "date"):
        words = heading in ("step", "recordings", "date")
        table.add_column(heading, justify="left" if words else "right", overflow="fold" if words else "ellipsis")
    for one in rungs:
        step = one.step
        table.add_row(
            one.name,
            "" if step.error_before_mps is None else f"{step.error_before_mps:.4f}",
            f"{step.error_after_mps:.4f}",
            "-" if one.share is None else f"{100 * one.share:.0f} %",
            _recordings(step),
            step.made_on,
        )
    console.print(table)
    console.print(floor_in_words(last))
    if len({(one.step.recordings, one.step.horizon_s) for one in rungs}) > 1:
        console.print("Not all steps were judged on the same recordings and horizon: compare before and after only.")
    if drawn is not None:
        console.print(f"picture: {drawn}", soft_wrap=True)


def floor_in_words(step: Step) -> str:
    """Between what the error of the best model of the step's recordings lies."""
    least, most = step.floor_at_least_mps, step.floor_at_most_mps
    if least is None and most is None:
        return "noise floor: not known, the recordings are too short for it"
    said = [] if least is None else [f"no model errs by less than {least:.4f} m/s"]
    if most is not None:
        said.append(f"a flexible one of the same signals reaches {most:.4f} m/s")
    return f"noise floor: {'; '.join(said)}"


def _recordings(step: Step) -> str:
    first, more = Path(step.recordings[0].rpartition(", ")[0] or step.recordings[0]).name, len(step.recordings) - 1
    return f"{first} +{more}" if more else first
