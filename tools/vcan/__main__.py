"""`tools/vcan_machine COMMAND`: the command's output, its exit code, or 77 and why no bus can be had here.

It runs with a bus vcan0 of its own. In the virtual machine all files of this machine are there, what is written to
them is gone afterwards, but for FOLDER (--keep). Nothing but Python's standard library is needed to start it.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from tools.vcan import here, machine
from tools.vcan.debian import UnavailableError

NOT_HERE = 77  # as in automake's tests: skipped


def main() -> int:
    """Run the command and return its exit code."""
    parser = argparse.ArgumentParser(prog="tools/vcan_machine", description="Run a command where a CAN bus vcan0 is.")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="folder in which what the command writes remains")
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--here", action="store_true", help="with the kernel at hand or not at all")
    place.add_argument("--machine", action="store_true", help="in the virtual machine, whatever the kernel at hand has")
    parser.add_argument("--systemd", action="store_true", help="in the virtual machine, with systemd as process 1")
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="COMMAND")
    given = parser.parse_args()
    if not given.command:
        parser.error("which command?")
    try:
        if not (given.machine or given.systemd):
            reason = here.why_not()
            if reason is None:
                return subprocess.call(here.command(given.command))
            if given.here:
                raise UnavailableError(reason)
            say(f"{reason}; taking a virtual machine")
        with tempfile.TemporaryDirectory(prefix="vcan-") as folder:
            return machine.run(given.command, given.keep, Path(folder), given.systemd, say)
    except UnavailableError as error:
        say(f"NOT RUN: {error}")
        return NOT_HERE


def say(what: str) -> None:
    """Tell the user, aside from the command's own output."""
    sys.stderr.write(f"tools/vcan_machine: {what}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
