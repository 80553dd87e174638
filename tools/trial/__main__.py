"""`tools/blind_trial`: recordings with sealed answers, and what the program makes of them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from . import files, picture, run
from .calibration import by_answer, restated
from .draw import draw, mixture
from .effects import EFFECTS, UNLISTED
from .plan import KINDS, plan
from .score import Line
from .score import score as score_of
from .trial import SIZES, Tier
from .words import as_json, show

SIZED: Final = Path("out/blind_trial/sizes.jsonl")

app = typer.Typer(add_completion=False, no_args_is_help=True)

Folders = Annotated[list[Path], typer.Argument(help="Folders of tools/blind_trial score.", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


@app.callback()
def blind_trial() -> None:
    """Recordings of the virtual combine with a hidden effect, and what the program makes of them."""


@app.command()
def make(
    out: Annotated[Path, typer.Option(help="New or empty folder for the CSV files and answers.json.")],
    tier: Annotated[Tier, typer.Option(help="clean or field.")] = "clean",
    count: Annotated[int, typer.Option(min=1, max=9999, help="How many recordings.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same recordings.")] = 0,
    effect: Annotated[str, typer.Option(help="One effect, some joined by +, nothing; default: a mixture.")] = "",
    size: Annotated[str, typer.Option(help=f"Of the effect: {', '.join(SIZES)}.")] = "medium",
) -> None:
    """Write recordings and their sealed answers."""
    try:
        trials = [draw(tier, effect, size, seed + k) for k in range(count)] if effect else mixture(tier, count, seed)
        files.make(out, trials)
    except (ValueError, FileExistsError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"{count} recordings and {files.ANSWERS} in {out}")


@app.command()
def score(
    out: Annotated[Path, typer.Option(help="Folder of the trials held; a run goes on with what is there.")],
    tier: Annotated[Tier, typer.Option(help="clean or field.")] = "clean",
    seeds: Annotated[int, typer.Option(min=1, max=900, help="How many.")] = 5,
    first_seed: Annotated[int, typer.Option(min=0, max=99, help="Other recordings than those of other seeds.")] = 0,
    effects: Annotated[str, typer.Option(help="Some, joined by commas, or all.")] = "all",
    sizes: Annotated[str, typer.Option(help=f"Of {','.join(SIZES)}.")] = ",".join(SIZES),
    kinds: Annotated[str, typer.Option(help=f"Of {','.join(KINDS)}.")] = ",".join(KINDS),
    jobs: Annotated[int, typer.Option(min=1, max=64, help="Trials side by side.")] = 1,
    limit: Annotated[int | None, typer.Option(min=1, help="Hold at most so many of those that are left.")] = None,
    sized: Annotated[Path, typer.Option(help="File of the sizes found so far, for all runs.")] = SIZED,
    json_wanted: AsJson = False,
) -> None:
    """Hold trials of which the program sees the columns only, open the answers and score them."""
    everything = [*EFFECTS, *UNLISTED]
    named = everything if effects == "all" else _of(effects, everything, "--effects")
    tasks = plan(
        tier,
        _of(kinds, KINDS, "--kinds"),
        named,
        _of(sizes, SIZES, "--sizes"),
        range(first_seed, first_seed + seeds),
    )
    held = {line.task for line in run.lines_of(out) if not line.failed}
    left = [task for task in tasks if task not in held]
    chosen = left[:limit]
    skipped = set(left[len(chosen) :])
    console = Console(stderr=True, highlight=False)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        bar = progress.add_task(f"{len(tasks) - len(left)} held before", total=len(chosen))

        def tell(line: Line) -> None:
            progress.console.print(_in_words(line), soft_wrap=True)
            progress.advance(bar)

        def interrupted(running: int) -> None:
            progress.console.print(f"stopping after the {running} under way; interrupt again to drop them")

        try:
            lines = run.go([task for task in tasks if task not in skipped], out, sized, jobs, tell, interrupted)
        except KeyboardInterrupt:
            progress.console.print("stopped; the same command goes on from here")
            raise typer.Exit(130) from None
    _print(lines, json_wanted)


@app.command()
def report(folders: Folders, json_wanted: AsJson = False) -> None:
    """Score trials that were held."""
    _print(_lines(folders), json_wanted)


@app.command()
def calibrate(folders: Folders) -> None:
    """Fit confidence = 1 / (1 + (M / margin)^k) to each kind of answer and print M and k; nothing is changed."""
    lines = _lines(folders)
    curves = by_answer(lines)
    if not curves:
        raise typer.BadParameter("no trial was held")
    for answer, curve in curves.items():
        typer.echo(
            f"{answer}: M = {curve.half_margin:.4g}, k = {curve.steepness:.3g}, from {curve.answers} answers; "
            f"Brier {curve.brier_before:.4f} as stated, {curve.brier_after:.4f} with this curve"
        )
    score = score_of(restated(lines, curves))
    typer.echo(f"all of them: Brier {score.brier:.4f}")
    for tenth in score.reliability:
        typer.echo(f"  stated {tenth.stated:.3f}, right {tenth.right.value:.3f} of {tenth.right.of}")


@app.command("picture")
def picture_command(
    folders: Folders,
    out: Annotated[Path, typer.Option(help="Folder for one PNG a tier.")] = Path("out/blind_trial"),
) -> None:
    """Draw confusion matrix and reliability curve, a picture for each tier."""
    out.mkdir(parents=True, exist_ok=True)
    lines = _lines(folders)
    if not lines:
        raise typer.BadParameter("no trial was held")
    for tier in dict.fromkeys(line.task.tier for line in lines):
        held = [line for line in lines if line.task.tier == tier]
        found = score_of(held)
        typer.echo(str(picture.draw(found, f"blind trial, {tier} tier, {len(held)} trials", out / f"{tier}.png")))


def _print(lines: Sequence[Line], json_wanted: bool) -> None:
    if not lines:
        raise typer.BadParameter("no trial was held")
    found = score_of(lines)
    if json_wanted:
        typer.echo(json.dumps(as_json(found), indent=2))
    else:
        show(found)


def _lines(folders: Sequence[Path]) -> list[Line]:
    return [line for folder in folders for line in run.lines_of(folder)]


def _of(text: str, known: Sequence[str], option: str) -> list[str]:
    named = text.split(",")
    unknown = [name for name in named if name not in known]
    if unknown:
        raise typer.BadParameter(f"no {', '.join(unknown)}; there are {', '.join(known)}", param_hint=option)
    return list(dict.fromkeys(named))


def _in_words(line: Line) -> str:
    if line.failed:
        return f"failed  {line.task.key}: {line.failed}"
    said = " ".join((line.verdict, *line.effects, *line.signals))
    return (
        f"{'right' if line.right else 'WRONG'}  {line.task.key}: {said}, confidence {line.confidence:.2f}, "
        f"error {line.base_mps:.4f} -> {line.final_mps:.4f} (true {line.true_mps:.4f}) m/s, {line.diagnosis_s:.0f} s"
    )


if __name__ == "__main__":
    app()
