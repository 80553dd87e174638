"""`cruise record`: what the bus says, into a candump log."""

from pathlib import Path
from typing import Annotated

import typer

from cruise.can.bus import open_bus
from cruise.can.log import LogError, LogWriter
from cruise.cli.places import CONFIG
from cruise.cli.run import Running
from cruise.service import settings as service_settings
from cruise.service.loop import Ear, serve


def record(
    log: Annotated[Path, typer.Argument(help="The candump log to write (.log).")],
    config: Annotated[Path, typer.Option(help="Settings of the service: which bus.")] = CONFIG / "cruise.yaml",
    seconds: Annotated[float, typer.Option(help="How long; 0 is until it is stopped.")] = 0.0,
) -> None:
    """Record every frame of the bus until it is stopped."""
    if log.exists():
        raise LogError(f"{log}: is there already and is not overwritten; give another name")
    settings = service_settings.load(config)
    running = Running()
    with open_bus(settings.can) as bus, LogWriter.create(log, settings.can.channel) as writer:
        ended = False

        def until(now_s: float) -> None:
            nonlocal ended
            ended = 0.0 < seconds <= now_s

        serve(Ear(writer.write, period_s=0.1), bus, lambda: running() and not ended, until)
        print(f"{writer.frames} frames in {log}")
