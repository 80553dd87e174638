"""The units as they are in systemd/, installed in a machine that is thrown away afterwards."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.real_bus.conftest import BUS

ROOT = Path(__file__).parents[3]
UNITS = ("cruise.service", "cruise-recorder.service")
collect_ignore_glob = [] if BUS and Path("/run/vcan-units").is_dir() else ["test_*.py"]
# Where tools/install puts the program. Interpreter, packages and program are mounted there, out of this checkout: the
# units hide the users' own folders.
START = """#!/bin/sh
export PYTHONPATH=/opt/cruise/program:/opt/cruise/packages
exec /opt/cruise/python/bin/python3 -c "from cruise.cli import main; main()" "$@"
"""


def systemctl(*words: str) -> str:
    """Return what it says. Raises CalledProcessError."""
    return subprocess.run(["systemctl", *words], check=True, capture_output=True, text=True).stdout.strip()


def shown(unit: str, name: str) -> str:
    """Return a property of a unit."""
    return systemctl("show", "--property", name, "--value", unit)


@pytest.fixture(scope="session")
def installed() -> Iterator[None]:
    """Both units, with settings for this bus. CRUISE_INSTALLED may name what tools/install --root has made."""
    if root := os.environ.get("CRUISE_INSTALLED"):
        subprocess.run(["cp", "-r", f"{root}/etc", "/"], check=True)
        _mounted(Path(root) / "opt/cruise", Path("/opt/cruise"))
    else:
        _as_installed()
    settings = Path("/etc/cruise/cruise.yaml")
    text = settings.read_text(encoding="utf-8").replace("channel: can0", f"channel: {BUS}")
    settings.write_text(f'{text}\npersistence: {{machine: "A1"}}\n', encoding="utf-8")
    systemctl("daemon-reload")
    yield
    systemctl("stop", *UNITS)


def _as_installed() -> None:
    packages = next(path for path in sys.path if path.endswith("site-packages"))
    for name, folder in (("program", ROOT), ("packages", packages), ("python", sys.base_prefix)):
        _mounted(folder, Path("/opt/cruise") / name)
    program = Path("/opt/cruise/bin/cruise")
    program.parent.mkdir()
    program.write_text(START, encoding="utf-8")
    program.chmod(0o755)
    settings = Path("/etc/cruise")
    settings.mkdir()
    for file in ("cruise.yaml", "factory_model.yaml", "cruise.dbc", "cruise.eds"):
        (settings / file).write_bytes((ROOT / "config" / file).read_bytes())
    for unit in UNITS:
        (Path("/etc/systemd/system") / unit).write_bytes((ROOT / "systemd" / unit).read_bytes())


def _mounted(folder: str | Path, place: Path) -> None:
    place.mkdir(parents=True)
    subprocess.run(["mount", "--bind", str(folder), str(place)], check=True)
