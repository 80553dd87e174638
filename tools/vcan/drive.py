"""The drive of `cruise demo` by four processes on a kernel's bus: combine, operator, service and recorder.

    tools/vcan_machine .venv/bin/python -m tools.vcan.drive --out FOLDER

The figures are of the same names and by the same code as those of `cruise demo`; `--json` gives them as JSON.
"""

import json
import os
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from msgspec import structs

from cruise.cli.places import CONFIG
from cruise.service import course
from cruise.service import settings as service_settings
from cruise.service.figures import drive_figures
from cruise.service.settings import CruiseSettings
from tools.vcan import players

READY_S = 5.0  # s after which combine and operator begin; the others are up by then


def settings() -> CruiseSettings:
    """Those of config/, on the bus CRUISE_VCAN."""
    found = service_settings.load(CONFIG / "cruise.yaml")
    return structs.replace(found, can=structs.replace(found.can, bus="socketcan", channel=os.environ["CRUISE_VCAN"]))


def run(wanted: CruiseSettings, seconds: float, seed: int, folder: Path) -> dict:
    """Drive, and return the figures; `drive.log` in the folder is what the recorder wrote."""
    drive = course.vary(course.load(CONFIG / "demo.yaml"), seed)
    truth, known = folder / "truth", folder / "known"
    begin_s = time.monotonic() + READY_S
    with players.killed_in_the_end() as start:
        recorder = start(lambda: players.recorder(wanted, folder / "drive.log"))
        service = start(lambda: players.service(wanted, known))
        others = [
            start(lambda: players.combine(wanted, drive, seed, begin_s, truth)),
            start(lambda: players.operator(wanted, drive, begin_s)),
        ]
        time.sleep(begin_s + seconds - time.monotonic())
        codes = [process.end() for process in (service, *others, recorder)]
    if any(codes):
        raise RuntimeError(f"a process ended with an error: {codes}")
    report = json.loads(known.with_suffix(".json").read_text(encoding="utf-8"))
    frame_s, limits = wanted.control.frame_s, wanted.control.limits
    columns = _side_by_side(players.read(truth, players.TRUTH), players.read(known, players.KNOWN), frame_s)
    figures = drive_figures(columns, frame_s, limits.current_max_ma - limits.current_min_ma)
    return {"seed": seed, "seconds": seconds, **figures, **report, "log": str(folder / "drive.log")}


def _side_by_side(truth: dict[str, np.ndarray], known: dict[str, np.ndarray], frame_s: float) -> dict[str, np.ndarray]:
    """Return the columns of both at the same instants, each the newest one then."""
    time_s = np.arange(truth["time_s"][0] + frame_s, min(truth["time_s"][-1], known["time_s"][-1]), frame_s)

    def at(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        newest = np.searchsorted(columns["time_s"], time_s, side="right") - 1
        return {name: column[newest] for name, column in columns.items() if name != "time_s"}

    return {"time_s": time_s - time_s[0]} | at(truth) | at(known)


def main(
    seconds: Annotated[float, typer.Option(min=1.0, help="Of the drive, in real time.")] = 180.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' noise and the ground.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the recorder's log and the rest.")] = Path("out"),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """`cruise demo` by four processes on a bus."""
    out.mkdir(parents=True, exist_ok=True)
    report = run(settings(), seconds, seed, out)
    if as_json:
        typer.echo(json.dumps(report, indent=2))
        return
    for name, value in report.items():
        typer.echo(f"{name:28} {value}")


if __name__ == "__main__":
    typer.run(main)
