"""`tools/closed_loop_trials`: every driver over every course in one run, each figure beside its target."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from cruise import settings
from cruise.control.controller import ControlSettings
from cruise.model import files
from cruise.plant import PlantSettings
from tools.benchmarks.figures import Part, show

from . import courses, hidden, machines, picture, scores
from .drive import rms
from .drivers import DRIVERS
from .trial import BEST, Run, models_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
PAPER = 150  # characters


def trials(
    machine: Annotated[str, typer.Option(help=f"Of {', '.join(machines.MACHINES)}.")] = "other",
    chosen: Annotated[str, typer.Option("--courses", help="Some, joined by commas; default: all.")] = "",
    drivers: Annotated[str, typer.Option(help=f"Of {','.join(DRIVERS)}.")] = ",".join(DRIVERS),
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' noise and the ground.")] = 11,
    hide: Annotated[
        bool, typer.Option("--hidden", help="The table of hidden effects instead, on the same machine.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    drawn: Annotated[Path | None, typer.Option("--picture", help="Draw the drives here (.png).")] = None,
) -> None:
    """Drive the courses and print the figures."""
    known = {course.name: course for course in courses.load()}
    wanted = _of(chosen, list(known), "--courses")
    names = _of(drivers, list(DRIVERS), "--drivers")
    if machine not in machines.MACHINES:
        raise typer.BadParameter(f"no {machine}; there are {', '.join(machines.MACHINES)}", param_hint="--machine")
    plant = machines.machine(machine, settings.load(CONFIG / "plant.yaml", PlantSettings))
    console = Console(width=None if sys.stdout.isatty() else PAPER, highlight=False)
    with Console(stderr=True).status("begin") as status:
        if hide:
            part = hidden.measure(plant, seed, ControlSettings(), tuple(known.values()), status.update)
            _print(console, "hidden effects", part, as_json, {})
            return
        models = models_of(plant, files.load(CONFIG / "factory_model.yaml"), seed, status.update)
        chosen_courses = tuple(known[name] for name in wanted)
        run = Run(machine, plant, seed, chosen_courses, models, ControlSettings())
        run.go(names, status.update)
        if BEST in names and not chosen:
            run.ripple(known["hill up"], status.update)
    part = Part(tuple(run.figures()), (seed,), (f"machine: {machine}; learned on seed {seed}",))
    table = {
        name: {course: rms([scores.to_reference(one)]) for course, one in drives.items()}
        for name, drives in run.drives.items()
    }
    _print(console, "closed loop", part, as_json, table)
    if drawn is not None:
        picture.draw(run, drawn)


def _print(console: Console, title: str, part: Part, as_json: bool, table: dict[str, dict[str, float]]) -> None:
    if as_json:
        typer.echo(json.dumps(part.as_json() | {"rms_to_reference_mps": table}, indent=2))
        return
    show(title, part, console)
    if not table:
        return
    shown = Table(title="RMS to the reference, mm/s", title_justify="left")
    shown.add_column("course")
    for name in table:
        shown.add_column(DRIVERS[name].title, justify="right")
    for course in next(iter(table.values())):
        shown.add_row(course, *(f"{1e3 * column[course]:.1f}" for column in table.values()))
    console.print(shown)


def _of(text: str, known: list[str], option: str) -> list[str]:
    named = [one.strip() for one in text.split(",")] if text else known
    unknown = [name for name in named if name not in known]
    if unknown:
        raise typer.BadParameter(f"no {', '.join(unknown)}; there are {', '.join(known)}", param_hint=option)
    return list(dict.fromkeys(named))


if __name__ == "__main__":
    typer.run(trials)
