"""What the terminal shows while driving and at the end."""

import math
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rich import box
from rich.console import Group
from rich.live import Live as RichLive
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from cruise.cli.console import printer
from cruise.service.cruise_node import Status
from cruise.service.demo import Result

REFRESH_S = 0.2  # s of simulated time between two pictures
STYLES = {
    "off": "dim",
    "standby": "yellow",
    "engaging": "green",
    "engaged": "bold green",
    "overridden": "bold yellow",
    "fault": "bold red",
    "commissioning": "bold magenta",
}


class Live:
    """The live view, or a line of progress where the terminal is no terminal."""

    def __init__(self, seconds: float, enabled: bool, progress: bool) -> None:
        self.seconds = seconds
        self.console = printer()
        self.live = RichLive(console=self.console, auto_refresh=False) if enabled else None
        self.progress = progress and not enabled
        self.shown_s = -math.inf

    def __enter__(self) -> Self:
        if self.live is not None:
            self.live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.live is not None:
            self.live.__exit__(kind, error, trace)

    def show(self, now_s: float, result: Result) -> None:
        """Show the present instant, if it is time to."""
        if self.live is None:
            if self.progress and now_s - self.shown_s >= self.seconds / 10.0:
                self.shown_s = now_s
                state = result.node.engagement.state
                print(f"{now_s:6.1f} s of {self.seconds:.0f} s  {state}", file=sys.stderr)
            return
        if now_s - self.shown_s < REFRESH_S:
            return
        self.shown_s = now_s
        self.live.update(view(result.node.status(now_s), self.seconds, result.combine.truth.grade_deg), refresh=True)


def view(status: Status, seconds: float, grade_deg: float) -> Panel:
    """One picture of the terminal."""
    drive = Table.grid(padding=(0, 2))
    drive.add_column(min_width=13)
    drive.add_column(min_width=30)
    rows = [
        ("state", Text(str(status.state), STYLES[str(status.state)])),
        ("setpoint", number(status.setpoint_mps, "m/s")),
        ("reference", number(status.command.reference_mps, "m/s")),
        ("speed", number(status.speed_mps, "m/s")),
        ("pump current", number(status.current_ma, "mA", 0)),
        ("command", number(status.command.current_ma, "mA", 0)),
        ("disturbance", number(status.command.disturbance_mps, "m/s", 3)),
        ("slope", number(grade_deg, "deg", 1)),
        ("gate", Text(str(status.gate), "green" if status.gate == "open" else "yellow")),
        ("last exit", ": ".join(filter(None, (status.exit_condition, status.exit_detail))) or "-"),
        ("refused", status.refused or "-"),
    ]
    for name, value in rows:
        drive.add_row(Text(name, "dim"), value)
    learned = Table(box=box.SIMPLE_HEAD, title="learned model", title_style="bold")
    for heading in ("parameter", "value", "+-"):
        learned.add_column(heading, justify="left" if heading == "parameter" else "right", min_width=10)
    model = status.learned
    for name, value, error in zip(model.parameter_names, model.theta, model.theta_std, strict=True):
        learned.add_row(name, f"{value:.5g}", f"{error:.2g}")
    errors = Table(box=box.SIMPLE_HEAD, title="RMS error 3 s ahead", title_style="bold")
    errors.add_column("model")
    errors.add_column("m/s", justify="right")
    for name, error in status.rms_ahead_mps.items():
        errors.add_row(name, f"{error:.3f}")
    decision = status.decision
    decided = Text(f"{decision.time_s:.0f} s: {decision.change}: {decision.why}" if decision else "", "dim")
    both = Table.grid(padding=(0, 4))
    both.add_row(drive, Group(learned), Group(errors, Text(f"adopted {status.adoptions} times", "dim"), decided))
    bar = ProgressBar(total=seconds, completed=status.time_s)
    return Panel(Group(both, bar), title=f"cruise demo   {status.time_s:5.1f} s of {seconds:.0f} s")


def number(value: float, unit: str, digits: int = 2) -> str:
    """A number with its unit, a dash where there is none."""
    return f"{value:.{digits}f} {unit}" if math.isfinite(value) else "-"


def summary(report: dict[str, Any], files: dict[str, Path]) -> None:
    """The figures of a drive in words."""
    console = printer()
    table = Table(box=box.SIMPLE_HEAD, title=f"drive with seed {report['seed']}, {report['seconds']:.0f} s")
    for heading in ("figure", "value", "target"):
        table.add_column(heading, justify="left" if heading == "figure" else "right")
    for name, unit, target in (
        ("rms_error_mps", "m/s", "<= 0.03"),
        ("steady_error_mps", "m/s", "0"),
        ("overshoot_pct", "%", "<= 10"),
        ("command_above_1hz_rms_pct", "% of range", "<= 0.5"),
        ("accel_max_mps2", "m/s2", "<= 1.0"),
        ("engaged_s", "s", ""),
    ):
        value = report[name]
        table.add_row(name, "-" if value is None else f"{value:.3f} {unit}", target)
    for name, value in report["error_ahead_mps"].items():
        table.add_row(f"error 3 s ahead, {name}", "-" if value is None else f"{value:.3f} m/s", "")
    console.print(table)
    gates = ", ".join(f"{gate} {100 * share:.0f} %" for gate, share in report["gate_share"].items())
    console.print(f"gate: {gates}")
    console.print("states: " + ", ".join(f"{entry['state']} at {entry['time_s']} s" for entry in report["states"]))
    if report["last_exit"]:
        console.print(f"last exit: {report['last_exit']}")
    if report["interrupted"]:
        console.print("interrupted: the last command on the bus was neutral")
    for what, path in files.items():
        console.print(f"{what}: {path}")
