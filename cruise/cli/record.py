"""`cruise record`: what the bus says, into a candump log."""

import time
from pathlib import Path
from typing import Annotated

import typer

from cruise.can.bus import open_bus
from cruise.can.log import LogWriter
from cruise.cli.places import CONFIG
from cruise.cli.run import Running
from cruise.service import settings as service_settings


def record(
    log: Annotated[Path, typer.Argument(help="The candump log to write (.log).")],
    config: Annotated[Path, typer.Option(help="Settings of the service: which bus.")] = CONFIG / "cruise.yaml",
    seconds: Annotated[float, typer.Option(help="How long; 0 is until it is stopped.")] = 0.0,
) -> None:
    """Record every frame of the bus until it is stopped."""
    settings = service_settings.load(config)
    running = Running()
    with open_bus(settings.can) as bus, LogWriter.create(log, settings.can.channel) as writer:
        end_s = time.monotonic() + seconds if seconds > 0 else float("inf")
        while running() and time.monotonic() < end_s:
            frame = bus.receive(min(time.monotonic() + 0.5, end_s))
            if frame is not None:
                writer.write(frame)
        print(f"{writer.frames} frames in {log}")
