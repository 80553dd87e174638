"""`cruise run`: the service on a bus."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from cruise.can.bus import open_bus
from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lateness, serve


class Running:
    """True until a signal asks to stop."""

    def __init__(self) -> None:
        self.stopped = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)

    def _stop(self, number: int, frame: object) -> None:
        self.stopped = True

    def __call__(self) -> bool:
        """Whether to go on."""
        return not self.stopped


def run(
    config: Annotated[Path, typer.Argument(help="Settings of the service.")] = CONFIG / "cruise.yaml",
    quiet: Annotated[bool, typer.Option(help="No line of status every 10 s.")] = False,
) -> None:
    """Run the cruise control on the bus until it is stopped; the last command is neutral."""
    settings = service_settings.load(config)
    node = CruiseNode.load(settings)
    lateness, running = Lateness(), Running()
    lines_at_s = ended_s = 0.0
    told = "", ""

    def each_tick(now_s: float) -> None:
        nonlocal lines_at_s, ended_s, told
        ended_s = now_s
        if quiet:
            return
        status = node.status(now_s)
        if (status.refused, status.experiment) != told:  # what the operator has just done is answered at once
            told = status.refused, status.experiment
            lines_at_s = now_s
        if now_s < lines_at_s:
            return
        lines_at_s = now_s + 10.0
        driven = f"  experiment {status.experiment}, {status.experiment_left_s:.0f} s left" if status.experiment else ""
        refused = f"  refused: {status.refused}" if status.refused else ""
        print(
            f"{now_s:8.1f} s  {status.state}  speed {status.speed_mps:.2f} m/s  setpoint {status.setpoint_mps:.2f} m/s"
            f"  gate {status.gate}  missing: {', '.join(status.missing) or 'nothing'}"
            f"{driven}{refused}",
            flush=True,
        )

    with open_bus(settings.can) as bus:
        print(f"cruise: on {settings.can.bus} {settings.can.channel}, command every {node.period_s} s", flush=True)
        try:
            serve(node, bus, running, each_tick, lateness)
        finally:  # whatever ended it: as long as there is a bus, the last word on it is neutral
            for frame in node.stop(ended_s):
                bus.send(frame)
    print(
        f"cruise: stopped, neutral sent; ticks late by p50 {lateness.quantile_ms(0.5):.1f}, "
        f"p99 {lateness.quantile_ms(0.99):.1f}, max {lateness.worst_ms:.1f} ms; {lateness.missed} left out",
        file=sys.stderr,
    )
