"""`cruise record`: what the bus says, into a candump log, or into the ring of a black box."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from cruise.can.bus import Bus, PatientBus, open_bus
from cruise.can.codec import Codec
from cruise.can.log import LogError, LogWriter, check_name
from cruise.can.ring import Ring, RingSettings
from cruise.cli.places import CONFIG
from cruise.cli.run import Running, say
from cruise.service import settings as service_settings
from cruise.service.black_box import BlackBox
from cruise.service.loop import Ear, Node, serve
from cruise.service.notify import Notifier
from cruise.service.settings import CruiseSettings


def record(
    log: Annotated[Path, typer.Argument(help="The candump log to write (.log); with --ring a folder.")],
    config: Annotated[Path, typer.Option(help="Settings of the service: which bus.")] = CONFIG / "cruise.yaml",
    seconds: Annotated[float, typer.Option(min=0.0, help="How long; 0 is until it is stopped.")] = 0.0,
    ring: Annotated[bool, typer.Option(help="Keep the last hours only, in the folder, and what was around exits.")] = (
        False
    ),
    size_mb: Annotated[float, typer.Option(min=0.001, help="Size of the ring in MB.")] = 500.0,
) -> None:
    """Record every frame of the bus until it is stopped."""
    settings = service_settings.load(config)
    if ring and log.is_file():
        raise LogError(f"{log}: is a file; with --ring give a folder")
    if not ring:
        check_name(log)
    if ring:
        _ring(settings, log, RingSettings(size_bytes=int(1e6 * size_mb)), seconds)
        return
    if log.exists():
        raise LogError(f"{log}: is there already and is not overwritten; give another name")
    with open_bus(settings.can) as bus, LogWriter.create(log, settings.can.channel) as writer:
        _listen(Ear(writer.write, period_s=0.1), bus, seconds)
        print(f"{writer.frames} frames in {log}")


def _ring(settings: CruiseSettings, folder: Path, kept: RingSettings, seconds: float) -> None:
    notifier = Notifier.of()
    codec = Codec.load(settings.database, settings.can)
    with PatientBus(settings.can.channel, lambda: open_bus(settings.can)) as bus:
        box = BlackBox(codec, Ring(folder, kept, settings.can.channel), say)
        notifier.ready()
        try:
            _listen(box, bus, seconds, notifier.alive)
        finally:
            box.close()
    lost = f"; {box.failures} could not be written" if box.failures else ""
    print(f"{box.ring.frames} frames in {folder}, {box.exits} exits{lost}")


def _listen(node: Node, bus: Bus, seconds: float, each_tick: Callable[[float], None] = lambda now_s: None) -> None:
    running, ended = Running(), False

    def until(now_s: float) -> None:
        nonlocal ended
        ended = 0.0 < seconds <= now_s
        each_tick(now_s)

    serve(node, bus, lambda: running() and not ended, until, wall_clock=True)
