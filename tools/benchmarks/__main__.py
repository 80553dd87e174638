"""`tools/bench [PART...] [--json]`: every figure beside its target, from one run."""

import json
import sys
from collections.abc import Callable
from time import perf_counter
from typing import Annotated

import typer
from rich.console import Console

from . import (
    control_step,
    dart,
    driving,
    engaged,
    estimator,
    identification,
    ladder,
    learning,
    loop,
    missing,
    opening,
    plant,
    real_bus,
    recovery,
    workbench,
)
from .figures import Part, show

PAPER = 140  # characters, width of the tables in a file
PARTS: dict[str, Callable[[], Part]] = {
    "estimator": estimator.measure,  # time of one update
    "control": control_step.measure,  # time of one control step with the estimator, and its memory
    "loop": loop.measure,  # lateness at 100 Hz
    "real_bus": real_bus.measure,  # start, memory and the units of the service as it is installed
    "plant": plant.measure,  # speed of the virtual combine
    "learning": learning.measure,  # against batch least squares, and after a change
    "constant": engaged.constant_speed,  # half an hour of constant speed
    "together": engaged.together,  # offset, disturbance and drift at once
    "drive": driving.measure,  # the demo's figures
    "dart": dart.measure,  # measured drives
    "opening": opening.measure,  # an hour's recording, in every kind of file
    "workbench": workbench.measure,  # first picture of an hour, and zooming in it
    "recovery": recovery.measure,  # known systems come back
    "ladder": ladder.measure,  # the demo before and after an effect was added
    "missing": missing.measure,  # a found effect against general methods, and the time of a diagnosis
    "identification": identification.measure,  # fits against peers, every model on measured drives
}


def bench(
    parts: Annotated[list[str] | None, typer.Argument(metavar="[PART]...", help=f"Of {', '.join(PARTS)}.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Measure the parts, all without an argument, and print their figures beside the targets."""
    chosen = parts or list(PARTS)
    unknown = [name for name in chosen if name not in PARTS]
    if unknown:
        raise typer.BadParameter(f"no such part: {', '.join(unknown)}; there are {', '.join(PARTS)}")
    progress, found = Console(stderr=True), {}
    for name in chosen:
        begin_s = perf_counter()
        progress.print(f"{name} ...", end=" ")
        found[name] = PARTS[name]()
        progress.print(f"{perf_counter() - begin_s:.0f} s")
    if as_json:
        typer.echo(json.dumps({name: part.as_json() for name, part in found.items()}, indent=2))
        return
    console = Console(width=None if sys.stdout.isatty() else PAPER)
    for name, part in found.items():
        show(name, part, console)
    missed = [f"{name}.{figure.key}" for name, part in found.items() for figure in part.figures if figure.missed]
    console.print(f"missed: {', '.join(missed)}" if missed else "every target met", soft_wrap=True)


if __name__ == "__main__":
    typer.run(bench)
