"""`cruise demo`: the main job, live in the terminal or headless."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from cruise import settings
from cruise.cli import picture
from cruise.cli.live import Live, summary
from cruise.cli.places import CONFIG, OUT
from cruise.plant import PlantSettings
from cruise.service import course
from cruise.service import demo as service
from cruise.service import settings as service_settings


def demo(
    headless: Annotated[bool, typer.Option(help="No live view, as fast as it can.")] = False,
    seconds: Annotated[float, typer.Option(min=1.0, help="How long to drive, in simulated seconds.")] = 180.0,
    seed: Annotated[int, typer.Option(min=0, help="Noise and variation of the drive; 0 drives it as written.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON and nothing else.")] = False,
    pace: Annotated[float, typer.Option(min=0.1, help="Speed of the live view relative to real time.")] = 3.0,
    config: Annotated[Path, typer.Option(help="Settings of the service.")] = CONFIG / "cruise.yaml",
    plant: Annotated[Path, typer.Option(help="Settings of the virtual combine.")] = CONFIG / "plant.yaml",
    drive: Annotated[Path, typer.Option(help="The drive: field and operator as rows.")] = CONFIG / "demo.yaml",
    out: Annotated[Path, typer.Option(help="Folder for picture and log.")] = OUT,
) -> None:
    """Drive the virtual combine over CAN: engage, change the setpoint, meet a hill, change the engine speed."""
    live = not headless and not as_json and sys.stdout.isatty()
    out.mkdir(parents=True, exist_ok=True)
    log = out / f"demo-{seed}.log"
    with Live(seconds, enabled=live, progress=not as_json) as view:
        result = service.run(
            service_settings.load(config),
            settings.load(plant, PlantSettings),
            course.load(drive),
            seed,
            seconds,
            log=log,
            pace=pace if live else 0.0,
            show=view.show,
        )
    report = result.report()
    if as_json:
        print(json.dumps(report, indent=2))
        return
    drawn = picture.draw(result, out / f"demo-{seed}.png")
    summary(report, {"picture": drawn, "log of the bus": log})
