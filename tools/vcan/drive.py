"""The drive of `cruise demo` by four processes on a kernel's bus: combine, operator, service and recorder.

    tools/vcan_machine .venv/bin/python -m tools.vcan.drive --out FOLDER

The figures are of the same names and by the same code as those of `cruise demo`; `--json` gives them as JSON.
"""

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np
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


def main() -> None:
    """Drive and print."""
    parser = argparse.ArgumentParser(prog="tools.vcan.drive", description="`cruise demo` by four processes on a bus.")
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the recorder's log and the rest")
    parser.add_argument("--json", action="store_true", dest="as_json")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    report = run(settings(), given.seconds, given.seed, given.out)
    if given.as_json:
        print(json.dumps(report, indent=2))  # noqa: T201
        return
    for name, value in report.items():
        print(f"{name:28} {value}")  # noqa: T201


if __name__ == "__main__":
    main()
