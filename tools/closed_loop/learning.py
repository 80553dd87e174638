"""`tools/learning_trial`: hours of learning while driving, and what the feedback does to what is learned."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from cruise import settings
from cruise.model import files
from cruise.plant import PlantSettings
from tools.benchmarks.figures import show

from . import bias, courses, hours, machines

CONFIG = Path(__file__).resolve().parents[2] / "config"
PAPER = 150  # characters


def trial(
    machine: Annotated[str, typer.Option(help=f"Of {', '.join(machines.MACHINES)}.")] = "factory",
    simulated: Annotated[
        float, typer.Option("--hours", min=0.1, help="Simulated hours; 10 take about 20 minutes.")
    ] = 10.0,
    seed: Annotated[
        int, typer.Option(min=0, help="Of the order of the courses, the sensors' noise and the ground.")
    ] = 31,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Drive all courses over and over, once learning and once with the factory's model, and print the figures."""
    if machine not in machines.MACHINES:
        raise typer.BadParameter(f"no {machine}; there are {', '.join(machines.MACHINES)}", param_hint="--machine")
    plant = machines.machine(machine, settings.load(CONFIG / "plant.yaml", PlantSettings))
    factory, known = files.load(CONFIG / "factory_model.yaml"), courses.load()
    with Console(stderr=True).status("begin") as status:
        part, run = hours.measure(plant, factory, known, simulated, seed, status.update)
        feedback = bias.measure(plant, factory, known, seed, status.update)
    if as_json:
        parts = {"learning": part.as_json(), "bias": feedback.as_json(), "decisions": run.as_json()}
        typer.echo(json.dumps({"machine": machine} | parts, indent=2))
        return
    console = Console(width=None if sys.stdout.isatty() else PAPER, highlight=False)
    show("learning while driving", part, console)
    show("bias of feedback", feedback, console)
    for hour, course, decision in run.decisions:
        console.print(f"{hour:6.2f} h  {course}, {decision.time_s:.0f} s: {decision}", soft_wrap=True)


if __name__ == "__main__":
    typer.run(trial)
